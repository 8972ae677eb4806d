"""Recordings with truth that are there already, and their way from one layout to another."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.events import EventBatch
from clsim.events.filesink import PartFile
from clsim.truth.layouts import LAYOUTS, LayoutKind, check_place, layout_of
from clsim.truth.record import About, ImuChunk, Shot, TrackChunk

T = TypeVar("T")


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
    with _naming(name):
        found: Recording = kind.load().read_recording(Path(name))
    return found


@contextlib.contextmanager
def _naming(name: str) -> Iterator[None]:
    """Tell of what is wrong with a recording in one sentence."""
    try:
        yield
    except (OSError, KeyError, ValueError, RuntimeError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{name}: is damaged ({error})") from None


def _read(name: str, begin: Callable[[], Iterator[T]]) -> Iterator[T]:
    with _naming(name):
        parts = begin()
    while True:
        with _naming(name):
            part = next(parts, None)
        if part is None:
            return
        yield part


def convert_recording(source: str, target: str) -> tuple[int, tuple[str, ...]]:
    """Write a recording in the layout of another name; returns its events and what the target's layout cannot hold.

    The target is there in the end only if all was well, and a file that stood there stays until then.

    Raises:
        InputError: the source cannot be read, or the target not be written.
        SinkError: the target can no longer be written.
    """
    kind = layout_of(target)
    assert kind is not None, "the caller looked"
    check_place(target)
    recording = read_recording(source)
    names = tuple(name for name in recording.about.names if name in kind.holds)
    about, left = replace(recording.about, names=names), set(recording.about.names) - set(names)
    if kind.folder:
        final = Path(target.rstrip("/"))
        part = final.with_name(f".{final.name}.part")
        shutil.rmtree(part, ignore_errors=True)
        try:
            part.mkdir()
            count = _copy(source, recording, kind, part / final.name, about)  # files may be called as the folder is
            if final.exists():
                final.rmdir()  # it is empty, or check_place had refused it
            (part / final.name).rename(final)
        finally:
            shutil.rmtree(part, ignore_errors=True)
    else:
        beside = PartFile(Path(target), ending=kind.endings[0])
        try:
            count = _copy(source, recording, kind, beside.part, about)
            beside.complete()
        finally:
            beside.discard()
    return count, tuple(sorted(left))


def _copy(source: str, recording: Recording, kind: LayoutKind, path: Path, about: About) -> int:
    layout = kind.load().open_layout(path, about)
    count = 0
    try:
        for batch in _read(source, recording.events):
            if len(batch):
                layout.events(batch, int(batch["t"][-1]))
                count += len(batch)
        for labels in _read(source, recording.labels):
            layout.labels(labels)
        for chunk in _read(source, recording.tracks):
            layout.track(chunk)
        for samples in _read(source, recording.imu):
            layout.imu(samples)
        for shot in _read(source, recording.shots):
            layout.shot(shot)
    finally:
        layout.close()
    return count
