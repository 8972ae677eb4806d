"""Pictures that follow each other on a texture, as on a screen: numbered files, or a video."""

from __future__ import annotations

import glob
import importlib.util
import itertools
import math
import re
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from clsim.errors import InputError
from clsim.scene.files import named_file
from clsim.scene.pictures.images import F64, U8, PixelBudget, decode_srgb, encode_srgb8, read_texture

VIDEO_ENDINGS = (".mp4", ".mkv", ".mov", ".webm", ".avi", ".m4v", ".gif")
MAX_PICTURES = 1_000_000
MOST_IN_A_MEAN = 64
"""Pictures of which the mean over an exposure is taken; where there are more, so many of them, evenly spread."""
KEPT = 4
"""Pictures in memory: what is traced between frames goes back and forth between a few."""
_EDGE = 1e-6
"""Share of a picture's time by which the next one counts as there: times of frames are rounded."""


class Pictures(Protocol):
    """Pictures by number."""

    count: int

    def read(self, number: int) -> U8:
        """Return a picture, uint8 ``[h, w, 4]`` RGBA; all have one size. Raises InputError where it is damaged."""
        ...


class Film:
    """Pictures in time: each is shown until the next, and the last for as long.

    Attributes:
        fps: pictures per second.
        loop: whether they start anew after the last; else that stays.
        first: the first of them, uint8 ``[h, w, 4]``.
    """

    def __init__(self, pictures: Pictures, fps: float, *, loop: bool) -> None:
        """Take pictures; only the last that were shown are in memory."""
        self.fps, self.loop = fps, loop
        self._pictures = pictures
        self.first = pictures.read(0)
        self._kept: dict[int, U8] = {0: self.first}
        self._lock = threading.Lock()

    @property
    def duration_s(self) -> float:
        """When the last picture has been shown [s]; 0 where all start anew then."""
        return 0.0 if self.loop else self._pictures.count / self.fps

    @property
    def least_fps(self) -> float:
        """Frames per second below which some pictures are not seen."""
        return self.fps if self._pictures.count > 1 else 0.0

    def shown(self, start_s: float, end_s: float) -> list[tuple[int, float]]:
        """Return the numbers of the pictures that are shown in a time [s], and for which share of it each.

        Where both times are one, the one picture of then.
        """
        start, end = start_s * self.fps, end_s * self.fps
        first, last = math.floor(start + _EDGE), math.ceil(end - _EDGE) - 1
        if last <= first:
            return [(self._number(first), 1.0)]
        if last - first >= MOST_IN_A_MEAN:
            middles = start + (end - start) * (np.arange(MOST_IN_A_MEAN) + 0.5) / MOST_IN_A_MEAN
            return [(self._number(math.floor(at)), 1.0 / MOST_IN_A_MEAN) for at in middles.tolist()]
        spans = [(k, min(end, k + 1) - max(start, k)) for k in range(first, last + 1)]
        return [(self._number(k), span / (end - start)) for k, span in spans]

    def picture(self, shown: list[tuple[int, float]]) -> U8:
        """Return the mean light of pictures with those shares, uint8 ``[h, w, 4]`` with sRGB's curve."""
        if len(shown) == 1:
            return self._read(shown[0][0])
        light: F64 = np.zeros((*self.first.shape[:2], 3))
        for number, share in shown:
            light += share * _LIGHT[self._read(number)[..., :3]]
        return np.concatenate([encode_srgb8(light), self.first[..., 3:]], axis=2)

    def _number(self, number: int) -> int:
        count = self._pictures.count
        return number % count if self.loop else min(max(number, 0), count - 1)

    def _read(self, number: int) -> U8:
        with self._lock:  # a video has one place at a time
            if number not in self._kept:
                picture = self._pictures.read(number)
                while len(self._kept) >= KEPT:
                    del self._kept[next(iter(self._kept))]
                self._kept[number] = picture
            return self._kept[number]


_LIGHT = decode_srgb(np.arange(256) / 255.0)


