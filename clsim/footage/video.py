"""Video files, through PyAV: each frame at its own time."""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any

from clsim.errors import InputError
from clsim.footage.pixels import TOLD_OF_PICTURES, PixelFormat, pixel_format, to_light
from clsim.footage.source import AS_TOLD, Footage, Reading, check_size, whole_us
from clsim.footage.upright import Lie, of_frame
from clsim.footage.wholeness import cut_end
from clsim.frames import SourceEnded
from clsim.frames.frame import FloatArray, page_aligned

_PICTURE_CODECS = ("gif", "apng", "png", "webp", "bmp", "targa")
_TEXT_CODECS = ("ansi", "bintext", "idf", "xbin")
"""Those that draw letters: libav shows any text, and so a recording of events in text, as a film of its characters."""
_UNTOLD = (0, 2, 3)
_COVER = 1 << 10
"""libav's mark of a stream that is a cover."""
_TELLING = {"matroska", "mp4", "avi", "flv", "asf"}
"""Containers whose header tells how long they are; of others libav finds it by their size."""
_END_MARKS = {"gif": b";", "apng": b"IEND"}
_CUT_FRAMES = 1.5
"""So many frames must be missing: headers are not exact."""
_LATE_IN_FLV = 2
"""Frames by which the first that is shown may follow the first that is decoded, from which FLV counts its length."""


class Video(Footage):
    """A video file. Its times are those of its stream, from the first frame on; rates may vary."""

    def __init__(self, path: str | Path, reading: Reading = AS_TOLD) -> None:
        """Open the file and decode its first frame.

        Raises:
            InputError: PyAV is missing, or the file is no video that it reads.
        """
        where = str(path)
        self._container = open_media(where)
        self._frames: Iterator[Any] = iter(())
        try:
            first, self._frames = first_frame(self._container, where)
            self._first: Any = first
            self._kind: PixelFormat = pixel_format(first, where)
            self._lie = of_frame(first)
            stored = (first.width, first.height)
            size = self._lie.size(*stored)
            stream = self._container.streams.video[0]
            chosen, warnings = reading.transfer or self._kind.transfer, tuple[str, ...]()
            of_pictures = reading.transfer is None and stream.codec_context.name in _PICTURE_CODECS
            if of_pictures and chosen not in TOLD_OF_PICTURES:
                chosen = "srgb"
            if chosen is None:
                chosen, number = "bt709", int(first.color_trc)
                told = "does not tell its transfer function"
                if number not in _UNTOLD:
                    told = f"has the transfer function {number} of H.273, which is not known"
                warnings = (f"{where} {told}: taken as bt709; see `transfer`",)
            warnings = (*warnings, *_doubts(where, self._container, first))
            super().__init__(where, size, self._kind.steps, chosen, reading, warnings)
        except BaseException:
            self.close()
            raise
        self._stored = stored
        self._scratch = page_aligned((3, stored[1], stored[0])) if self._lie != Lie() else None
        self._own_fps = float(stream.average_rate or self.fps)
        if reading.fps is None and stream.average_rate:
            self.fps = float(stream.average_rate)
        start = time_of(first)
        self._start = start if start is not None and start < 0 else Fraction(0)
        self._told_end = told_end(self._container)
        self._end = Fraction(0)
        self._damaged: int | None = None

    def _read(self, index: int, out_rgb: FloatArray) -> int | None:
        frame, self._first = self._first, None
        if frame is None:
            with naming_media(self._where):
                frame = next(self._frames, None)
        if frame is None:
            self._check_end()
            raise SourceEnded
        if (frame.width, frame.height, frame.format.name) != (*self._stored, self._kind.name):
            raise InputError(
                f"{self._where}: frame {index} has {frame.width}×{frame.height} pixels as {frame.format.name}, "
                f"expected {self._stored[0]}×{self._stored[1]} as {self._kind.name} of the first"
            )
        if self._scratch is None:
            to_light(frame, self._kind, self.transfer, out_rgb)
        else:
            to_light(frame, self._kind, self.transfer, self._scratch)
            out_rgb[...] = self._lie.upright(self._scratch)
        if self._damaged is None and frame.is_corrupt:
            self._damaged = index
        time_s = time_of(frame)
        if time_s is not None:
            self._end = max(self._end, time_s + (getattr(frame, "duration", 0) or 0) * (frame.time_base or 0))
        return None if time_s is None else whole_us(time_s - self._start)

    def _check_end(self) -> None:
        """Raise InputError where the file ends before its header says, for it was cut, or has a damaged frame."""
        mark = _END_MARKS.get(self._container.format.name)
        if mark is not None and not _ends_with(self._where, mark):
            raise InputError(
                f"{self._where}: ends at {float(self._end):.3f} s without its end mark; expected a whole file"
            )
        end_s = float(self._end)
        told_s = end_s if self._told_end is None else float(self._told_end)
        missing = (told_s - end_s) * self._own_fps
        if missing > _CUT_FRAMES + (_LATE_IN_FLV if self._container.format.name == "flv" else 0):
            raise InputError(
                f"{self._where}: ends at {end_s:.3f} s, but its header tells {told_s:.3f} s: some {round(missing)} "
                "frames are missing; expected a whole video"
            )
        if cut := cut_end(self._where, self._container.format.name):
            raise InputError(f"{self._where}: ends at {end_s:.3f} s and {cut}; expected a whole video")
        if self._damaged is not None:
            raise InputError(
                f"{self._where}: frame {self._damaged} is damaged, and what follows may be too; expected a whole video"
            )

    def close(self) -> None:
        """Release the file; safe to call twice."""
        self._container.close()


