"""Folders of pictures: PNG, JPEG, TIFF and whatever else PyAV decodes, 8 or 16 bit or floating point."""

from __future__ import annotations

import glob
import re
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

from clsim.errors import InputError
from clsim.footage import Transfer
from clsim.footage.pixels import TOLD_OF_PICTURES, PixelFormat, pixel_format, to_light
from clsim.footage.source import AS_TOLD, Footage, Reading
from clsim.footage.tiff import ENDINGS as TIFF
from clsim.footage.tiff import tiff_picture
from clsim.footage.transfer import decode
from clsim.footage.upright import Lie, of_exif
from clsim.footage.video import first_frame, open_media
from clsim.frames import SourceEnded
from clsim.frames.frame import FloatArray, page_aligned

ENDINGS = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".ppm", ".pgm")
_JPEG = (".jpg", ".jpeg")
_WITH_EXIF = (*_JPEG, ".png", ".webp")
_SCAN, _END = b"\xff\xda", b"\xff\xd9"


class Pictures(Footage):
    """Pictures of a folder or glob pattern, in the order of the numbers in their names."""

    def __init__(self, path: str | Path, reading: Reading = AS_TOLD) -> None:
        """List the files and decode the first; without a transfer function whole numbers are sRGB, others linear.

        Raises:
            InputError: there is none, one cannot be read, their times are not given, or are not as many.
        """
        self._files = picture_files(path)
        times_us = reading.times_us
        if times_us is None and reading.fps is None:
            raise InputError(f"{path}: pictures carry no times; give `fps` or `times`")
        if times_us is not None and len(times_us) != len(self._files):
            raise InputError(f"{path}: has {len(self._files)} pictures, but there are {len(times_us)} times")
        where = str(self._files[0])
        first = _Picture(where)
        self._kind, size = first.kind, first.size
        transfer = reading.transfer
        if transfer is None:
            told = self._kind.transfer if self._kind.transfer in TOLD_OF_PICTURES else None
            transfer = told or ("linear" if self._kind.steps is None else "srgb")
        warnings = () if reading.times_us is not None else tuple(_leaps(path, self._files))
        if len(self._files) == 1:
            warnings = (f"{where} is taken as one picture, and nothing changes in it; expected a file for each",)
        elif first.pages > 1:
            warnings = (*warnings, f"{where} holds {first.pages} pages, of which the first is read")
        super().__init__(where, size, self._kind.steps, transfer, reading, warnings)
        self.frame_count = len(self._files)
        if times_us is not None and len(times_us) > 1:
            self.fps = 1e6 * (len(times_us) - 1) / (times_us[-1] - times_us[0])

    def _read(self, index: int, out_rgb: FloatArray) -> int | None:
        if index >= len(self._files):
            raise SourceEnded
        self._where = where = str(self._files[index])
        picture = _Picture(where)
        width, height = picture.size
        if (width, height) != (self.width, self.height) or picture.kind.steps != self._kind.steps:
            raise InputError(
                f"{where}: has {width}×{height} pixels as {picture.kind.name}, expected "
                f"{self.width}×{self.height} as {self._kind.name} of {self._files[0].name}"
            )
        picture.to_light(self.transfer, out_rgb)
        return None

    def close(self) -> None:
        """Release nothing: files are closed after each picture."""


class _Picture:
    """A decoded picture: how it stores colour, its size (width, height), and how many pages its file has."""

    def __init__(self, where: str) -> None:
        name = where.lower()
        tiff = tiff_picture(where) if name.endswith(TIFF) else None
        self._planes = None if tiff is None else tiff.planes
        self._frame: Any = None
        self.pages = 1 if tiff is None else tiff.pages
        if tiff is not None and self._planes is not None:
            self.kind = PixelFormat("tiles" if tiff.steps else "floating point", tiff.steps, True, None, None, 1)
            self._lie, self._stored = tiff.lie, self._planes.shape[:0:-1]
        else:
            with open_media(where) as container:
                data = Path(where).read_bytes() if name.endswith(_WITH_EXIF) else b""
                if name.endswith(_JPEG):
                    _check_whole_jpeg(where, data)
                self._frame, _ = first_frame(container, where)
                self.kind = pixel_format(self._frame, where, is_picture=True)
            self._lie, self._stored = tiff.lie if tiff else of_exif(data), (self._frame.width, self._frame.height)
        self.size = self._lie.size(*self._stored)

    def to_light(self, transfer: Transfer, out_rgb: FloatArray) -> None:
        if self._planes is not None:
            out_rgb[...] = self._lie.upright(self._planes)  # grey spreads over three
            decode(out_rgb, transfer)
        elif self._lie == Lie():
            to_light(self._frame, self.kind, transfer, out_rgb)
        else:
            width, height = self._stored
            scratch = page_aligned((3, height, width))
            to_light(self._frame, self.kind, transfer, scratch)
            out_rgb[...] = self._lie.upright(scratch)


