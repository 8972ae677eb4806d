"""Recordings as pictures and videos: .png, .gif, .mp4."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.events import EventBatch, Labels
from clsim.events.formats.filesink import PartFile, unwritable
from clsim.live.view.accumulate import EventWindow, IndexImage, cause_indices, colour_indices, signed_image
from clsim.live.view.colormaps import DEFAULT, KINDS, ZERO, Lut, Theme, lut

ENDINGS = (".mp4", ".gif", ".png")
_DECAY_REACH = 5


@dataclass(frozen=True)
class Look:
    """How events become a picture."""

    accumulate_us: int = 33_000
    """Length of the window of each picture or, with ``decay``, the age at which an event has faded to 1/e [µs]."""
    decay: bool = False
    full: float = 2.0
    """Sum of events in a pixel that gets the strongest colour."""
    colours: str = DEFAULT
    """Name of a colour map; KINDS are for batches that have ``labels``."""
    theme: Theme = "dark"
    scale: int = 2
    """Side of a pixel in the picture."""

    @property
    def labels(self) -> Labels:
        """Labels that events must have to be shown so."""
        return ("cause",) if self.colours in KINDS else ()


@dataclass(frozen=True)
class Film:
    """How pictures follow each other."""

    fps: float = 30.0
    speed: float = 1.0
    """Seconds of events that pass in a second of film: 0.1 is slow motion."""


def write_picture(
    path: str, batches: Iterable[EventBatch], size: tuple[int, int], look: Look, film: Film, at_us: int | None = None
) -> int:
    """Write a .mp4 or .gif of all batches, or a .png of the window that ends at ``at_us`` (None: the fullest one).

    Memory is bounded by the events of one window. Returns the number of pictures. The file appears under its name only
    when it is complete.

    Raises:
        InputError: an unknown ending, a missing library, a file that cannot be written, no events, or none that late.
    """
    target = Path(path)
    ending = target.suffix.lower()
    if ending not in ENDINGS:
        raise InputError(f"`to` {path}: the ending is unknown; expected one of {', '.join(ENDINGS)}")
    table = lut(look.colours, look.theme)
    step_us = 1e6 / film.fps * film.speed
    if ending == ".png":
        images: Iterator[IndexImage] = _still(batches, size, look, at_us)
    else:
        images = film_images(batches, size, look, step_us)
    first = next(images, None)
    if first is None:
        raise InputError(f"`to` {path}: there are no events to show")
    with _complete_or_not_at_all(target) as temporary:
        encoder = _ENCODERS[ending](temporary, first.shape, table, film.fps, look.scale)
        count = 0
        with contextlib.closing(encoder):
            for image in _chain(first, images):
                encoder.add(image)
                count += 1
    return count


def film_images(
    batches: Iterable[EventBatch], size: tuple[int, int], look: Look, step_us: float
) -> Iterator[IndexImage]:
    """Yield the picture at the end of each step; the first step begins with the first event."""
    for events, end_us in _windows(batches, look, step_us):
        yield _image(events, end_us, size, look)


def _windows(batches: Iterable[EventBatch], look: Look, step_us: float) -> Iterator[tuple[EventBatch, int]]:
    window = EventWindow(look.labels)
    reach_us = look.accumulate_us * (_DECAY_REACH if look.decay else 1)
    begin_us, count, last_us = None, 0, 0
    for batch in batches:
        if not len(batch):
            continue
        if begin_us is None:
            begin_us = int(batch["t"][0])
        window.push(batch.copy())
        last_us = int(batch["t"][-1])
        while last_us >= (end_us := begin_us + round((count + 1) * step_us)):
            count += 1
            yield window.select(end_us - reach_us, end_us), end_us
    if begin_us is not None and (count == 0 or last_us >= begin_us + round(count * step_us)):
        end_us = begin_us + round((count + 1) * step_us)
        yield window.select(end_us - reach_us, end_us), end_us


def _image(events: EventBatch, end_us: int, size: tuple[int, int], look: Look) -> IndexImage:
    decay_us = float(look.accumulate_us) if look.decay else None
    if look.colours in KINDS:
        return cause_indices(events, *size, look.full, end_us=end_us, decay_us=decay_us)
    return colour_indices(signed_image(events, *size, end_us=end_us, decay_us=decay_us), look.full)


def _still(batches: Iterable[EventBatch], size: tuple[int, int], look: Look, at_us: int | None) -> Iterator[IndexImage]:
    if at_us is not None:
        window = EventWindow(look.labels)
        reach_us = look.accumulate_us * (_DECAY_REACH if look.decay else 1)
        last_us: int | None = None
        for batch in batches:
            last_us = int(batch["t"][-1]) if len(batch) else last_us
            window.push(batch.copy())
            window.select(at_us - reach_us, at_us)  # only to forget what is older
            if len(batch) and batch["t"][-1] >= at_us:
                break
        if last_us is not None and at_us - reach_us > last_us:
            raise InputError(
                f"`at` {at_us * 1e-6:g} s is after the end of the recording, which is {last_us * 1e-6:g} s long"
            )
        yield _image(window.select(at_us - reach_us, at_us), at_us, size, look)
        return
    fullest: tuple[EventBatch, int] | None = None
    for events, end_us in _windows(batches, look, look.accumulate_us):
        if fullest is None or len(events) > len(fullest[0]):
            fullest = events, end_us
    if fullest is not None:
        yield _image(*fullest, size, look)


class _Png:
    def __init__(self, path: Path, shape: tuple[int, ...], table: Lut, fps: float, scale: int) -> None:
        self._path, self._table, self._scale = path, table, scale

    def add(self, image: IndexImage) -> None:
        _palette_image(image, self._table, self._scale).save(self._path, format="png")

    def close(self) -> None:
        pass


class _Gif:
    """Writes picture by picture: Pillow's own writer of animations keeps them all in memory."""

    def __init__(self, path: Path, shape: tuple[int, ...], table: Lut, fps: float, scale: int) -> None:
        from PIL import GifImagePlugin

        self._encode = GifImagePlugin.getdata
        self._table, self._scale = table, scale
        height, width = shape[0] * scale, shape[1] * scale
        if max(width, height) > 0xFFFF:
            raise InputError(
                f"a GIF holds at most 65535 pixels a side, got {width}x{height}; expected a smaller `scale`"
            )
        self._fps, self._count = fps, 0
        self._file: BinaryIO = path.open("wb")
        self._file.write(b"GIF89a" + width.to_bytes(2, "little") + height.to_bytes(2, "little") + b"\xf7\0\0")
        self._file.write(table.tobytes())
        self._file.write(b"\x21\xff\x0bNETSCAPE2.0\x03\x01\0\0\0")  # for ever again

    def add(self, image: IndexImage) -> None:
        # GIF counts hundredths of a second: the end of each picture is rounded, so that errors do not add up.
        ends = [round(100 * k / self._fps) for k in (self._count, self._count + 1)]
        self._count += 1
        picture = _palette_image(image, self._table, self._scale)
        for block in self._encode(picture, duration=10 * (ends[1] - ends[0])):
            self._file.write(block)

    def close(self) -> None:
        self._file.write(b";")
        self._file.close()


