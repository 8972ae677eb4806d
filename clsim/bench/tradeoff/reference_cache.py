"""Reference events, rendered once and kept on disk."""

from __future__ import annotations

import dataclasses
import os
import tempfile
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np
import numpy.typing as npt

from clsim.bench.tradeoff.content_key import FRAME_ROOMS, code_key, content_key, world_key
from clsim.bench.tradeoff.measure import render_each
from clsim.bench.tradeoff.mismatch import Levels
from clsim.bench.tradeoff.settings import DetectorSetting
from clsim.detect.config import EventRule
from clsim.detect.features import LUMINANCE_WEIGHTS
from clsim.detector import Detector
from clsim.events import EventBatch
from clsim.frames import BASE_PLANES, RADIANCE, Frame
from clsim.opencl.device import Device
from clsim.render import RenderOptions
from clsim.scene import Sensor, World

RULES: tuple[EventRule, ...] = get_args(EventRule)
_NOT_WHOLE = OSError, zipfile.BadZipFile, zlib.error, RuntimeError, ValueError, KeyError, EOFError
"""What numpy, zip and zlib raise of a file that is not there, or damaged."""


@dataclass(frozen=True)
class Reference:
    """What the events should be, by event rule, the brightness they come from, and the time its rendering took [s]."""

    events: dict[EventRule, EventBatch]
    levels: Levels
    cpu_s: float
    wall_s: float


def reference_key(world: World, options: RenderOptions) -> str:
    """Return the key of a reference: of the world, all render options, and the code that turns them into events."""
    return content_key("reference", world_key(world), dataclasses.asdict(options), code_key(FRAME_ROOMS))


def load_or_render(
    world: World, options: RenderOptions, device: Device, folder: Path, on_frame: Callable[[], None]
) -> Reference:
    """Return the reference of a world from ``folder``, or render it, keep it there and return it.

    It is ESIM, of each event rule, on frames of ``options``; ``on_frame`` is called after each frame rendered.
    """
    path = folder / f"reference-{reference_key(world, options)}.npz"
    found = _load(path)
    if found is None:
        found = _render(world, options, device, on_frame)
        _save(path, found)
    return found


def is_kept(world: World, options: RenderOptions, folder: Path) -> bool:
    """Tell whether ``load_or_render`` will not have to render."""
    return (folder / f"reference-{reference_key(world, options)}.npz").exists()


def _render(world: World, options: RenderOptions, device: Device, on_frame: Callable[[], None]) -> Reference:
    width, height = world.camera.width, world.camera.height
    detectors = {
        rule: Detector(
            DetectorSetting("esim", event_rule=rule).config(world.sensor), width, height, BASE_PLANES, device=device
        )
        for rule in RULES
    }
    batches: dict[EventRule, list[EventBatch]] = {rule: [] for rule in RULES}

    levels, times_us = [], []

    def take(frame: Frame) -> None:
        levels.append(log_brightness(frame, world.sensor))
        times_us.append(frame.time_us)
        for rule, detector in detectors.items():
            batches[rule].append(detector.step(frame))
        on_frame()

    try:
        watch = render_each(world, options, take)
    finally:
        for detector in detectors.values():
            detector.close()
    events = {rule: np.concatenate(each) for rule, each in batches.items()}
    return Reference(events, Levels(np.stack(levels), np.array(times_us, np.int64)), watch.cpu_s, watch.wall_s)


def log_brightness(frame: Frame, sensor: Sensor) -> npt.NDArray[np.float32]:
    """Return the level of each pixel as the detector has it, ``[H, W]``: ln max(scale·Y, floor)."""
    luminance = np.tensordot(LUMINANCE_WEIGHTS["rec709"], np.stack([frame.plane(name) for name in RADIANCE]), axes=1)
    return np.log(np.maximum(sensor.scale * luminance, sensor.floor)).astype(np.float32)


def _load(path: Path) -> Reference | None:
    try:
        with np.load(path, allow_pickle=False) as stored:
            cpu_s, wall_s = (float(value) for value in stored["seconds"])
            levels = Levels(stored["levels"], stored["times_us"])
            return Reference({rule: stored[rule] for rule in RULES}, levels, cpu_s, wall_s)
    except _NOT_WHOLE:
        return None  # it will be rendered


def _save(path: Path, reference: Reference) -> None:
    """Write under another name first, so that what has the right name is whole."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        part = Path(folder) / path.name
        arrays: dict[str, Any] = {str(rule): events for rule, events in reference.events.items()}
        arrays |= {"levels": reference.levels.values, "times_us": reference.levels.times_us}
        np.savez_compressed(part, seconds=np.array([reference.cpu_s, reference.wall_s]), **arrays)
        os.replace(part, path)
