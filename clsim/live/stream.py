"""A live run as a Python iterator."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.detect.config import EventRule, Gate, Method
from clsim.events import EventBatch
from clsim.events.outputs import FileOptions
from clsim.forks import check_process, is_orphan
from clsim.frames import Policy
from clsim.live.made_worlds import check_world
from clsim.live.options import LiveOptions
from clsim.live.outputs.queue_sink import QueueSink
from clsim.live.outputs.sidecars import camera_pose
from clsim.live.outputs.summary import Summary
from clsim.live.pipeline import Pace
from clsim.live.quality import Noise, Quality, Sampler, Sampling
from clsim.live.session import Session, open_live
from clsim.live.stages import alone, in_colours_of
from clsim.scene import World
from clsim.scene.trajectories.trajectory import Axes, Interpolation
from clsim.sensor.settings import SensorSettings


class Stream(Iterator[EventBatch]):
    """The events of a run, frame by frame, as they happen; see `stream`.

    The run begins with the first ``next`` and ends with the last frame, with ``close``, at the end of a ``with`` block,
    or when nobody holds the stream any longer.

    Attributes:
        width, height: of the sensor [pixels].
        fps: frames per simulated second.
        warnings: what is asked for and will not be, one sentence each.
        notes: what was chosen where the scene leaves it open, likewise.
    """

    def __init__(self, options: LiveOptions, world: World | None = None) -> None:
        """Load the scene, unless a world is given, and open the outputs; raises InputError."""
        self._queue = QueueSink(capacity=4)
        self._starting = threading.Lock()
        if world is not None:
            world = alone(in_colours_of(options.sensor, world))
        # No file's name leads back to a world that a program made.
        told = {} if world is None else {"scene": None}
        self._session = open_live(options, (self._queue,), told, world=world)
        self._taken = 0
        self.width, self.height = self._session.width, self._session.height
        self.fps = self._session.schedule.fps
        self.warnings, self.notes = self._session.warnings, self._session.notes
        self._close = weakref.finalize(self, _close, self._session, self._queue)

    @property
    def summary(self) -> Summary:
        """What the run did so far, frames that wait to be taken included."""
        return self._session.summary()

    @property
    def poses(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
        """Times [µs] ``[N]`` and camera-to-world matrices ``[N, 4, 4]`` of the frames taken so far.

        The world is right-handed, in metres; the camera looks along −z, with +y up. Where frames are dropped, these are
        of as many frames of the schedule.
        """
        schedule, world = self._session.schedule, self._session.world
        assert world is not None, "a live run has a scene"
        shown_us = [schedule.time_us(schedule.source_index(k)) for k in range(self._taken)]
        poses = [camera_pose(world.camera, each * 1e-6) for each in shown_us]
        times = [schedule.time_us(k) for k in range(self._taken)]
        return np.array(times, np.int64), np.array(poses, np.float64).reshape(-1, 4, 4)

    def __next__(self) -> EventBatch:
        """Return the events of the next frame, possibly none; waits for them.

        Raises:
            SinkError: in the end, if one of the outputs failed on the way; the events of the run were all returned.
            clsim.Error: the process was forked since.
        """
        check_process()
        if not self._close.alive:
            raise StopIteration
        session = self._session
        try:
            with self._starting:  # threads may read in turn
                if not session.started:
                    session.start()
            while True:
                ended = session.pipeline.wait(0.0)
                taken = self._queue.get(timeout_s=0.0 if ended else 0.05)
                if taken is not None:
                    self._taken += 1
                    return taken[0]
                if ended:
                    break
        except BaseException:
            self.close()
            raise
        session.write_sidecars(complete=True)
        self._close.detach()
        session.raise_failures()
        raise StopIteration

    def close(self) -> None:
        """End the run, if it has not ended, and complete its files; safe to call twice."""
        self._close()

    def __enter__(self) -> Stream:
        """Return the stream, which ends with the block."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the run."""
        self.close()


