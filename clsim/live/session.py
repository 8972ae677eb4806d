"""From options to a running pipeline: the one place where the rooms are joined."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from clsim.detect.config import DetectorConfig
from clsim.events import EventBatch, Sink
from clsim.frames import BASE_PLANES
from clsim.live.options import LiveOptions
from clsim.live.outputs import open_output, sidecar_path, write_sidecar
from clsim.live.pipeline import Output, Pipeline
from clsim.live.schedule import Schedule, plan
from clsim.scene import Motion, World, load_world


@dataclass
class Session:
    """A live run that is ready to start."""

    options: LiveOptions
    world: World
    config: DetectorConfig
    schedule: Schedule
    pipeline: Pipeline
    wall_start_s: float
    cpu_start_s: float

    def start(self) -> None:
        """Write the sidecars, then start the pipeline."""
        self.write_sidecars(complete=False)
        self.pipeline.start()

    def summary(self) -> dict[str, Any]:
        """Return what the run did so far; see ``clsim live --json`` for the keys."""
        progress = self.pipeline.progress
        simulated_s = progress.simulated_us * 1e-6
        wall_s = time.perf_counter() - self.wall_start_s
        since_first = wall_s - (progress.first_frame_s or 0.0)
        return {
            "scene": self.world.name,
            "width": self.world.camera.width,
            "height": self.world.camera.height,
            "frames": progress.frames,
            "events": progress.events,
            "on_events": progress.on_events,
            "solved_share": progress.solved_share,
            "dropped_frames": progress.dropped_frames,
            "simulated_s": simulated_s,
            "wall_s": wall_s,
            "cpu_s": time.process_time() - self.cpu_start_s,
            "startup_s": progress.first_frame_s,
            "frames_per_s": progress.frames / since_first if since_first > 0 else 0.0,
            "outputs": [_output_summary(output) for output in self.pipeline.outputs],
        }

    def write_sidecars(self, *, complete: bool) -> None:
        """Write NAME.json beside every output that is a file."""
        files = [path for output in self.pipeline.outputs if (path := sidecar_path(output.name)) is not None]
        if not files:
            return
        info = self._describe() | {"complete": complete}
        if complete:
            info["summary"] = self.summary()
        for path in files:
            write_sidecar(path, info)

    def _describe(self) -> dict[str, Any]:
        from clsim import __version__

        camera, schedule = self.world.camera, self.schedule
        focal = 0.5 * camera.width / np.tan(np.radians(camera.fov_deg) / 2)
        in_a_pass = schedule.pass_frames if schedule.total is None or schedule.loop else schedule.total
        return {
            "clsim_version": __version__,
            "options": self.options.as_dict(),
            "thresholds": {"on": self.config.threshold_on, "off": self.config.threshold_off},
            "fps": schedule.fps,
            "camera": {
                "width": camera.width,
                "height": camera.height,
                "fov_deg": camera.fov_deg,
                "intrinsics_px": {
                    "fx": focal,
                    "fy": focal,
                    "cx": camera.width / 2,
                    "cy": camera.height / 2,
                },
            },
            "poses": [
                {"time_us": schedule.time_us(k), "camera_to_world": camera.motion.pose(k / schedule.fps).tolist()}
                for k in range(in_a_pass)
            ],
        }


def open_session(options: LiveOptions, extra_sinks: tuple[Sink, ...] = ()) -> Session:
    """Load the scene, open the outputs and prepare the pipeline; raises InputError before anything is rendered."""
    wall_start_s, cpu_start_s = time.perf_counter(), time.process_time()
    world = load_world(options.scene, resolution=options.resolution)
    fps = options.fps or world.fps
    schedule = plan(
        world.duration_s,
        fps,
        duration_s=options.duration_s,
        frames=options.frames,
        loop=options.loop,
        periodic=_is_periodic(world),
    )
    config = _detector_config(options, world)
    camera = world.camera
    from clsim.detect.device import choose_device
    from clsim.render import PathTracer, RenderOptions, check_device

    check_device(options.render_device)
    device = choose_device(options.opencl) if options.opencl is not None else None
    render_options = RenderOptions(
        spp=options.spp,
        fps=fps,
        seed=options.seed,
        noise=options.noise,
        max_depth=options.max_depth,
        threads=options.threads,
        device=options.render_device,
        variances=False,
    )

    def make_detector() -> Any:
        from clsim.detect.detector import Detector

        return Detector(config, camera.width, camera.height, BASE_PLANES, device=device)

    outputs = [Output(f"sink {i}", sink) for i, sink in enumerate(extra_sinks)]
    try:
        for name in options.outputs:
            outputs.append(Output(name, open_output(name, camera.width, camera.height)))
    except BaseException:
        for output in outputs:
            output.sink.close()
        raise
    pipeline = Pipeline(
        lambda: PathTracer(world, render_options),
        make_detector,
        outputs,
        schedule,
        (BASE_PLANES, camera.height, camera.width),
        ring=options.ring,
        pace=options.pace,
    )
    return Session(options, world, config, schedule, pipeline, wall_start_s, cpu_start_s)


def stream(scene: str | Path, **options: Any) -> Iterator[EventBatch]:
    """Yield the events of each frame of a scene, as they happen.

    Args:
        scene: name of a bundled scene, or a scene file.
        options: fields of ``LiveOptions``, such as ``spp=8``, ``duration_s=2.0``, ``threshold=(0.2, 0.2)``.

    Yields:
        One EventBatch a frame (possibly empty; the first frame sets the references and has none).

    Raises:
        InputError: a scene or option cannot be used.
    """
    from clsim.live.queue_sink import QueueSink

    queue = QueueSink(capacity=4)
    session = open_session(LiveOptions(scene=scene, **options), extra_sinks=(queue,))
    session.start()
    try:
        for _ in itertools.count():
            batch = queue.get(timeout_s=0.05)
            if batch is not None:
                yield batch
            elif session.pipeline.wait(0.0):
                while (batch := queue.get(timeout_s=0.0)) is not None:
                    yield batch
                session.write_sidecars(complete=True)
                return
    finally:
        queue.close()
        session.pipeline.stop()


def _output_summary(output: Output) -> dict[str, Any]:
    info: dict[str, Any] = {"name": output.name}
    for counter in ("clients", "dropped_events"):
        value = getattr(output.sink, counter, None)
        if value is not None:
            info[counter] = value
    if output.error is not None:
        info["error"] = output.error
    return info


def _detector_config(options: LiveOptions, world: World) -> DetectorConfig:
    sensor = world.sensor
    on, off = options.threshold or (sensor.threshold_on, sensor.threshold_off)
    return DetectorConfig(
        method=options.method,
        gate=options.gate,
        event_rule=options.event_rule,
        threshold_on=on,
        threshold_off=off,
        window=options.window,
        history=options.history,
        scale=sensor.scale,
        floor=sensor.floor,
    )


def _is_periodic(world: World) -> bool:
    motions: list[Motion] = [world.camera.motion, *(i.motion for i in world.instances)]
    motions += [light.motion for light in world.sphere_lights]
    return all(np.allclose(m.pose(0.0), m.pose(world.duration_s), atol=1e-6) for m in motions)
