"""Folders of pictures: PNG, JPEG, TIFF and whatever else PyAV decodes, 8 or 16 bit or floating point."""

from __future__ import annotations

import glob
import re
from pathlib import Path

from clsim.errors import InputError
from clsim.footage.pixels import PixelFormat, pixel_format, to_light
from clsim.footage.source import AS_TOLD, Footage, Reading
from clsim.footage.video import first_frame, open_media
from clsim.frames import SourceEnded
from clsim.frames.frame import FloatArray

ENDINGS = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".ppm", ".pgm")
_HDR = ("pq", "hlg")


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
        with open_media(where) as container:
            frame, _ = first_frame(container, where)
            self._kind: PixelFormat = pixel_format(frame, where)
            size = frame.width, frame.height
        transfer = reading.transfer
        if transfer is None:
            # What libav tells of pictures is a guess of its decoders, but for HDR.
            told = self._kind.transfer if self._kind.transfer in _HDR else None
            transfer = told or ("linear" if self._kind.steps is None else "srgb")
        super().__init__(where, size, self._kind.steps, transfer, reading)
        self.frame_count = len(self._files)
        if times_us is not None and len(times_us) > 1:
            self.fps = 1e6 * (len(times_us) - 1) / (times_us[-1] - times_us[0])

    def _read(self, index: int, out_rgb: FloatArray) -> int | None:
        if index >= len(self._files):
            raise SourceEnded
        self._where = where = str(self._files[index])
        with open_media(where) as container:
            frame, _ = first_frame(container, where)
            kind = pixel_format(frame, where)
            if (frame.width, frame.height) != (self.width, self.height) or kind.steps != self._kind.steps:
                raise InputError(
                    f"{where}: has {frame.width}×{frame.height} pixels as {kind.name}, expected "
                    f"{self.width}×{self.height} as {self._kind.name} of {self._files[0].name}"
                )
            to_light(frame, kind, self.transfer, out_rgb)
        return None

    def close(self) -> None:
        """Release nothing: files are closed after each picture."""


def picture_files(path: str | Path) -> list[Path]:
    """List the pictures of a folder or glob pattern, ordered by the numbers in their names.

    Raises:
        InputError: there is none.
    """
    base = Path(path)
    found = list(base.iterdir()) if base.is_dir() else [Path(name) for name in glob.glob(str(path))]
    files = [file for file in found if file.suffix.lower() in ENDINGS and not file.name.startswith(".")]
    if not files:
        raise InputError(f"no picture at {path}; expected a folder or glob pattern of {', '.join(ENDINGS)}")
    return sorted(files, key=_natural)


def _natural(file: Path) -> tuple[list[tuple[int, int, str]], str]:
    """Return a key that orders 2 before 10."""
    parts = re.split(r"(\d+)", file.stem)
    return [(1, int(part), "") if part.isdigit() else (0, 0, part) for part in parts], file.name
