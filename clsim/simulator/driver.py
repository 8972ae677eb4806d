"""The driver of one camera or several, a step at a time: poses, light, time, and going back (see `clsim.simulator`)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

from clsim.detect.config import EventRule, Gate, Method
from clsim.errors import Error, InputError
from clsim.events import EventBatch
from clsim.events.batch import gather
from clsim.forks import check_process, is_orphan
from clsim.live.made_worlds import check_world
from clsim.live.options import LiveOptions
from clsim.live.quality import Noise, Quality, Sampler, Sampling
from clsim.live.rig import seed_of
from clsim.live.stages import Stages, in_colours_of, load_options_world, plan_stages
from clsim.render import SceneData
from clsim.scene import World
from clsim.scene.driven import CAMERA, read_place
from clsim.scene.motion import Matrix
from clsim.scene.trajectories.trajectory import Axes, Interpolation, turned
from clsim.scene.validate import BRIGHTEST
from clsim.sensor.settings import SensorSettings
from clsim.simulator.camera_pipeline import CameraPipeline, check_truth
from clsim.simulator.driving import Driving
from clsim.simulator.shared_scene import SharedScene, Turn, one_at_a_time
from clsim.simulator.snapshot import SimulatorState
from clsim.simulator.stepping import Clock, StepClock
from clsim.values import read_value

DriverT = TypeVar("DriverT", bound="Driver")


class Driver(ABC):
    """Moves a scene as it is told to, before one camera or several."""

    time_us: int

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
        confidence: float = 0.0,
        follow_specular: bool = True,
        max_depth: int = 8,
        threads: int | None = None,
        render_device: str = "cpu",
        opencl: str | None = None,
        strict: bool = False,
        time: str = "auto",
        time_tolerance_us: float | None = None,
        truth: str | Sequence[str] = (),
    ) -> None:
        """Load the scene and choose devices; the first step copies the scene to the one that renders.

        See `clsim.Simulator` for the arguments; raises InputError when one of them cannot be used.
        """
        given: dict[str, Any] = {name: value for name, value in locals().items() if name not in ("self", "clock")}
        kind: Clock = read_value("clock", clock, Clock)
        world = scene if isinstance(scene, World) else None
        if world is not None:
            check_world(world, given)
            given["scene"] = world.name
        self._options = LiveOptions(**given)
        check_truth((truth,) if isinstance(truth, str) else truth)
        self.world = self._load() if world is None else in_colours_of(self._options.sensor, world)
        self._start(SharedScene(self.world), kind)

    def _start(self, scene: SharedScene, clock: Clock) -> None:
        """Choose devices; drivers that share the scene move it one at a time."""
        self._camera_pipelines = {
            name: CameraPipeline(plan_stages(options, own)) for name, own, options in self._chips()
        }
        self.fps = self._first.fps
        self.warnings = tuple(
            dict.fromkeys(text for pipeline in self._camera_pipelines.values() for text in pipeline.stages.warnings)
        )
        self._turn = Turn(scene)
        self._driven: tuple[str, ...] = ()
        self.names = scene.driving.names
        self._data: SceneData | None = None
        self._closed = False
        self._clock = StepClock(clock, self.fps)
        self._begin()

    def twin(self: DriverT, seed: int) -> DriverT:
        """Return another of the same scene, with poses, light and time of its own, before its first step.

        Both share the scene on the device, and so its kernels and trees; what can be moved is what has been set when
        the first of them steps. Threads that drive them wait for each other.
        """
        self._check_open()
        other = copy(self)
        other._options = replace(self._options, seed=seed)
        other._start(self._turn.scene, self._clock.kind)
        return other

    @property
    def _driving(self) -> Driving:
        """What is set from outside; from now on the scene is as this driver has set it."""
        return self._turn.driving

    def _load(self) -> World:
        """Load the scene that the options name."""
        return load_options_world(self._options)

    @abstractmethod
    def _seen(self, world: World) -> dict[str, World]:
        """Return the world as each camera sees it, by the cameras' names, which are those of its `CameraPipeline`."""

    @property
    def frame_time_us(self) -> int | None:
        """Time of the last frame [µs]; None before the first."""
        return self.time_us if self._next else None

    @one_at_a_time
    def set_pose(self, name: str, pose: Any, at_us: int | None = None) -> None:
        """Say where something is at a time; on the way from its last pose it goes straight and turns by slerp.

        The first pose holds from the start; where steps were made before, the way leads there from where it is now.

        Args:
            name: one of ``names``.
            pose: its pose in the world [m]: a matrix ``[4, 4]`` with at most one positive scale, or a pair of
                position and quaternion x, y, z, w. A camera looks along −z, and +y is up; see `set_camera` for other
                axes.
            at_us: the time [µs], after the last frame and no earlier than the last pose that was set; None is the end
                of the next step.

        Raises:
            InputError: the name, the pose or the time cannot be, or it stands still in the scene and steps were made
                already: what may move must be known before the first step.
        """
        self._check_open()
        place = read_place("pose", pose)
        at_us = read_value("at_us", at_us, int | None)
        self._driving.set_place(read_value("name", name, str), place, at_us, self.frame_time_us)

    @one_at_a_time
    def set_camera(self, pose: Any, at_us: int | None = None, *, axes: Axes = "opengl") -> None:
        """Say where the camera is at a time, as `set_pose` does.

        Args:
            pose: its pose, as for `set_pose`.
            at_us: the time [µs]; None is the end of the next step.
            axes: "opengl": it looks along −z, and +y is up; "opencv": along +z, and +y is down.

        Raises:
            InputError: as `set_pose`.
        """
        self._check_open()
        position, rotation, scale = read_place("pose", pose)
        if read_value("axes", axes, Axes) == "opencv":
            rotation = turned(rotation)
        at_us = read_value("at_us", at_us, int | None)
        self._driving.set_place(CAMERA, (position, rotation, scale), at_us, self.frame_time_us)

    @one_at_a_time
    def pose(self, name: str, time_us: float | None = None) -> Matrix:
        """Return the pose ``[4, 4]`` of what is called so, at a time [µs] or, without one, at the last frame.

        Raises:
            InputError: nothing is called so.
        """
        time_us = read_value("time_us", time_us, float | None)
        return self._driving.pose(read_value("name", name, str), self.time_us if time_us is None else time_us)

    @one_at_a_time
    def set_light(self, name: str, radiance: tuple[float, float, float]) -> None:
        """Let lights shine with another radiance from the next frame on.

        Where light is cached on surfaces, the cache is emptied then, and noise is another one. Set one before the first
        step too, and a named quality caches none.

        Args:
            name: of a light, or of a material that emits.
            radiance: linear Rec. 709 [W·sr⁻¹·m⁻²]; of a point or spot its intensity [W·sr⁻¹], of a directional
                light its irradiance [W·m⁻²].

        Raises:
            InputError: nothing of that name shines in the scene, or the radiance cannot be.
        """
        self._check_open()
        name = read_value("name", name, str)
        red, green, blue = read_value("radiance", radiance, tuple[float, float, float])
        if min(red, green, blue) < 0 or max(red, green, blue) > BRIGHTEST:
            raise InputError(
                f"`radiance` must not be negative, nor more than {BRIGHTEST:g}, got {red:g}, {green:g}, {blue:g}"
            )
        # Until the first step, what is auto may yet become fixed.
        time = self._options.time if self._data is None else self._first.options.time
        if time not in ("auto", "fixed"):
            raise InputError(
                f"`time` {time} knows the scene's own light between frames, so no light can be set; use fixed"
            )
        self._driving.set_light(name, (red, green, blue))
        if self._data is not None:
            self._data.set_light(name, (red, green, blue))
            for pipeline in self._camera_pipelines.values():
                pipeline.forget_light()

    @one_at_a_time
    def _step(self, until_us: int) -> dict[str, EventBatch]:
        """Make a step, and return each camera's events."""
        self._check_open()
        until_us = read_value("until_us", until_us, int)
        if until_us < self.time_us:
            raise InputError(f"`until_us` must not be before the last frame, at {self.time_us} µs, got {until_us}")
        self._driving.end_step(until_us, self.frame_time_us)
        data = self._build() if self._data is None else self._data
        batches: dict[str, list[EventBatch]] = {name: [] for name in self._camera_pipelines}
        for pipeline in self._camera_pipelines.values():
            pipeline.begin_step()
        for time_us in self._clock.frame_times(self._next, self.time_us, until_us):
            for name, pipeline in self._camera_pipelines.items():
                batches[name].append(pipeline.advance(self._next, time_us, self.frame_time_us, data))
            before_us, self.time_us = self.time_us, time_us
            self._next += 1
            self._driving.forget_before(before_us)
        self._clock.wait_for(until_us)
        return {name: parts[0] if len(parts) == 1 else gather(parts) for name, parts in batches.items()}

    def _check_frame(self) -> None:
        """Raise Error where there is no frame."""
        self._check_open()
        if self._next == 0:
            raise Error("there is no frame yet: step first")

    @one_at_a_time
    def reset(self, seed: int | None = None) -> None:
        """Restart: the next frame is at 0, and all stands and shines as in the scene, until it is set.

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
            self._data.restart_motion()
            for pipeline in self._camera_pipelines.values():
                pipeline.connect(self._data)
        self._driving.release()
        self._begin()

    @one_at_a_time
    def snapshot(self) -> SimulatorState:
        """Return all that the simulator remembers, for `restore`; it costs as much memory as the simulator's own.

        Raises:
            clsim.Error: there was no step yet, or the simulator is closed.
        """
        self._check_open()
        if self._data is None:
            raise Error("there is nothing to remember yet: step first")
        remembers = tuple(pipeline.snapshot() for pipeline in self._camera_pipelines.values())
        return SimulatorState(self._views, remembers, self._driving.state(), self._next, self.time_us)

    @one_at_a_time
    def restore(self, state: SimulatorState) -> None:
        """Go back to when a snapshot was taken; the same steps return the same events again.

        Raises:
            InputError: it is of another simulator, or of before a reset.
            clsim.Error: the simulator is closed.
        """
        self._check_open()
        if not isinstance(state, SimulatorState):
            raise InputError(f"`state` must be what `snapshot` returns, got {state!r:.100}")
        if self._data is None or state.views != self._views:
            raise InputError("`state` is of another simulator, or of before a reset")
        for remembered in state.remembers:
            remembered.restore()
        shining = self._driving.shining()
        for name in self._driving.light:
            self._data.set_light(name, shining[name])
        self._driving.set_state(state.driving)
        for name, radiance in self._driving.light.items():
            self._data.set_light(name, radiance)
        self._data.restart_motion()
        self._begin(state.next, state.time_us)

    @property
    def lag_s(self) -> float:
        """By how much the last step ended late, with the wall clock [s]."""
        return self._clock.lag_s

    @one_at_a_time
    def close(self) -> None:
        """Release the devices' memory; safe to call twice."""
        if not self._closed:
            self._closed = True
            if is_orphan():  # devices are the parent's
                return
            for pipeline in self._camera_pipelines.values():
                pipeline.release()

    def _begin(self, frames: int = 0, time_us: int = 0) -> None:
        """Let so many frames have passed, the last at that time, and the wall clock start with the next step."""
        self._next = frames
        self.time_us = time_us
        self._clock.restart()

    def _build(self) -> SceneData:
        """Copy the scene to the device, and build what works on it."""
        self._driven = self._driving.moved
        shared = self._turn.scene
        self.world = self._driving.seal() if shared.data is None else shared.data.world
        self._plan()
        data = shared.data or self._scene_data()
        for name, radiance in self._driving.light.items():
            data.set_light(name, radiance)
        for pipeline in self._camera_pipelines.values():
            pipeline.connect(data)
        self._data = shared.data = (
            data  # now that all is built: a step after one that could not be begins with this again
        )
        return data

    @abstractmethod
    def _scene_data(self) -> SceneData:
        """Copy the scene to the device."""

    def _plan(self) -> None:
        for name, own, options in self._chips():
            self._camera_pipelines[name].stages = plan_stages(
                options, own, lights_set=bool(self._driving.light), driven=self._driven
            )

    def _chips(self) -> Iterator[tuple[str, World, LiveOptions]]:
        """Yield each camera's name, the world as it sees it, and its options: no two have the same noise."""
        for number, (name, own) in enumerate(self._seen(self.world).items()):
            yield name, own, replace(self._options, seed=seed_of(self._options.seed, number))

    @property
    def _first(self) -> Stages:
        """The stages of the first camera."""
        return next(iter(self._camera_pipelines.values())).stages

    @property
    def _views(self) -> tuple[object, ...]:
        return tuple(pipeline.view for pipeline in self._camera_pipelines.values())

    def _check_open(self) -> None:
        check_process()
        if self._closed:
            raise Error("the simulator is closed")

    def __enter__(self: DriverT) -> DriverT:
        """Return the simulator, which is closed with the block."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        self.close()
