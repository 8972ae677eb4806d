"""The synchronous driver: the stages of a live run in the caller's own thread, a step at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from clsim.detect.config import EventRule, Gate, Method
from clsim.detect.pack import FrameMemory
from clsim.driving import Driving
from clsim.errors import Error, InputError, require_choice
from clsim.events import Causes, EventBatch
from clsim.events.batch import gather
from clsim.frames import Frame, page_aligned
from clsim.live.options import LiveOptions
from clsim.live.pipeline import InterestedDetector
from clsim.live.quality import Noise, Quality, Sampler, Sampling
from clsim.live.stages import plan_stages
from clsim.live.time_steps import TimeSteps
from clsim.opencl.workplace import Workplace
from clsim.radiance import RadianceCamera
from clsim.render import SceneData
from clsim.scene import Camera, World, validate
from clsim.scene.driven import CAMERA, read_place
from clsim.scene.motion import Matrix
from clsim.scene.trajectory import Axes, Interpolation, turned
from clsim.sensor.settings import SensorSettings
from clsim.snapshot import SimulatorState, Snapshot
from clsim.stepping import Clock, StepClock
from clsim.truth.cut import cut
from clsim.truth.names import plane_names
from clsim.values import read_value

_APART = (SceneData, Camera, FrameMemory, Workplace)
"""What a snapshot leaves as it is: the scene on its device, memory that is lent and taken back, kernels' arguments."""