def _doubts(where: str, container: Any, first: Any) -> Iterator[str]:
    """Yield what users should know of a file and its first frame."""
    if (films := sum(map(_is_film, container.streams.video))) > 1:
        yield f"{where} holds {films} films, of which the first is read"
    if first.interlaced_frame:
        yield f"{where} is interlaced: lines of two times are taken as of one; deinterlace it"
    shape = container.streams.video[0].sample_aspect_ratio or 1
    if shape != 1:
        told = f"has pixels of {shape.numerator}:{shape.denominator}, and is taken as stored"
        yield f"{where} {told}: squeeze or stretch it first"


def _is_film(stream: Any) -> bool:
    """Tell whether a stream is no cover; older PyAV knows none."""
    return not getattr(getattr(stream, "disposition", None), "value", 0) & _COVER


def _ends_with(where: str, mark: bytes) -> bool:
    """Tell whether the end of a file has a mark; zeros and a checksum may follow it."""
    with Path(where).open("rb") as file:
        file.seek(max(0, file.seek(0, 2) - 64))
        end = file.read().rstrip(b"\0\r\n")
    return mark in end[-len(mark) - 4 :]


def told_end(container: Any) -> Fraction | None:
    """Return when the video of an open file ends [s], as its header tells; None where it tells nothing certain."""
    if not _TELLING & set(container.format.name.split(",")):
        return None
    stream, ends = container.streams.video[0], list[Fraction]()
    tag = re.fullmatch(r"(\d+):(\d\d):(\d\d(?:\.\d+)?)", stream.metadata.get("DURATION", ""))
    if stream.duration:
        ends.append(((stream.start_time or 0) + stream.duration) * stream.time_base)
    elif tag is not None:
        ends.append(3600 * int(tag[1]) + 60 * int(tag[2]) + Fraction(tag[3]))
    if container.duration and (ends or len(container.streams) == 1):
        ends.append(Fraction((container.start_time or 0) + container.duration, 1_000_000))
    return min(ends, default=None)


def open_media(where: str) -> Any:
    """Open a file with PyAV; raises InputError where that cannot be."""
    if importlib.util.find_spec("av") is None:
        raise InputError(f"{where}: video and pictures need PyAV; install it with: pip install 'clsim[video]'")
    import av

    if not Path(where).is_file():
        raise InputError(f"{where}: there is no such file")
    with naming_media(where):
        container = av.open(where, metadata_errors="replace")
    if not container.streams.video:
        container.close()
        raise InputError(f"{where}: holds no video")
    if getattr(container.streams.video[0], "codec_context", None) is None:
        container.close()
        raise InputError(f"{where}: cannot be decoded (its codec is not known)")
    if container.streams.video[0].codec_context.name in _TEXT_CODECS:
        container.close()
        raise InputError(f"{where}: holds text, expected a video")
    container.streams.video[0].thread_type = "AUTO"
    return container


def first_frame(container: Any, where: str) -> tuple[Any, Iterator[Any]]:
    """Return the first frame of an open file and an iterator of the others; raises InputError where there is none."""
    stream = container.streams.video[0]
    check_size(where, stream.codec_context.width or 1, stream.codec_context.height or 1)
    frames = container.decode(stream)
    with naming_media(where):
        first = next(frames, None)
    if first is None:
        raise InputError(f"{where}: holds no frame")
    return first, frames


@contextmanager
def naming_media(where: str) -> Iterator[None]:
    """Turn what PyAV raises into an InputError that names the file."""
    import av

    try:
        yield
    except (av.FFmpegError, EOFError, ValueError) as error:
        raise InputError(f"{where}: cannot be decoded ({getattr(error, 'strerror', None) or error})") from None


def time_of(frame: Any) -> Fraction | None:
    """Return a frame's own time [s], exactly; None where it has none."""
    return None if frame.pts is None or frame.time_base is None else Fraction(frame.pts * frame.time_base)