class Files:
    """Pictures in files."""

    def __init__(self, pattern: str, folder: Path, budget: PixelBudget) -> None:
        """Find the files of a pattern such as ``screen/*.png``, in the order of the numbers in their names.

        Raises:
            InputError: there is none.
        """
        # A pattern may match whatever is on the disk: no more names are kept than may be used.
        every = glob.iglob(str(named_pattern(pattern, folder)))
        found = sorted(itertools.islice(every, MAX_PICTURES + 1), key=_by_number)
        if not found or len(found) > MAX_PICTURES:
            many = f"more than {MAX_PICTURES}" if found else "0"
            raise InputError(f"{many} files are called {pattern!r} in {folder}, expected 1 to {MAX_PICTURES}")
        self._paths, self.count = [named_file(each, folder) for each in found], len(found)
        self._size: tuple[int, ...] = ()
        self._budget = budget

    def read(self, number: int) -> U8:
        """Return a picture; raises InputError where it is damaged, or of another size than the first."""
        # One picture after the other is in memory: only the first one counts among all images.
        pixels = read_texture(self._paths[number], PixelBudget() if self._size else self._budget)
        self._size = self._size or pixels.shape[:2]
        if pixels.shape[:2] != self._size:
            (height, width), (h, w) = pixels.shape[:2], self._size
            raise InputError(f"{self._paths[number]}: is {width}×{height}, expected {w}×{h} as the first")
        return pixels


class Video:
    """Pictures of a video file, decoded as they are asked for; one by one is fast, and back is from the start again.

    Attributes:
        fps: the file's own mean number of pictures per second.
    """

    def __init__(self, path: Path, budget: PixelBudget) -> None:
        """Count the pictures, without decoding them.

        Raises:
            InputError: the library is missing, or the file is no video.
        """
        if importlib.util.find_spec("av") is None:
            raise InputError(f"{path}: video needs PyAV; install it with: pip install 'clsim[video]'")
        self._path = path
        self._frames: Iterator[Any] = iter(())
        with self._opened() as container:
            stream = container.streams.video[0]
            self.fps = float(stream.average_rate or 0)
            self._size = stream.codec_context.width, stream.codec_context.height
            budget.take(str(path), *self._size)
            self.count = self._told(lambda: sum(packet.size > 0 for packet in container.demux(stream)))
        if not (self.count and self.fps > 0 and min(self._size) > 0):
            raise InputError(f"{path}: holds no pictures, or does not tell how many a second")
        self._next = self.count
        self._frame: Any = None

    def read(self, number: int) -> U8:
        """Return a picture; where the file has fewer than it tells, its last one."""
        if number < self._next:
            self._frames, self._next = self._decoded(), 0
        while self._next <= number:
            frame = self._told(lambda: next(self._frames, None))
            if frame is None:
                if self._next == 0:
                    raise InputError(f"{self._path}: holds no picture that can be decoded")
                break
            self._next, self._frame = self._next + 1, frame
        pixels: U8 = self._told(lambda: self._frame.reformat(*self._size, format="rgba").to_ndarray())
        return pixels

    def _decoded(self) -> Iterator[Any]:
        with self._opened() as container:
            yield from container.decode(container.streams.video[0])

    def _opened(self) -> Any:
        import av

        container = self._told(lambda: av.open(str(self._path), metadata_errors="replace"))
        if not container.streams.video:
            container.close()
            raise InputError(f"{self._path}: holds no video")
        return container

    def _told(self, work: Callable[[], Any]) -> Any:
        """Do what the library may stumble over."""
        import av

        try:
            return work()
        except (av.FFmpegError, EOFError, ValueError) as error:
            raise InputError(f"{self._path}: cannot be decoded ({getattr(error, 'strerror', None) or error})") from None


def is_video(name: str) -> bool:
    """Tell by its name whether a file is a video."""
    return name.lower().endswith(VIDEO_ENDINGS)


def named_pattern(pattern: str, folder: Path) -> Path:
    """Return the pattern of files that a scene names; raises InputError where it is an address."""
    if re.match(r"[A-Za-z][A-Za-z0-9+.-]+:", pattern) or "\0" in pattern:
        raise InputError(f"{pattern!r} is no pattern of files, expected one such as folder/*.png, relative to {folder}")
    return Path(glob.escape(str(folder))) / pattern


def _by_number(path: str) -> list[tuple[int, int, str]]:
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in re.split(r"(\d+)", path)]
