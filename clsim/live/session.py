"""From options to a running pipeline: the one place where the rooms are joined."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from clsim.detect.config import REGRESSING, DetectorConfig
from clsim.events import Reporting, Sink
from clsim.events.outputs import FileOptions, open_outputs
from clsim.events.sidecar import sidecar_path, write_sidecar
from clsim.frames import VARIANCE_PLANES, InterestBoard, rendered_planes
from clsim.live.delivery import Output
from clsim.live.governed import Governed
from clsim.live.ladder import Level, ladder
from clsim.live.options import LiveOptions, RecordingOptions
from clsim.live.pipeline import Pipeline
from clsim.live.schedule import Schedule, plan
from clsim.scene import Camera, World, load_world
from clsim.version import VERSION


@dataclass
class Session:
    """A run that is ready to start.

    Attributes:
        name: what is shown: a scene, or a folder of frames.
        about: what a sidecar tells of the run: options, thresholds, camera, poses.
        warnings: what is asked for and will not be: by the scene, of what clsim lacks, and by options that the method
            has no use for; one sentence each.
        notes: what was chosen where the scene leaves it open, likewise.
    """

    name: str
    width: int
    height: int
    schedule: Schedule
    pipeline: Pipeline
    about: dict[str, Any]
    warnings: tuple[str, ...]
    notes: tuple[str, ...]
    wall_start_s: float
    cpu_start_s: float
    solves: bool = True
    """Whether the method solves regressions at all."""
    level: Level | None = None
    """How much is rendered, unless a governor decides."""
    governed: Governed | None = None
    """What decides how much is rendered, if anything does."""

    def start(self) -> None:
        """Write the sidecars, which a kill leaves as they are then, and start the pipeline."""
        self._write_sidecars(complete=False)
        self.pipeline.start()

    def summary(self) -> dict[str, Any]:
        """Return what the run did so far; see ``clsim live --json`` for the keys."""
        progress = self.pipeline.progress
        wall_s = time.perf_counter() - self.wall_start_s
        startup_s = progress.first_frame_s
        running_s = wall_s - (startup_s or 0.0)
        level = self.level if self.governed is None else self.governed.level
        return {
            "name": self.name,
            "width": self.width,
            "height": self.height,
            "frames": progress.frames,
            "events": progress.events,
            "on_events": progress.on_events,
            "solved_share": progress.solved_share if self.solves else None,
            "masked_pixels": progress.masked_pixels,
            "steep_pixels": progress.steep_pixels,
            "most_crossings": progress.most_crossings,
            "capped_events": progress.capped_events,
            "dropped_frames": progress.dropped_frames,
            "late_frames": progress.late_frames,
            "paths": progress.paths,
            "first_hit_rays": progress.first_hit_rays,
            "effort": None if level is None else asdict(level),
            "governor": None if self.governed is None else self.governed.summary(),
            "simulated_s": progress.simulated_us / 1e6,
            "wall_s": wall_s,
            "cpu_s": time.process_time() - self.cpu_start_s,
            "startup_s": startup_s,
            "frames_per_s": progress.frames / running_s if running_s > 0 else 0.0,
            "outputs": [_output_summary(output) for output in self.pipeline.outputs],
        }

    def write_sidecars(self, *, complete: bool) -> None:
        """Write NAME.json beside every output that is a file, with the summary of a run that has ended."""
        self._write_sidecars(complete=complete, summary=self.summary())

    def _write_sidecars(self, **more: Any) -> None:
        for output in self.pipeline.outputs:
            if output.sidecar is not None:
                write_sidecar(output.sidecar, self.about | more)


def open_live(options: LiveOptions, extra_sinks: Sequence[Sink] = ()) -> Session:
    """Load the scene, open the outputs and prepare to render; raises InputError before anything is rendered."""
    from clsim.render import PathTracer, RenderOptions, check_device

    started = _now()
    world = load_world(options.scene, resolution=options.resolution, strict=options.strict)
    fps = options.fps or world.fps
    schedule = plan(
        world.duration_s,
        fps,
        duration_s=options.duration_s,
        frames=options.frame_count,
        loop=options.loop,
        periodic=_is_periodic(world),
    )
    config = _live_config(options, world)
    point = options.point
    adaptive = point.sampling == "adaptive"
    level = Level(point.probe_spp if adaptive else point.spp, point.spp, point.first_hit_rays, point.probe_every)
    governed = Governed(ladder(level), fps) if options.governed else None
    render_options = RenderOptions(
        spp=point.spp,
        probe_spp=point.probe_spp if adaptive else None,
        probe_every=point.probe_every,
        first_hit_rays=point.first_hit_rays,
        fps=fps,
        seed=options.seed,
        noise=point.noise,
        sampler=point.sampler,
        follow_specular=options.follow_specular,
        max_depth=options.max_depth,
        threads=options.threads,
        device=options.render_device,
    )
    check_device(options.render_device)
    camera = world.camera
    planes = rendered_planes(first_hit_rays=point.first_hit_rays > 0).names
    board = InterestBoard("wait" if options.ring == "block" else "newest") if adaptive else None
    make_detector = _detector_maker(config, camera.width, camera.height, planes, options.opencl)
    outputs = _open_outputs(options.outputs, options.files, extra_sinks, camera.width, camera.height)
    pipeline = Pipeline(
        lambda: PathTracer(world, render_options, board),
        make_detector,
        outputs,
        schedule,
        (planes, camera.height, camera.width),
        ring=options.ring,
        pace=options.pace,
        board=board,
        governed=governed,
        share_cores=options.render_device == "cpu",
    )
    window = None if config.method == "esim" else config.side
    about = _about(options.as_dict() | {"window": window}, config, schedule) | about_camera(camera, schedule)
    return Session(
        world.name,
        camera.width,
        camera.height,
        schedule,
        pipeline,
        about,
        (*world.warnings, *_unused_options(config)),
        (*world.notes, *_settings_notes(options)),
        *started,
        config.method in REGRESSING,
        level,
        governed,
    )


def _settings_notes(options: LiveOptions) -> list[str]:
    """Return what the user should know of settings that follow from other options."""
    notes = []
    if options.quality is not None or options.pace == "real":
        notes.append(f"{options.basis}: {options.point.text()}")
    if options.pace == "real" and options.governor and options.ungovernable is not None:
        notes.append(f"no governor, because of {options.ungovernable}: frames may be late")
    return notes


def _unused_options(config: DetectorConfig) -> tuple[str, ...]:
    """Return a sentence about options that change nothing."""
    unused = config.unused()
    if not unused:
        return ()
    user = f"`method` {config.method}" if config.method != "esim-ad" else f"`gate` {config.gate}"
    return (f"{user} has no use for {', '.join(f'`{name}`' for name in unused)}",)


def open_recording(options: RecordingOptions, extra_sinks: Sequence[Sink] = ()) -> Session:
    """Open a sequence of EXR frames and the outputs; raises InputError before anything is detected."""
    from clsim.frames.exr import ExrSequence

    started = _now()
    source = ExrSequence(options.frames, options.fps)
    if options.config.bandwidth == "fixed" and options.config.shrink == 0:
        # Nothing reads the variances then, so they need not be converted frame by frame.
        without_variances = [name for name in source.names if name not in VARIANCE_PLANES]
        source = ExrSequence(options.frames, options.fps, without_variances)
    fps = options.fps or source.recorded_fps
    count = len(source.files)
    schedule = Schedule(fps, count, count, recorded_times=options.fps is None)
    pipeline = Pipeline(
        lambda: source,
        _detector_maker(options.config, source.width, source.height, source.names, options.opencl),
        _open_outputs(options.outputs, options.files, extra_sinks, source.width, source.height),
        schedule,
        (source.names, source.height, source.width),
    )
    about = _about(options.as_dict(), options.config, schedule)
    about["camera"] = {"width": source.width, "height": source.height}
    name = str(options.frames)
    solves = options.config.method in REGRESSING
    return Session(
        name,
        source.width,
        source.height,
        schedule,
        pipeline,
        about,
        _unused_options(options.config),
        (),
        *started,
        solves,
    )


def _now() -> tuple[float, float]:
    return time.perf_counter(), time.process_time()


def _detector_maker(
    config: DetectorConfig, width: int, height: int, names: tuple[str, ...], opencl: str | None
) -> Callable[[], Any]:
    """Choose the device now, so that a wrong name is told at once; build the kernels later, in a worker."""
    from clsim.detect.recorded import needs_numpy, recorded_detector
    from clsim.opencl.device import choose_device

    device = None if needs_numpy(config) else choose_device(opencl)

    def make() -> Any:
        return recorded_detector(config, width, height, names, device=device)

    return make


def _open_outputs(
    names: Sequence[str], options: FileOptions, extra_sinks: Sequence[Sink], width: int, height: int
) -> list[Output]:
    try:
        sinks = open_outputs(names, width, height, options)
    except BaseException:
        for sink in extra_sinks:
            sink.close()
        raise
    outputs = [Output(f"sink {i}", sink) for i, sink in enumerate(extra_sinks)]
    return outputs + [Output(name, sink, sidecar=sidecar_path(name)) for name, sink in sinks.items()]


def _about(options: dict[str, Any], config: DetectorConfig, schedule: Schedule) -> dict[str, Any]:
    return {
        "clsim_version": VERSION,
        "options": options,
        "thresholds": {"on": config.threshold_on, "off": config.threshold_off},
        "fps": schedule.fps,
    }


def about_camera(camera: Camera, schedule: Schedule) -> dict[str, Any]:
    """Return the intrinsics [pixels] and the camera-to-world pose of each frame of the run, or of a loop's pass."""
    focal = 0.5 * camera.width / np.tan(np.radians(camera.fov_deg) / 2)
    frames = schedule.pass_frames if schedule.total is None or schedule.loop else schedule.total
    return {
        "camera": {
            "width": camera.width,
            "height": camera.height,
            "fov_deg": camera.fov_deg,
            "intrinsics_px": {"fx": focal, "fy": focal, "cx": camera.width / 2, "cy": camera.height / 2},
        },
        "poses": [
            {"time_us": schedule.time_us(k), "camera_to_world": camera.motion.pose(k / schedule.fps).tolist()}
            for k in range(frames)
        ],
    }


def _output_summary(output: Output) -> dict[str, Any]:
    info: dict[str, Any] = {"name": output.name}
    if isinstance(output.sink, Reporting):
        info |= output.sink.report()
    if output.error is not None:
        info["error"] = output.error
    return info


def _live_config(options: LiveOptions, world: World) -> DetectorConfig:
    sensor = world.sensor
    on, off = options.threshold or (sensor.threshold_on, sensor.threshold_off)
    return DetectorConfig(
        method=options.point.method,
        gate=options.point.gate,
        event_rule=options.point.event_rule,
        threshold_on=on,
        threshold_off=off,
        window=options.point.window,
        history=options.history,
        scale=sensor.scale,
        floor=sensor.floor,
    )


def _is_periodic(world: World) -> bool:
    meshes_still = all(mesh.deformation is None for mesh in world.meshes)
    return meshes_still and all(np.allclose(m.pose(0.0), m.pose(world.duration_s), atol=1e-6) for m in world.motions())