def _leaps(path: str | Path, files: list[Path]) -> Iterator[str]:
    """Yield a warning where the numbers of pictures count evenly but for a leap: some are missing."""
    numbers = [int(found[-1]) for file in files if (found := re.findall(r"\d+", file.stem))]
    steps = Counter(b - a for a, b in pairwise(numbers))
    if len(numbers) < len(files) or len(steps) < 2 or min(steps) < 1:
        return
    (step, count), *_ = steps.most_common(1)
    if count < sum(steps.values()) / 2 or any(each % step for each in steps):
        return  # such as times in names
    a, b = next((a, b) for a, b in pairwise(numbers) if b - a > step)
    yield f"{path}: its numbers leap from {a} to {b}, and what is missing takes no time; give `times` of the pictures"


def _check_whole_jpeg(where: str, data: bytes) -> None:
    """Raise InputError for a JPEG without its end, of which libav makes a picture that is grey below."""
    if data.rfind(_END) < data.rfind(_SCAN):
        raise InputError(f"{where}: ends in the middle of its picture; expected all of it")


def picture_files(path: str | Path) -> list[Path]:
    """List the pictures of a folder or glob pattern, ordered by the numbers in their names.

    Raises:
        InputError: there is none, or there are several films.
    """
    base = Path(path)
    found = list(base.iterdir()) if base.is_dir() else [Path(name) for name in glob.glob(str(path))]
    files = [file for file in found if file.suffix.lower() in ENDINGS and not file.name.startswith(".")]
    if not files:
        raise InputError(f"no picture at {path}; expected a folder or glob pattern of {', '.join(ENDINGS)}")
    if base.is_dir():
        _check_one_film(path, base, [file.name for file in files])
    else:
        _check_one_film(path, Path(), [str(file) for file in files])
    return sorted(files, key=_natural)


def _check_one_film(path: str | Path, folder: Path, files: list[str]) -> None:
    """Raise InputError where names tell of several films, such as ``rgba_0001`` and ``depth_0001``, or of a stray."""
    films: dict[str, list[str]] = {}
    for file in files:
        films.setdefault(re.sub(r"\d+", "*", file), []).append(file)
    if max(map(len, films.values())) > 1 and len(films) > 1:
        told = ", ".join(sorted(films)[:8])
        example = folder / max(films, key=lambda film: len(films[film]))
        raise InputError(f"{path}: holds pictures of several kinds: {told}; choose with a pattern, such as '{example}'")
    for film, names in films.items():
        if film.count("*") > 1:
            _check_one_number(path, folder, names)


def _check_one_number(path: str | Path, folder: Path, names: list[str]) -> None:
    """Raise InputError where names that differ in an earlier number count anew behind it: ``cam0_0001``, ``cam1_0001``.

    Times, such as ``12_59_59`` and ``1690000000.123456``, hardly ever come to the same last number again and again.
    """
    before: dict[tuple[str, ...], set[str]] = {}
    for name in names:
        *first, last = re.findall(r"\d+", str(Path(name).with_suffix("")))
        before.setdefault(tuple(first), set()).add(last)
    films = sorted(before)
    if len(films) < 2 or any(len(last) < 2 or last != before[films[0]] for last in before.values()):
        return
    marks = iter([*films[0], "*"])
    example = folder / re.sub(r"\d+", lambda _: next(marks), names[0], count=len(films[0]) + 1)
    raise InputError(
        f"{path}: holds {len(films)} films whose pictures are counted alike; choose one with a pattern, such as "
        f"'{example}'"
    )


def _natural(file: Path) -> tuple[list[tuple[int, int, str]], str]:
    """Return a key that orders 2 before 10, in names of folders too."""
    parts = re.split(r"(\d+)", str(file.with_suffix("")))
    return [(1, int(part), "") if part.isdigit() else (0, 0, part) for part in parts], file.name
