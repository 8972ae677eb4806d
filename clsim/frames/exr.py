"""EXR sequences in and out, one file a frame, streamed: memory does not grow with the sequence."""

from __future__ import annotations

import contextlib
import glob
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.frames.exr_read import held_pixels, read_channels
from clsim.frames.frame import FloatArray, Frame, frame_time_us, page_aligned
from clsim.frames.layouts import FAR_M, POSITION, Layout, recognise
from clsim.frames.planes import COVERAGE, DEPTH
from clsim.frames.positions import Space, camera_matrix, depth_of, position_space
from clsim.version import VERSION


class ExrSequence:
    """Frames from the EXR files of a folder or a glob pattern; a `FrameSource`.

    Files are ordered by the last number in their names. The layout (see `clsim.frames.layouts`) is recognised from
    the first file and every file must have it. A frame is what the display window shows; where a file's data window
    holds no pixels, it is black. NaN and infinite pixels pass through: the detector masks them.

    Attributes:
        width: number of pixel columns.
        height: number of pixel rows.
        names: planes that every frame has.
        frame_count: number of files.
        layout: the layout's name.
        files: the files, in order.
    """

    def __init__(self, path: str | Path, fps: float | None = None, planes: Sequence[str] | None = None) -> None:
        """Open the sequence at ``path``, a folder (its ``*.exr``), a glob pattern or one file.

        Frame k is at k/``fps``; without ``fps``, at the times that our own files carry. ``planes`` asks for planes by
        name; None takes all that the files give.

        Raises:
            InputError: no file, a gap in the numbering, several sequences mixed, an unreadable file, a layout that is
                not known, a plane that is not there, or no ``fps`` and no times.
        """
        if fps is not None and not 0 < fps < float("inf"):
            raise InputError(f"fps must be a positive number, got {fps}")
        self.files = _sequence_files(path)
        self.frame_count: int | None = len(self.files)
        self._fps = fps
        channels, header = read_channels(self.files[0])
        self._layout: Layout = recognise(channels, str(self.files[0]))
        self.layout = self._layout.name
        self.height, self.width = next(iter(channels.values())).shape  # of the display window, as all channels are
        self._space: Space | None = None
        if self._layout.has_position:
            self._space = position_space(_positions(channels, self._layout), camera_matrix(header))
        # Denoising must not mix what was seen with the black around it.
        tells = COVERAGE[0] in self._layout.planes(with_depth=True)
        self._tells_held = not tells and not held_pixels(header).all()
        if self._tells_held:
            self._layout = replace(self._layout, channels={**self._layout.channels, COVERAGE[0]: COVERAGE[0]})
        given = self._layout.planes(with_depth=self._space is not None)
        for plane in planes or ():
            if plane not in given:
                why = ""
                if plane in DEPTH and self._layout.has_position:
                    why = ", and its positions fit no perspective camera"
                raise InputError(f"{self.files[0]} has no plane {plane!r}{why}; its planes are {', '.join(given)}")
        self.names: tuple[str, ...] = given if planes is None else tuple(planes)
        if fps is None and "time_us" not in header:
            raise InputError(f"{self.files[0]} carries no time; give the frame rate (fps)")

    @property
    def recorded_fps(self) -> float:
        """Frame rate by the times that the first two files carry; 1 where there is one file."""
        if len(self.files) < 2:
            return 1.0
        first, second = (_header_time_us(read_channels(file)[1], file) for file in self.files[:2])
        if second <= first:
            raise InputError(f"{self.files[1]} is at {second} µs, expected later than {first} µs of the file before")
        return 1e6 / (second - first)

    def fill(self, index: int, out: Frame) -> None:
        """Read frame ``index`` into ``out``, whose planes must be ``names``.

        Raises:
            InputError: the file is unreadable or truncated, has another resolution, or lacks a channel.
        """
        if out.names != self.names:
            raise ValueError(f"the frame has the planes {out.names}, expected {self.names}")
        file = self.files[index]
        channels, header = read_channels(file)
        if self._tells_held:
            channels[COVERAGE[0]] = held_pixels(header)
        for channel in self._layout.channels.values():
            if channel not in channels:
                raise InputError(f"{file} has no channel {channel!r}, which {self.files[0].name} has")
            height, width = channels[channel].shape
            if (height, width) != (self.height, self.width):
                raise InputError(
                    f"{file} has {width}×{height} pixels, but {self.files[0].name} has {self.width}×{self.height}"
                )
        self._convert(channels, header, out)
        out.index = index
        out.time_us = frame_time_us(index, self._fps) if self._fps is not None else _header_time_us(header, file)

    def _convert(self, channels: Mapping[str, npt.NDArray[Any]], header: Mapping[str, Any], out: Frame) -> None:
        depth: npt.NDArray[Any] | None = None
        if self._space is not None:
            matrix = camera_matrix(header)
            depth = depth_of(_positions(channels, self._layout), self._space, matrix)
        elif DEPTH[0] in self._layout.channels:
            depth = channels[self._layout.channels[DEPTH[0]]]
        missed = self._missed(channels, depth)
        for name in out.names:
            target = out.plane(name)
            if name in DEPTH and depth is not None:
                target[...] = depth if missed is None else np.where(missed, 0.0, depth)
            elif name in COVERAGE and missed is not None:
                target[...] = ~missed
            else:
                target[...] = channels[self._layout.channels[name]]

    def _missed(
        self, channels: Mapping[str, npt.NDArray[Any]], depth: npt.NDArray[Any] | None
    ) -> npt.NDArray[np.bool_] | None:
        if self._layout.miss == "zero position":
            return np.asarray((_positions(channels, self._layout) == 0).all(axis=0))
        if self._layout.miss == "none" or depth is None:
            return None
        if self._layout.miss == "zero depth":
            return np.asarray(depth == 0)
        return np.asarray((depth >= FAR_M) | np.isposinf(depth))

    def close(self) -> None:
        """Release what the source holds: nothing, files are closed after each read."""

    def __iter__(self) -> Iterator[Frame]:
        """Yield every frame in its own memory."""
        for index in range(len(self.files)):
            frame = Frame(page_aligned((len(self.names), self.height, self.width)), self.names)
            self.fill(index, frame)
            yield frame


