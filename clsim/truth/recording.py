"""Recordings with truth that are there already, and their way from one layout to another."""

from __future__ import annotations

import shutil
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError, Notice
from clsim.events import EventBatch
from clsim.events.formats.filesink import PartFile
from clsim.events.formats.filesource import EventSource, naming_damage
from clsim.truth.layouts import LAYOUTS, LayoutKind, check_place, layout_of
from clsim.truth.record import About, ImuChunk, Shot, TrackChunk

T = TypeVar("T")
_LARGEST_SIDE = 1 << 16


@dataclass(frozen=True)
class Recording:
    """What a layout holds, read as it is wanted.

    Attributes:
        about: what holds for all of it; ``names`` tells what there is.
        events, labels, shots, tracks, imu: functions that begin to read, in the order of time and in bounded memory.
    """

    about: About
    events: Callable[[], Iterator[EventBatch]]
    labels: Callable[[], Iterator[npt.NDArray[np.void]]] = lambda: iter(())
    shots: Callable[[], Iterator[Shot]] = lambda: iter(())
    tracks: Callable[[], Iterator[TrackChunk]] = lambda: iter(())
    imu: Callable[[], Iterator[ImuChunk]] = lambda: iter(())


def recording_kind(name: str) -> LayoutKind | None:
    """Return the layout of a recording with truth that is there; None for event files and what is not there."""
    kind, path = layout_of(name), Path(name)
    if kind is None or not path.exists() or path.is_dir() != kind.folder:
        return None
    is_one: Callable[[Path], bool] = kind.load().is_recording
    return kind if is_one(path) else None


def read_recording(name: str) -> Recording:
    """Open a recording; raises InputError where it is none, or damaged."""
    kind = recording_kind(name)
    if kind is None:
        endings = ", ".join(ending for each in LAYOUTS for ending in each.endings)
        raise InputError(f"{name}: is no recording with truth; expected one that ends in {endings}")
    path = Path(name)
    with naming_damage(path):
        found: Recording = kind.load().read_recording(path)
        width, height = found.about.width, found.about.height
        if not (0 < width <= _LARGEST_SIDE and 0 < height <= _LARGEST_SIDE):
            raise ValueError(f"its sensor has {width}x{height} pixels")
    return Recording(
        found.about,
        lambda: _named_events(path, found.events),
        _named(path, found.labels),
        _named(path, lambda: _of_size(found.shots(), (height, width))),
        _named(path, found.tracks),
        _named(path, found.imu),
    )


def _named(path: Path, begin: Callable[[], Iterator[T]]) -> Callable[[], Iterator[T]]:
    """Return a function that reads as ``begin`` does, and tells in one sentence what is wrong with the recording."""

    def parts() -> Iterator[T]:
        with naming_damage(path):
            inner = begin()
        while True:
            with naming_damage(path):
                part = next(inner, None)
            if part is None:
                return
            yield part

    return parts


def _named_events(path: Path, begin: Callable[[], Iterator[EventBatch]]) -> Iterator[EventBatch]:
    with naming_damage(path):
        events = begin()
    # A source names itself, and counts what it leaves out.
    return events if isinstance(events, EventSource) else _named(path, lambda: events)()


def _of_size(shots: Iterator[Shot], size: tuple[int, int]) -> Iterator[Shot]:
    """Yield shots; raises ValueError where a plane is not of the sensor's size."""
    for shot in shots:
        for name, plane in shot.planes.items():
            if plane.shape[:2] != size:
                raise ValueError(f"{name} at {shot.time_us} µs is {list(plane.shape)}, expected {list(size)}")
        yield shot


def convert_recording(source: str, target: str, *, strict: bool = False) -> tuple[int, tuple[str, ...]]:
    """Write a recording in the layout of another name; returns its events and what the target's layout cannot hold.

    The target is there in the end only if all was well, and a file that stood there stays until then. ``strict``
    refuses events that are out of order, or whose end is missing; else a Notice tells of the former.

    Raises:
        InputError: the source cannot be read, or the target not be written.
        SinkError: the target can no longer be written.
    """
    kind = layout_of(target)
    assert kind is not None, "the caller looked"
    check_place(target)
    recording = read_recording(source)
    events = recording.events()
    if strict and isinstance(events, EventSource):
        events.be_strict()
    recording = replace(recording, events=lambda: events)
    names = tuple(name for name in recording.about.names if name in kind.holds)
    about, left = replace(recording.about, names=names), set(recording.about.names) - set(names)
    if kind.folder:
        final = Path(target.rstrip("/"))
        part = final.with_name(f".{final.name}.part")
        shutil.rmtree(part, ignore_errors=True)
        try:
            part.mkdir()
            count = _copy(recording, kind, part / final.name, about)  # files may be called as the folder is
            if final.exists():
                final.rmdir()  # it is empty, or check_place had refused it
            (part / final.name).rename(final)
        finally:
            shutil.rmtree(part, ignore_errors=True)
    else:
        beside = PartFile(Path(target), ending=kind.endings[0])
        try:
            count = _copy(recording, kind, beside.part, about)
            beside.complete()
        finally:
            beside.discard()
    if isinstance(events, EventSource) and (events.moved_events or events.dropped_events):
        told = f"{events.moved_events:,} events came after later ones, {events.dropped_events:,} were left out"
        warnings.warn(f"{source}: {told}", Notice, stacklevel=2)
    return count, tuple(sorted(left))


def _copy(recording: Recording, kind: LayoutKind, path: Path, about: About) -> int:
    layout = kind.load().open_layout(path, about)
    count = 0
    try:
        for batch in recording.events():
            if len(batch):
                layout.events(batch, int(batch["t"][-1]))
                count += len(batch)
        for labels in recording.labels():
            layout.labels(labels)
        for chunk in recording.tracks():
            layout.track(chunk)
        for samples in recording.imu():
            layout.imu(samples)
        for shot in recording.shots():
            layout.shot(shot)
    finally:
        layout.close()
    return count
