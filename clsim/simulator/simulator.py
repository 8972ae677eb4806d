"""The synchronous driver: the stages of a live run in the caller's own thread, a step at a time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError, require_choice
from clsim.events import Causes, EventBatch
from clsim.frames import Frame
from clsim.live.rig import cameras_of
from clsim.live.stages import alone
from clsim.render import SceneData
from clsim.scene import Camera, World
from clsim.scene.driven import CAMERA
from clsim.simulator.camera_pipeline import CameraPipeline
from clsim.simulator.driver import Driver
from clsim.simulator.radiance import RadianceCamera


class Simulator(Driver):
    """Turns a scene into events as far as it is told to, with the same bits as a live run.

    >>> with clsim.Simulator("two-boxes", fps=1000.0) as simulator:  # doctest: +SKIP
    ...     simulator.set_pose("tall box", pose)  # where it is when the next step ends
    ...     events = simulator.step(until_us=1_000)

    The frame at 0 sets the references and fires nothing. Beyond the end of the scene's motion, time goes on as the
    motion does.

    Args:
        scene: name of a bundled scene, a scene file, or a `World`, which has its own resolution and camera.
        clock: who says when frames are rendered. "frames": at k/fps, as fast as they can be. "wall": at k/fps, and no
            step returns before its end has come, counted from the first step. "caller": at 0 and at the end of each
            step, and evenly between where a step is longer than 1/fps.
        fps: frames per simulated second [1/s]; None takes the scene's.
        resolution: width and height [pixels]; None takes the sensor's, or the scene's.
        camera_path: a file of poses that the camera follows (see `clsim.scene.read_path`); None takes the scene's.
        camera_axes: of that file. "opencv": +z ahead and +y down. "opengl": −z ahead and +y up.
        camera_interpolation: how its poses are joined. "linear": straight, and turns by slerp. "cubic": along splines.
        threshold: contrast thresholds of ON and OFF events [natural-log units], or one for both; None takes the
            sensor's, or the scene's.
        sensor: a preset such as "davis346", a TOML file, or settings; None is the ideal pixel.
        quality: speed against accuracy, "draft", "balanced", "accurate", "exact" or "published"; None is "balanced",
            unless a ``method`` is given.
        seed: of all random numbers, 0 or more.
        spp: light paths per pixel and frame, at most. This and what follows take the place of the quality's own; None
            leaves it.
        sampling: which pixels get light paths: "uniform", "adaptive" (where an event is near), or "cached" (light is
            cached on surfaces).
        probe_spp: light paths that every pixel gets, where sampling is not uniform.
        probe_every: frames in which the light of all pixels is found once.
        first_hit_rays: rays per pixel and frame that only find what it shows, at most; 0 is none.
        sampler: random numbers: "pcg" (plain) or "sobol".
        noise: "common" (the same random numbers in each frame) or "independent".
        method: how brightness is found: "esim", "irradiance", "esim-ad" or "wlr-esim".
        gate: which pixels are regressed, of the methods that regress: "radiance" or "delta-r".
        event_rule: what brightness is between frames: "linear-light", "interpolated" (its logarithm is a line), or
            "frame" (one event a frame at most).
        window: side of the window that brightness is found from [pixels], odd.
        history: frames whose windows form one regression, 1 or more.
        confidence: standard errors by which brightness must have changed before an event is fired; 0 asks for none.
        follow_specular: whether depth, normal and albedo are those seen in mirrors and through clear glass.
        max_depth: longest light path [edges]: 1 sees emitters only, 2 adds direct light, 3 one bounce.
        threads: that render; None takes one a core.
        render_device: "cpu", or "cuda:0" and so on.
        opencl: part of the name of the OpenCL device to use; None takes the best that works.
        strict: refuse a scene that asks for what clsim lacks, instead of warning.
        time: when brightness is found. "fixed": at frames. "adaptive": between them too, where events happen.
            "lambda=0.5": in whole pictures, in which nothing goes farther than so many pixels from one to the next.
            "auto": adaptive where things go fast; where something is set before the first step, fixed.
        time_tolerance_us: error of an event's time that will do where time is adaptive [µs]; None is 100, or 30 with
            "accurate" and "exact".
        truth: what `truth` shall be able to tell: names of `clsim.frames.TRUTH_PLANES`, such as "depth", or "all".
            Poses and inertial samples are for recordings alone.

    Raises:
        InputError: the scene or an option cannot be used.

    Attributes:
        fps: frames per simulated second; with the caller's clock, at least so many.
        world: the scene, with what is driven.
        names: what has a pose that can be set: the camera, and objects and lights whose names are their own.
        warnings: what is asked for and will not be, one sentence each.
        time_us: time of the last frame; 0 before the first.
        from_radiance: makes a camera to which another renderer shows its pictures, and which returns events.
    """

    from_radiance = RadianceCamera

    @property
    def width(self) -> int:
        """Of the sensor [pixels]."""
        return self.world.camera.width

    @property
    def height(self) -> int:
        """Of the sensor [pixels]."""
        return self.world.camera.height

    def step(self, until_us: int) -> EventBatch:
        """Render and detect all frames up to ``until_us`` [µs], that time included, and return their events.

        The events are sorted by time, and none is later than the last of these frames; if there was none, nor is there
        an event.

        Raises:
            InputError: ``until_us`` lies before the last frame.
            clsim.Error: the simulator is closed.
        """
        return self._step(until_us)[CAMERA]

    @property
    def causes(self) -> Causes:
        """What caused each event of the last step: an index of `clsim.events.CAUSES`."""
        return self._camera_pipeline.causes

    def frame(self) -> Frame:
        """Return a copy of the last frame, with all its planes.

        Raises:
            clsim.Error: there was no step yet, or the simulator is closed.
        """
        self._check_frame()
        return self._camera_pipeline.frame()

    def truth(self, *names: str) -> dict[str, npt.NDArray[np.float32]]:
        """Return what is known of the last frame's pixels, float32, by name.

        ``intensity``, ``depth`` and ``distance`` [m] are ``[H, W]``; ``normal`` and ``albedo`` ``[H, W, 3]``; ``flow``
        and ``backward-flow`` ``[H, W, 4]``: x and y [px], valid, covisible. ``ids`` gives ``object`` and ``material``
        ``[H, W]``, where k stands for the k-th name of a recording's table, and 0 for nothing. Backward flow leads to
        the frame before: with the caller's clock that is at the end of the step before, or within this step where it
        is longer than 1/fps; with the others 1/fps ago. Flow leads 1/fps on, as far as motions are known now.

        Args:
            names: planes that ``truth`` was given, or intensity; none means all of them.

        Raises:
            InputError: a name is not among them.
            clsim.Error: there was no step yet, or the simulator is closed.
        """
        self._check_frame()
        return self._camera_pipeline.truth(names)

    def _load(self) -> World:
        return alone(super()._load())

    def _seen(self, world: World) -> dict[str, World]:
        return {CAMERA: world}

    def _scene_data(self) -> SceneData:
        return self._camera_pipeline.stages.scene_data()

    @property
    def _camera_pipeline(self) -> CameraPipeline:
        return self._camera_pipelines[CAMERA]


class RigSimulator(Driver):
    """As `Simulator`, with all the cameras of a rig (``[[cameras]]`` in a TOML, or `World.rig`), which move as one.

    >>> with clsim.RigSimulator("stereo.toml", fps=1000.0) as rig:  # doctest: +SKIP
    ...     rig.set_camera(pose)  # where the rig is when the next step ends
    ...     events = rig.step(until_us=1_000)
    ...     print(len(events["left"]), len(events["right"]))

    Each camera has the bits that it has in a live run, and noise of its own. Arguments are those of `Simulator`.

    Attributes:
        cameras: by name, in the order of the scene.
        fps, world, names, warnings, time_us: as in `Simulator`; "camera" is the name of the rig.
    """

    @property
    def cameras(self) -> dict[str, Camera]:
        """Each camera, by name; its motion is what the scene says, and what is set."""
        return {name: pipeline.stages.world.camera for name, pipeline in self._camera_pipelines.items()}

    def step(self, until_us: int) -> dict[str, EventBatch]:
        """Render and detect all frames up to ``until_us`` [µs], and return each camera's events by its name.

        Raises:
            InputError: ``until_us`` lies before the last frame.
            clsim.Error: the simulator is closed.
        """
        return self._step(until_us)

    @property
    def causes(self) -> dict[str, Causes]:
        """What caused each event of the last step, by cameras: an index of `clsim.events.CAUSES`."""
        return {name: pipeline.causes for name, pipeline in self._camera_pipelines.items()}

    def frame(self, camera: str) -> Frame:
        """Return a copy of a camera's last frame.

        Raises:
            InputError: no camera is called so.
            clsim.Error: there was no step yet, or the simulator is closed.
        """
        self._check_frame()
        return self._camera_pipeline(camera).frame()

    def truth(self, camera: str, *names: str) -> dict[str, npt.NDArray[np.float32]]:
        """Return what is known of the pixels of a camera's last frame, as `Simulator.truth` does.

        Raises:
            InputError: no camera is called so, or a name is not among its planes.
            clsim.Error: there was no step yet, or the simulator is closed.
        """
        self._check_frame()
        return self._camera_pipeline(camera).truth(names)

    def _seen(self, world: World) -> dict[str, World]:
        if not world.rig:
            raise InputError(f"{world.name} has one camera, expected a rig ([[cameras]]); use clsim.Simulator")
        return {name: replace(world, camera=camera, rig=()) for name, camera in cameras_of(world).items()}

    def _scene_data(self) -> SceneData:
        render = next(iter(self._camera_pipelines.values())).stages.render
        longest_s = max(camera.shutter_s for camera in self.cameras.values())
        return SceneData(self.world, render.device, render.tree, longest_s, light_cache=render.light_cache)

    def _camera_pipeline(self, camera: str) -> CameraPipeline:
        require_choice("camera", camera, tuple(self._camera_pipelines))
        return self._camera_pipelines[camera]