class ExrWriter:
    """Writes frames as ``frame_0000.exr`` … of float32 channels named as the planes, ZIP-compressed.

    Each file carries ``time_us`` (as text: int64 does not fit an EXR integer), ``index`` and ``clsim_version``, and
    gets its name only once it is complete.
    """

    def __init__(self, folder: str | Path) -> None:
        """Prepare to write into ``folder``, which is made if need be.

        Raises:
            InputError: the folder cannot be made or written, or holds EXR files already.
        """
        self.folder = Path(folder)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"cannot make the folder {self.folder}: {error.strerror}") from None
        if not os.access(self.folder, os.W_OK):
            raise InputError(f"cannot write into the folder {self.folder}: permission denied")
        existing = next(self.folder.glob("*.exr"), None)
        if existing is not None:
            raise InputError(f"the folder {self.folder} holds EXR files already, such as {existing.name}")

    def write(self, frame: Frame) -> Path:
        """Write one frame and return its file.

        Raises:
            InputError: the file cannot be written.
        """
        import OpenEXR

        target = self.folder / f"frame_{frame.index:04d}.exr"
        partial = self.folder / f".{target.name}.{os.getpid()}.part"
        header = {
            "compression": OpenEXR.ZIP_COMPRESSION,
            "type": OpenEXR.scanlineimage,
            "time_us": str(frame.time_us),
            "index": frame.index,
            "clsim_version": VERSION,
        }
        channels = {name: np.ascontiguousarray(frame.plane(name)) for name in frame.names}
        try:
            with OpenEXR.File(header, channels) as file:
                file.write(str(partial))
            os.replace(partial, target)
        except (OSError, RuntimeError) as error:
            with contextlib.suppress(OSError):
                partial.unlink()
            raise InputError(f"cannot write {target}: {error}") from None
        return target


def _sequence_files(path: str | Path) -> list[Path]:
    """List the files of a sequence in the order of their numbers."""
    base = Path(path)
    found = sorted(base.glob("*.exr")) if base.is_dir() else [Path(name) for name in sorted(glob.glob(str(path)))]
    if not found and base.is_file():
        found = [base]
    if not found and not glob.has_magic(str(path)) and not base.exists():
        raise InputError(f"{path}: no such file or folder; expected a folder of *.exr files or a glob pattern")
    if not found:
        lacking = "no EXR file is in" if base.is_dir() else "no file is named as"
        raise InputError(f"{lacking} {path}; expected a folder of *.exr files or a glob pattern")
    if len(found) == 1:
        return found
    numbered: dict[int, Path] = {}
    stem: str | None = None
    for file in found:
        match = re.match(r"(.*?)(\d+)(\D*)$", file.stem)
        if match is None:
            raise InputError(f"{file} has no frame number in its name, as the other files of a sequence have")
        around = f"{match[1]}#{match[3]}"
        if stem is not None and around != stem:
            raise InputError(f"{path} holds more than one sequence: {stem} and {around}; choose with a glob pattern")
        stem = around
        number = int(match[2])
        if number in numbered:
            raise InputError(f"{file} has the same frame number as {numbered[number].name}")
        numbered[number] = file
    numbers = sorted(numbered)
    for before, after in pairwise(numbers):
        if after != before + 1:
            raise InputError(f"frame {before + 1} is missing: {numbered[after]} follows {numbered[before].name}")
    return [numbered[number] for number in numbers]


def _positions(channels: Mapping[str, npt.NDArray[Any]], layout: Layout) -> FloatArray:
    return np.stack([channels[layout.channels[name]] for name in POSITION]).astype(np.float32)


def _header_time_us(header: Mapping[str, Any], file: Path) -> int:
    try:
        return int(header["time_us"])
    except (KeyError, ValueError):
        raise InputError(f"{file} carries no valid time: time_us is {header.get('time_us')!r}") from None