class Simulator:
    """Turns a scene into events as far as it is told to, with the same bits as a live run.

    >>> with clsim.Simulator("two-boxes", fps=1000.0) as simulator:  # doctest: +SKIP
    ...     simulator.set_pose("tall box", pose)  # where it is when the next step ends
    ...     events = simulator.step(until_us=1_000)

    The frame at 0 sets the references and fires nothing. Beyond the end of the scene's motion, time goes on as the
    motion does.

    Attributes:
        width, height: of the sensor [pixels].
        fps: frames per simulated second; with the caller's clock, at least so many.
        world: the scene, with what is driven.
        names: what has a pose that can be set: the camera, and objects and lights whose names are their own.
        warnings: what is asked for and will not be, one sentence each.
        time_us: time of the last frame; 0 before the first.
        from_radiance: makes a camera to which another renderer shows its pictures, and which returns events.
    """

    from_radiance = RadianceCamera

    def __init__(
        self,
        scene: str | Path | World,
        *,
        clock: Clock = "frames",
        fps: float | None = None,
        resolution: tuple[int, int] | None = None,
        camera_path: str | Path | None = None,
        camera_axes: Axes = "opencv",
        camera_interpolation: Interpolation = "linear",
        threshold: float | tuple[float, float] | None = None,
        sensor: str | Path | SensorSettings | None = None,
        quality: Quality | None = None,
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
        follow_specular: bool = True,
        max_depth: int = 8,
        threads: int | None = None,
        render_device: str = "cpu",
        opencl: str | None = None,
        strict: bool = False,
        time: TimeSteps = "fixed",
        time_tolerance_us: float | None = None,
        truth: str | Sequence[str] = (),
    ) -> None:
        """Load the scene and choose devices; the first step copies the scene to the one that renders.

        Args:
            scene: name of a bundled scene, a scene file, or a World.
            clock: who says when frames are rendered. "frames": at k/fps, as fast as they can be. "wall": at k/fps, and
                no step returns before its end has come, counted from the first step. "caller": at 0 and at the end of
                each step, and evenly between where a step is longer than 1/fps.
            fps, resolution, camera_path, camera_axes, camera_interpolation, threshold, sensor, quality, seed, spp,
                sampling, probe_spp, probe_every, first_hit_rays, sampler, noise, method, gate, event_rule, window,
                history, follow_specular, max_depth, threads, render_device, opencl, strict, time,
                time_tolerance_us: as in `clsim.stream`; a World has its own resolution and camera.
            truth: what `truth` shall be able to tell: some of `clsim.frames.TRUTH_PLANES`.

        Raises:
            InputError: the scene or an option cannot be used.
        """
        given: dict[str, Any] = {name: value for name, value in locals().items() if name not in ("self", "clock")}
        kind: Clock = read_value("clock", clock, Clock)
        world = scene if isinstance(scene, World) else None
        for option in ("resolution", "camera_path"):
            if world is not None and given[option] is not None:
                raise InputError(f"`{option}` is for scenes that are loaded; a World's camera has its own")
        if world is not None:
            validate(world, world.name)
            given["scene"] = world.name
        self._options = LiveOptions(**given)
        self._stages = plan_stages(self._options, world)
        self.world, self.fps, self.warnings = self._stages.world, self._stages.fps, self._stages.warnings
        self._causes: list[Causes] = []
        self.width, self.height = self.world.camera.width, self.world.camera.height
        self._driving = Driving(self.world)
        self.names = self._driving.names
        self._frame = Frame(page_aligned((len(self._stages.planes), self.height, self.width)), self._stages.planes)
        self._data: Any = None
        self._closed = False
        self._clock = StepClock(kind, self.fps)
        self._begin()

    def set_pose(self, name: str, T_world: Any, at_us: int | None = None) -> None:
        """Say where something is at a time; on the way from its last pose it goes straight and turns by slerp.

        The first pose holds from the start; where steps were made before, the way leads there from where it is now.

        Args:
            name: one of ``names``.
            T_world: its pose in the world [m]: a matrix ``[4, 4]`` with at most one positive scale, or a pair of
                position and quaternion x, y, z, w. A camera looks along −z, and +y is up; see `set_camera` for other
                axes.
            at_us: the time [µs], after the last frame and no earlier than the last pose that was set; None is the end
                of the next step.

        Raises:
            InputError: the name, the pose or the time cannot be, or it stands still in the scene and steps were made
                already: what may move must be known before the first step.
        """
        self._check_open()
        place = read_place("T_world", T_world)
        at_us = read_value("at_us", at_us, int | None)
        self._driving.set_place(read_value("name", name, str), place, at_us, self._passed_us)

    def set_camera(self, T_world: Any, at_us: int | None = None, *, axes: Axes = "opengl") -> None:
        """Say where the camera is at a time, as `set_pose` does.

        Args:
            T_world: its pose, as for `set_pose`.
            at_us: the time [µs]; None is the end of the next step.
            axes: "opengl": it looks along −z, and +y is up; "opencv": along +z, and +y is down.

        Raises:
            InputError: as `set_pose`.
        """
        position, rotation, scale = read_place("T_world", T_world)
        if read_value("axes", axes, Axes) == "opencv":
            rotation = turned(rotation)
        at_us = read_value("at_us", at_us, int | None)
        self._driving.set_place(CAMERA, (position, rotation, scale), at_us, self._passed_us)

    def pose(self, name: str, time_us: int | None = None) -> Matrix:
        """Return the pose ``[4, 4]`` of what is called so, at a time [µs] or, without one, at the last frame.

        Raises:
            InputError: nothing is called so.
        """
        return self._driving.pose(name, self.time_us if time_us is None else time_us)

    def set_light(self, name: str, radiance: tuple[float, float, float]) -> None:
        """Let lights shine with another radiance from the next frame on.

        Where light is kept on surfaces it is found anew then, with other noise. Set one before the first step too, and
        a named quality keeps none.

        Args:
            name: of a light, or of a material that emits.
            radiance: linear Rec. 709 [W·sr⁻¹·m⁻²]; of a point or spot its intensity [W·sr⁻¹], of a directional
                light its irradiance [W·m⁻²].

        Raises:
            InputError: nothing of that name shines in the scene, or the radiance cannot be.
        """
        self._check_open()
        red, green, blue = read_value("radiance", radiance, tuple[float, float, float])
        if min(red, green, blue) < 0:
            raise InputError(f"`radiance` must not be negative, got {red:g}, {green:g}, {blue:g}")
        if self._options.time == "adaptive":
            raise InputError(
                "`time` adaptive knows the scene's own light between frames, so no light can be set; use fixed"
            )
        self._driving.set_light(name, (red, green, blue))
        if self._data is not None:
            self._data.set_light(name, (red, green, blue))
            self._view.forget_light()

    def step(self, until_us: int) -> EventBatch:
        """Render and detect all frames up to ``until_us`` [µs], that time included, and return their events.

        The events are sorted by time, and none is later than the last of these frames; if there was none, nor is there
        an event.

        Raises:
            InputError: ``until_us`` lies before the last frame.
            clsim.Error: the simulator is closed.
        """
        self._check_open()
        until_us = read_value("until_us", until_us, int)
        if until_us < self.time_us:
            raise InputError(f"`until_us` must not be before the last frame, at {self.time_us} µs, got {until_us}")
        self._driving.end_step(until_us, self._passed_us)
        if self._data is None:
            self._build()
        self._causes.clear()
        batches = [self._advance(time_us) for time_us in self._clock.frame_times(self._next, self.time_us, until_us)]
        self._clock.wait_for(until_us)
        return batches[0] if len(batches) == 1 else gather(batches)

    @property
    def causes(self) -> Causes:
        """What caused each event of the last step: an index of `clsim.events.CAUSES`."""
        return np.concatenate([np.zeros(0, np.uint8), *self._causes])

    def frame(self) -> Frame:
        """Return a copy of the last frame, with all its planes.

        Raises:
            clsim.Error: there was no step yet, or the simulator is closed.
        """
        self._check_open()
        if self._next == 0:
            raise Error("there is no frame yet: step first")
        return self._frame.copy()

    def truth(self, *names: str) -> dict[str, npt.NDArray[np.float32]]:
        """Return what is known of the last frame's pixels; `clsim.truth.cut.cut` tells shapes and units.

        Backward flow leads to the frame before; flow leads 1/fps on, as far as motions are known now.

        Args:
            names: planes that ``truth`` was given, or intensity; none means all of them.

        Raises:
            InputError: a name is not among them.
            clsim.Error: there was no step yet, or the simulator is closed.
        """
        known = ("intensity", *plane_names(self._options.truth))
        for name in names:
            require_choice("names", name, known)
        return cut(self.frame(), names or known)

    def reset(self, seed: int | None = None) -> None:
        """Begin anew: the next frame is at 0, and all stands and shines as in the scene, until it is set.

        The same steps return the same events again.

        Args:
            seed: of the random numbers from now on; None keeps it.
        """
        self._check_open()
        if seed is not None:
            self._options = replace(self._options, seed=seed)
            self._plan()
        if self._data is not None:
            for name in self._driving.light:
                self._data.set_light(name, self._driving.shining()[name])
            self._data.move_anew()
            self._release()
            self._connect()
        self._driving.release()
        self._begin()

    def snapshot(self) -> SimulatorState:
        """Return all that the simulator remembers, for `restore`; it costs as much memory as the simulator's own.

        Raises:
            clsim.Error: there was no step yet, or the simulator is closed.
        """
        self._check_open()
        if self._data is None:
            raise Error("there is nothing to remember yet: step first")
        queue = getattr(self._detector, "queue", None)  # what runs in numpy has none
        remembers = Snapshot((self._view, self._detector, self._board, self._frame), queue, _APART)
        return SimulatorState(self._view, remembers, self._driving.state(), self._next, self.time_us)

    def restore(self, state: SimulatorState) -> None:
        """Go back to when a snapshot was taken; the same steps return the same events again.

        Raises:
            InputError: it is of another simulator, or of before a reset.
            clsim.Error: the simulator is closed.
        """
        self._check_open()
        if self._data is None or state.view is not self._view:
            raise InputError("`state` is of another simulator, or of before a reset")
        state.remembers.restore()
        shining = self._driving.shining()
        for name in self._driving.light:
            self._data.set_light(name, shining[name])
        self._driving.set_state(state.driving)
        for name, radiance in self._driving.light.items():
            self._data.set_light(name, radiance)
        self._data.move_anew()
        self._begin(state.next, state.time_us)

    @property
    def lag_s(self) -> float:
        """By how much the last step ended late, with the wall clock [s]."""
        return self._clock.lag_s

    def close(self) -> None:
        """Release the devices' memory; safe to call twice."""
        if not self._closed:
            self._closed = True
            self._release()

    def _begin(self, frames: int = 0, time_us: int = 0) -> None:
        """Let so many frames have passed, the last at that time, and the wall clock start with the next step."""
        self._next = frames
        self.time_us = time_us
        self._clock.restart()

    def _build(self) -> None:
        """Copy the scene to the device, and build what works on it."""
        self.world = self._driving.seal()
        self._plan()
        self._data = self._stages.scene_data()
        for name, radiance in self._driving.light.items():
            self._data.set_light(name, radiance)
        self._connect()

    def _plan(self) -> None:
        self._stages = plan_stages(self._options, self.world, lights_set=bool(self._driving.light))

    def _connect(self) -> None:
        """Build a camera and a detector without a past."""
        self._board = self._stages.board("refuse")
        self._view = self._stages.view(self._data, self._board)
        self._detector = self._stages.build_detector()

    def _advance(self, time_us: int) -> EventBatch:
        """Render a frame and return its events."""
        self._view.fill_at(self._next, time_us, self._frame)
        if self._options.truth:
            before_us = self.time_us if self._next else None
            after_us = time_us + round(1e6 / self.fps)
            self._view.fill_truth(self._frame, before_us, after_us, after_us)
            self._data.move_anew()  # a pose may yet be set for a time at which the scene was for the sake of flow
        events: EventBatch = self._detector.step(self._frame).copy()
        causes = getattr(self._detector, "causes", None)  # not all detectors tell them
        self._causes.append(np.zeros(len(events), np.uint8) if causes is None else causes)
        if self._board is not None:
            self._board.publish(cast(InterestedDetector, self._detector).interest())
        before_us, self.time_us = self.time_us, time_us
        self._next += 1
        self._driving.forget_before(before_us)
        return events

    @property
    def _passed_us(self) -> int | None:
        """Time of the last frame; None before the first."""
        return self.time_us if self._next else None

    def _check_open(self) -> None:
        if self._closed:
            raise Error("the simulator is closed")

    def _release(self) -> None:
        if self._data is not None:
            self._view.close()
            self._detector.close()

    def __enter__(self) -> Simulator:
        """Return the simulator, which is closed with the block."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        self.close()
