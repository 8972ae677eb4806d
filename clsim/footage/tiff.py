"""TIFF that libav takes for something else, makes black or refuses: floating point, tiles, rare compressions."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import NamedTuple

import numpy as np

from clsim.errors import InputError
from clsim.footage.source import check_size
from clsim.footage.upright import Lie, of_number
from clsim.frames.frame import FloatArray

ENDINGS = (".tif", ".tiff")
_WHOLE, _FLOAT = 1, 3
"""TIFF's numbers of these sample formats."""
_GREY, _RGB = 1, 2
_PLANAR = 2
_OF_LIBAV = (1, 2, 3, 4, 5, 8, 32773, 32946)
"""Compressions that libav decodes: none, fax, LZW, deflate, PackBits."""


class TiffPicture(NamedTuple):
    """The first picture of a TIFF.

    Attributes:
        lie: how it lies.
        pages: how many the file has.
        planes: grey ``[1, H, W]`` or ``[3, H, W]``, whole numbers from 0 to 1; None where libav reads it well.
        steps: of whole numbers, from black to white; None for floating point.
    """

    lie: Lie
    pages: int
    planes: FloatArray | None = None
    steps: int | None = None


def tiff_picture(path: str) -> TiffPicture:
    """Read the first picture of a TIFF, unless libav does it well.

    Raises:
        InputError: it cannot be read.
    """
    if importlib.util.find_spec("tifffile") is None:
        raise InputError(f"{path}: TIFF needs tifffile; install it with: pip install 'clsim[video]'")
    import tifffile

    if not Path(path).is_file():
        raise InputError(f"{path}: there is no such file")
    try:
        with tifffile.TiffFile(path) as file:
            page = file.pages.first
            tag = page.tags.get("Orientation")
            lie = of_number(None if tag is None else tag.value)
            pages = len(file.pages)
            whole = page.sampleformat == _WHOLE
            if whole and page.compression in _OF_LIBAV and not (page.is_tiled or file.is_bigtiff):
                return TiffPicture(lie, pages)
            kind = np.dtype(page.dtype)
            if kind.kind not in "uf" or (whole and kind.itemsize > 2) or page.photometric not in (_GREY, _RGB):
                raise InputError(
                    f"{path}: holds {kind} as {getattr(page.photometric, 'name', page.photometric)}; expected grey or "
                    "RGB of 8 or 16 bits without a sign, or of floating point"
                )
            check_size(path, page.imagewidth, page.imagelength)
            pixels = np.asarray(page.asarray(), np.float32)
            planar = page.planarconfig == _PLANAR
            planes = pixels[None] if pixels.ndim == 2 else pixels if planar else np.moveaxis(pixels, 2, 0)
            if planes.ndim != 3 or planes.shape[1:] != (page.imagelength, page.imagewidth):
                raise ValueError(f"pixels {list(pixels.shape)}")
    except InputError:
        raise
    except Exception as error:  # of a decoder, which may raise anything for damaged files
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise InputError(f"{path}: cannot be decoded ({reason})") from None
    # A second or fourth channel is opacity.
    planes = planes[:3] if len(planes) >= 3 else planes[:1]
    steps = int(np.iinfo(kind).max) if whole else None
    return TiffPicture(lie, pages, planes / np.float32(steps) if steps else planes, steps)
