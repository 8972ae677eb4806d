"""The synchronous driver: the stages of a live run in the caller's own thread, a step at a time."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Any, cast

from clsim.detect.config import EventRule, Gate, Method
from clsim.errors import Error, InputError
from clsim.events import EventBatch
from clsim.events.batch import gather
from clsim.frames import Frame, frame_time_us, page_aligned
from clsim.live.options import LiveOptions
from clsim.live.pipeline import InterestedDetector
from clsim.live.quality import Noise, Quality, Sampler, Sampling
from clsim.live.stages import plan_stages
from clsim.scene import World
from clsim.values import read_value


class Simulator:
    """Turns a scene into events as far as it is told to, with the same bits as a live run.

    >>> with clsim.Simulator("two-boxes", fps=120.0) as simulator:  # doctest: +SKIP
    ...     events = simulator.step(until_us=50_000)

    Frames are rendered at k/fps, k = 0, 1 …; the one at 0 sets the references and fires nothing. Beyond the end of the
    scene's motion, time goes on as the motion does.

    Attributes:
        width, height: of the sensor [pixels].
        fps: frames per simulated second.
        world: the scene.
        warnings: what is asked for and will not be, one sentence each.
        time_us: time of the last frame; 0 before the first.
    """

    def __init__(
        self,
        scene: str | Path | World,
        *,
        fps: float | None = None,
        resolution: tuple[int, int] | None = None,
        threshold: float | tuple[float, float] | None = None,
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
    ) -> None:
        """Load the scene, choose devices and copy the scene to the one that renders.

        Args:
            scene: name of a bundled scene, a scene file, or a World.
            fps, resolution, threshold, quality, seed, spp, sampling, probe_spp, probe_every, first_hit_rays, sampler,
                noise, method, gate, event_rule, window, history, follow_specular, max_depth, threads, render_device,
                opencl, strict: as in `clsim.stream`; a World has its own resolution.

        Raises:
            InputError: the scene or an option cannot be used.
        """
        given: dict[str, Any] = {name: value for name, value in locals().items() if name != "self"}
        world = scene if isinstance(scene, World) else None
        if world is not None and resolution is not None:
            raise InputError("`resolution` is for scenes that are loaded; a World's camera has its own")
        if world is not None:
            given["scene"] = world.name
        options = LiveOptions(**given)
        self._stages = plan_stages(options, world)
        self.world, self.fps, self.warnings = self._stages.world, self._stages.fps, self._stages.warnings
        self.width, self.height = self.world.camera.width, self.world.camera.height
        self._frame = Frame(page_aligned((len(self._stages.planes), self.height, self.width)), self._stages.planes)
        self._data = self._stages.scene_data()
        self._closed = False
        self._build()

    def _build(self) -> None:
        """Begin at frame 0, with nothing kept from earlier frames."""
        self._board = self._stages.board("refuse")
        self._view = self._stages.view(self._data, self._board)
        self._detector = self._stages.make_detector()
        self._next = 0
        self.time_us = 0

    def step(self, until_us: int) -> EventBatch:
        """Render and detect all frames up to ``until_us`` [µs], that time included, and return their events.

        The events are sorted by time, and none is later than the last of these frames; if there was none, nor is there
        an event.

        Raises:
            InputError: ``until_us`` lies before the last frame.
            clsim.Error: the simulator is closed.
        """
        if self._closed:
            raise Error("the simulator is closed")
        until_us = read_value("until_us", until_us, int)
        if until_us < self.time_us:
            raise InputError(f"`until_us` must not be before the last frame, at {self.time_us} µs, got {until_us}")
        batches = []
        while frame_time_us(self._next, self.fps) <= until_us:
            self._view.fill(self._next, self._frame)
            batches.append(self._detector.step(self._frame).copy())
            if self._board is not None:
                self._board.publish(cast(InterestedDetector, self._detector).interest())
            self.time_us = self._frame.time_us
            self._next += 1
        return gather(batches)

    def reset(self) -> None:
        """Begin anew: the next frame is at 0, and the same steps return the same events again."""
        if self._closed:
            raise Error("the simulator is closed")
        self._release()
        self._build()

    def close(self) -> None:
        """Release the devices' memory; safe to call twice."""
        if not self._closed:
            self._closed = True
            self._release()

    def _release(self) -> None:
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
