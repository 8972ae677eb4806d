"""A recording made up of numbers: all that a layout may be handed."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from clsim.events import EVENT_DTYPE
from clsim.live.outputs.sidecars import about_camera
from clsim.scene import Camera, Static
from clsim.scene.motion import Orbit
from clsim.scene.world import Lens
from clsim.truth.kinematics import Imu, track
from clsim.truth.labels import LABEL_DTYPE
from clsim.truth.names import TRUTH_NAMES
from clsim.truth.record import About, ImuChunk, ImuNoise, Layout, Shot, TrackChunk

WIDTH, HEIGHT, STEP_US, SHOTS = 24, 16, 33_333, 4
GRAVITY = (0.0, -9.80665, 0.0)
ORBIT = Orbit((0.0, 1.0, 0.0), 2.0, 1.5, target=(0.0, 1.2, 0.3))
BALL = Orbit((1.0, 0.0, 0.0), 0.5, 0.7)


def about(lens: Lens | None = None, **more: Any) -> About:
    camera = Camera(WIDTH, HEIGHT, 60.0, Static(np.eye(4)), 0.0, lens or Lens())
    facts: dict[str, Any] = {
        "names": tuple(TRUTH_NAMES),
        "frame_rate": 30.0,
        "objects": ("floor", "ball"),
        "materials": ("grey",),
        "object_poses": np.array([[0, 0, 0, 0, 0, 0, 1], [1.0, 0, 0.5, 0, 0, 0, 1]]),
        "moving": ("ball",),
        "imu_rate": 1000.0,
    }
    return About(WIDTH, HEIGHT, about_camera(camera), **(facts | more))


@dataclass
class Given:
    """What was handed over."""

    events: np.ndarray
    labels: np.ndarray
    shots: list[Shot] = field(default_factory=list)
    tracks: dict[str, TrackChunk] = field(default_factory=dict)
    imu: ImuChunk | None = None


def shot(number: int, event_index: int, rng: np.random.Generator) -> Shot:
    """A frame of random numbers; depth is infinite and flow invalid where nothing is seen."""
    size = (HEIGHT, WIDTH)
    depth = rng.uniform(1.0, 20.0, size).astype(np.float32)
    nothing = rng.random(size) < 0.1
    depth[nothing] = np.inf
    flow = rng.normal(0, 5, (*size, 4)).astype(np.float32)
    flow[..., 2] = ~nothing
    flow[..., 3] = (rng.random(size) < 0.8) & ~nothing
    ids = rng.integers(1, 3, size).astype(np.float32)
    intensity = rng.uniform(0, 3, size).astype(np.float32)
    return Shot(
        number * STEP_US,
        (number - 1) * STEP_US,
        (number + 1) * STEP_US,
        event_index,
        {
            "intensity": intensity,
            "image": (85 * intensity).astype(np.uint8),
            "depth": depth,
            "distance": depth * np.float32(1.1),
            "normal": rng.normal(size=(*size, 3)).astype(np.float32),
            "albedo": rng.random((*size, 3)).astype(np.float32),
            "object": np.where(nothing, 0, ids),
            "material": np.where(nothing, 0, np.float32(1)),
            "flow": flow,
            "backward-flow": -flow * np.array([1, 1, -1, -1], np.float32),
        },
    )


def feed(layout: Layout, seed: int = 0, close: bool = True) -> Given:
    """Hand a recording to a layout, step by step."""
    rng = np.random.default_rng(seed)
    count = 500
    events = np.zeros(count, EVENT_DTYPE)
    events["t"] = rng.integers(0, (SHOTS - 1) * STEP_US, count)
    events["t"][:2] = STEP_US, 2 * STEP_US  # of a frame's own time
    events["t"].sort()
    events["x"], events["y"] = rng.integers(0, WIDTH, count), rng.integers(0, HEIGHT, count)
    events["on"] = rng.random(count) < 0.4
    labels = np.zeros(count, LABEL_DTYPE)
    labels["object"], labels["flow"] = rng.integers(0, 3, count), rng.normal(0, 100, (count, 2))
    labels["cause"] = np.arange(count) % 4
    given = Given(events, labels)
    imu = Imu(ORBIT, 1000.0, ImuNoise(), GRAVITY, 0)
    chunks: dict[str, list[Any]] = {"camera": [], "ball": [], "imu": []}
    done = 0
    for number in range(SHOTS):
        end_us = number * STEP_US
        until = int(np.searchsorted(events["t"], end_us, side="right"))
        layout.events(events[done:until], end_us)
        layout.labels(labels[done:until])
        times_us = np.arange(-(-max(0, end_us - STEP_US + 1) // 5000) * 5000, end_us + 1, 5000)
        for name, motion in (("camera", ORBIT), ("ball", BALL)):
            chunk = track(name, motion, times_us, camera=name == "camera")
            layout.track(chunk)
            chunks[name].append(chunk)
        chunks["imu"].append(imu.until(end_us))
        layout.imu(chunks["imu"][-1])
        frame = shot(number, int(np.searchsorted(events["t"], end_us)), rng)
        layout.shot(frame)
        given.shots.append(frame)
        done = until
    if close:
        layout.close()
    for name in ("camera", "ball"):
        parts = chunks[name]
        given.tracks[name] = TrackChunk(
            name, *(np.concatenate([getattr(p, f) for p in parts]) for f in ("times_us", "poses", "velocities"))
        )
    fields = ("times_us", "acceleration", "angular_velocity")
    given.imu = ImuChunk(*(np.concatenate([getattr(p, f) for p in chunks["imu"]]) for f in fields))
    return given