class _Mp4:
    def __init__(self, path: Path, shape: tuple[int, ...], table: Lut, fps: float, scale: int) -> None:
        try:
            import av
        except ImportError:
            raise InputError("videos need PyAV: pip install 'clsim[video]', or use `to` NAME.gif") from None
        self._av, self._table, self._scale = av, table, scale
        # 4:2:0 wants even sides: an odd one gets another line of nothing.
        self._pad = [(0, side * scale % 2) for side in shape]
        height, width = (side * scale + pad[1] for side, pad in zip(shape, self._pad, strict=True))
        self._container: Any = av.open(str(path), "w", format="mp4")
        self._stream: Any = self._container.add_stream("libx264", rate=Fraction(fps).limit_denominator(1000))
        self._stream.height, self._stream.width = height, width
        self._stream.pix_fmt = "yuv420p"
        self._stream.options = {"crf": "18", "preset": "fast"}

    def add(self, image: IndexImage) -> None:
        large = np.pad(_enlarge(image, self._scale), self._pad, constant_values=ZERO)
        frame = self._av.VideoFrame.from_ndarray(self._table[large], format="rgb24")
        self._container.mux(self._stream.encode(frame))

    def close(self) -> None:
        self._container.mux(self._stream.encode())
        self._container.close()


_ENCODERS: dict[str, Any] = {".png": _Png, ".gif": _Gif, ".mp4": _Mp4}


def _enlarge(image: IndexImage, scale: int) -> npt.NDArray[np.uint8]:
    return image.repeat(scale, axis=0).repeat(scale, axis=1)


def _palette_image(image: IndexImage, table: Lut, scale: int) -> Any:
    from PIL import Image

    picture = Image.fromarray(_enlarge(image, scale))
    picture.putpalette(table.tobytes())
    return picture


def _chain(first: IndexImage, rest: Iterator[IndexImage]) -> Iterator[IndexImage]:
    yield first
    yield from rest


@contextlib.contextmanager
def _complete_or_not_at_all(target: Path) -> Iterator[Path]:
    part = PartFile(target)
    try:
        yield part.part
        part.complete()
    except OSError as error:
        raise unwritable(target, error) from None
    finally:
        part.discard()
