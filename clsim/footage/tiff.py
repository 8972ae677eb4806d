"""TIFF of floating point, which libav takes for whole numbers or refuses."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np

from clsim.errors import InputError
from clsim.footage.source import check_size
from clsim.frames.frame import FloatArray

ENDINGS = (".tif", ".tiff")
_FLOAT = 3
"""TIFF's number of that sample format."""
_PLANAR = 2


def float_picture(path: str) -> FloatArray | None:
    """Return the first picture of a TIFF of floating point, grey ``[1, H, W]`` or ``[3, H, W]``; None for other TIFF.

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
            if page.sampleformat != _FLOAT:
                return None
            check_size(path, page.imagewidth, page.imagelength)
            pixels = np.asarray(page.asarray(), np.float32)
            planar = page.planarconfig == _PLANAR
    except InputError:
        raise
    except Exception as error:  # of a decoder, which may raise anything for damaged files
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise InputError(f"{path}: cannot be decoded ({reason})") from None
    if pixels.ndim == 2:
        return pixels[None]
    planes = pixels if planar else np.moveaxis(pixels, 2, 0)
    # A second or fourth channel is opacity.
    return planes[:3] if len(planes) >= 3 else planes[:1]