def _close(session: Session, queue: QueueSink) -> None:
    if is_orphan():  # the run and its files are the parent's
        return
    queue.close()
    session.pipeline.stop()
    if session.started:
        session.write_sidecars(complete=False)


def stream(
    scene: str | Path | World,
    *,
    duration_s: float | None = None,
    frame_count: int | None = None,
    loop: bool = False,
    fps: float | None = None,
    resolution: tuple[int, int] | None = None,
    camera_path: str | Path | None = None,
    camera_axes: Axes = "opencv",
    camera_interpolation: Interpolation = "linear",
    threshold: float | tuple[float, float] | None = None,
    sensor: str | Path | SensorSettings | None = None,
    quality: Quality | None = None,
    outputs: str | Sequence[str] = (),
    files: FileOptions | None = None,
    seed: int = 0,
    spp: int | None = None,
    sampling: Sampling | None = None,
    probe_spp: int | None = None,
    probe_every: int | None = None,
    first_hit_rays: int | None = None,
    sampler: Sampler | None = None,
    noise: Noise | None = None,
    method: Method | None = None,
    gate: Gate | None = None,
    event_rule: EventRule | None = None,
    window: int | None = None,
    history: int = 1,
    confidence: float = 0.0,
    follow_specular: bool = True,
    max_depth: int = 8,
    pace: Pace = "max",
    governor: bool = True,
    ring: Policy = "block",
    threads: int | None = None,
    render_device: str = "cpu",
    opencl: str | None = None,
    strict: bool = False,
    time: str = "auto",
    time_tolerance_us: float | None = None,
    truth: str | Sequence[str] = (),
    frame_rate: float | None = None,
    pose_rate: float = 200.0,
    imu_rate: float = 1000.0,
    imu_noise: str | None = None,
) -> Stream:
    """Return the events of a scene, frame by frame, as an iterator; everything is checked now.

    >>> for events in clsim.stream("two-boxes", duration_s=0.1):  # doctest: +SKIP
    ...     print(len(events), "events")

    Args:
        scene: name of a bundled scene, a scene file, or a World, which has its own resolution and camera.
        duration_s: simulated time [s], rounded to whole frames; None plays the motion once.
        frame_count: number of frames, instead of a duration.
        loop: start the motion anew at its end, for ever or until ``duration_s``.
        fps, resolution, camera_path, camera_axes, camera_interpolation: as in `clsim.Simulator`.
        threshold, sensor, quality, seed, spp, sampling, probe_spp, probe_every: as there.
        first_hit_rays, sampler, noise, method, gate, event_rule, window, history: as there.
        confidence, follow_specular, max_depth, threads, render_device, opencl, strict: as there.
        time, time_tolerance_us: as there.
        outputs: files and addresses that receive the events as well.
        files: how files are written.
        pace: "max": as fast as frames can be made; "real": no faster than the wall clock.
        governor: whether a run at the pace of the wall clock renders less where it could not keep up.
        ring: "block": rendering waits for the detector; "drop-oldest": it loses the oldest frame.
        truth: what is recorded beside the events in outputs that can hold it, of `clsim.truth.TRUTH_NAMES`, or "all".
        frame_rate: frames of truth per simulated second [1/s]; ``fps`` must be a multiple of it. None takes all.
        pose_rate: poses of camera and objects per simulated second [1/s].
        imu_rate: inertial samples per simulated second [1/s].
        imu_noise: Kalibr's imu.yaml, which says how noisy the inertial sensor is; None is a perfect one.

    Raises:
        InputError: a scene or option cannot be used.
    """
    given: dict[str, Any] = {**locals(), "files": FileOptions() if files is None else files}
    if isinstance(scene, World):
        check_world(scene, given)
        given["scene"] = scene.name
    return Stream(LiveOptions(**given), scene if isinstance(scene, World) else None)
