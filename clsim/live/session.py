"""From options to a running pipeline: stages, schedule and outputs, joined for a live run."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from clsim.events import Reporting, Sink, SinkError
from clsim.events.sidecar import write_sidecar
from clsim.footage.source import Footage
from clsim.frames import VARIANCE_PLANES, InterestBoard
from clsim.live.noise.duplicate_patches import DuplicatePatches, patches_for
from clsim.live.noise.duplicate_sampling import DUPLICATE_EVERY, DuplicatePixels, DuplicateSampling
from clsim.live.noise.significance import Significance
from clsim.live.options import LiveOptions
from clsim.live.outputs.delivery import Output
from clsim.live.outputs.opening import open_sinks
from clsim.live.outputs.sidecars import PoseFile, about_camera, about_run, poses_path, scene_from_here
from clsim.live.outputs.silence import Silence
from clsim.live.outputs.summary import Summary
from clsim.live.pacing.governed import Governed
from clsim.live.pacing.ladder import Level, ladder
from clsim.live.pacing.schedule import Schedule, plan
from clsim.live.pipeline import Pipeline
from clsim.live.recording_options import RecordingOptions
from clsim.live.sensors import LightMeter, cost_of, meter_for
from clsim.live.stages import Stages, detector_maker, plan_stages, unused_options
from clsim.opencl.device import choose_device
from clsim.scene import World

if TYPE_CHECKING:
    from clsim.render import View


@dataclass
class Session:
    """A run that is ready to start.

    Attributes:
        name: what is shown: a scene, or a folder of frames.
        about: what a sidecar tells of the run: options, thresholds, camera.
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
    world: World | None = None
    """The scene, unless frames were recorded."""
    footage: Footage | None = None
    """The video or pictures, if that is what is seen."""
    truth_every: int = 0
    """Rendered frames from one with truth to the next; 0 where there is none."""
    labelled: bool = False
    """Whether events are labelled with what caused them."""
    ideal: bool = True
    """Whether the sensor is the ideal one."""
    chosen: tuple[str, ...] = ()
    """What was chosen and why, a sentence each."""
    meter: LightMeter | None = None
    """What sees whether there is light enough for the sensor, if it needs light."""
    started: bool = False

    def __post_init__(self) -> None:
        """Let the run's frames tell why there are no events, if there are none."""
        self.silence = Silence(self.pipeline.progress, self.about, self.world)
        self.pipeline.watchers.append(self.silence)

    def start(self) -> None:
        """Write the sidecars, which a kill leaves as they are then, and start the pipeline.

        Where a file is to be replaced, it and what is beside it are written when the first frame is there.

        Raises:
            InputError: a sidecar cannot be written; the outputs are closed then.
        """
        self.started = True
        try:
            for output in self.pipeline.outputs:
                output.at_first_frame(partial(self._begin, output))
            self.pipeline.start()
        except BaseException:
            self.pipeline.stop()
            raise

    def _begin(self, output: Output) -> None:
        self._write_sidecar(output, complete=False)
        if output.sidecar is not None and self.world is not None:
            output.poses = PoseFile(poses_path(output.name), self.world.camera, self.schedule)

    def run(self) -> Summary:
        """Run from the start to the end and return what was done.

        Raises:
            SinkError: an output failed on the way; the others are complete.
            BaseException: whatever ended the run, Ctrl-C for one; all outputs are closed then, as far as they can be.
        """
        self.start()
        try:
            self.pipeline.wait()
        except BaseException:
            self.pipeline.stop()
            self.write_sidecars(complete=False)
            raise
        self.write_sidecars(complete=True)
        self.raise_failures()
        return self.summary()

    def raise_failures(self) -> None:
        """Raise SinkError if any output has failed."""
        failures = [output.error for output in self.pipeline.outputs if output.error is not None]
        if failures:
            raise SinkError("; ".join(failures))

    def summary(self) -> Summary:
        """Return what the run did so far."""
        progress = self.pipeline.progress
        wall_s = time.perf_counter() - self.wall_start_s
        startup_s = progress.first_frame_s
        running_s = wall_s - (startup_s or 0.0)
        level = self.level if self.governed is None else self.governed.level
        return Summary(
            name=self.name,
            width=self.width,
            height=self.height,
            frames=progress.frames,
            events=progress.events,
            on_events=progress.on_events,
            solved_share=progress.solved_share if self.solves else None,
            masked_pixels=progress.masked_pixels,
            steep_pixels=progress.steep_pixels,
            most_crossings=progress.most_crossings,
            capped_events=progress.capped_events,
            noise_share=progress.noise_share if self.ideal else None,
            ideal_noise_share=None if self.ideal else progress.noise_share,
            lost_events=progress.lost_events,
            dropped_frames=progress.dropped_frames,
            late_frames=progress.late_frames,
            paths=progress.paths,
            first_hit_rays=progress.first_hit_rays,
            light_s=progress.light_s,
            effort=None if level is None else level.effort,
            governor=None if self.governed is None else self.governed.summary(),
            simulated_s=(progress.simulated_us - (progress.first_us or 0)) / 1e6,
            wall_s=wall_s,
            cpu_s=_cpu_s() - self.cpu_start_s,
            startup_s=startup_s,
            frames_per_s=progress.frames / running_s if running_s > 0 else 0.0,
            motion=None if self.footage is None else self.footage.displacement.as_dict(),
            chosen=self.chosen,
            too_dark=None if self.meter is None else self.meter.told,
            no_events=None if self.meter is not None and self.meter.told else self.silence.told,
            outputs=[_output_summary(output) for output in self.pipeline.outputs],
        )

    def write_sidecars(self, *, complete: bool) -> None:
        """Write NAME.json beside every output that is a file, with the summary of a run that has ended."""
        summary = self.summary().as_dict()
        for output in self.pipeline.outputs:
            if not output.waits:
                self._write_sidecar(output, complete=complete, summary=summary)

    def _write_sidecar(self, output: Output, **more: Any) -> None:
        if output.sidecar is not None:
            poses = {} if self.world is None else {"poses": poses_path(output.name).name}
            scene = scene_from_here(self.about, output.sidecar.parent)
            told = {"warnings": list(self.warnings)}
            write_sidecar(output.sidecar, self.about | scene | poses | told | more)


@dataclass(frozen=True)
class RigMember:
    """A camera of a rig, as its session needs it.

    Attributes:
        world: the scene with this camera.
        view: makes its view of the scene that all cameras share.
        facts: what files tell of it.
    """

    world: World
    view: Callable[[Stages, InterestBoard | None], View]
    facts: Mapping[str, Any]


def open_live(
    options: LiveOptions,
    extra_sinks: Sequence[Sink] = (),
    told: Mapping[str, Any] = MappingProxyType({}),
    member: RigMember | None = None,
    world: World | None = None,
) -> Session:
    """Load the scene, open the outputs and prepare to render; raises InputError before anything is rendered.

    ``told`` takes the place of options in what files tell of their making. With a ``member`` or a ``world`` nothing is
    loaded.
    """
    from clsim.live.recording import recorder_openers
    from clsim.render import PathTracer

    started = now()
    stages = plan_stages(options, world if member is None else member.world)
    options = stages.options
    world, config, camera, point = stages.world, stages.detector, stages.world.camera, options.point
    schedule = plan(
        world.duration_s,
        stages.fps,
        duration_s=options.duration_s,
        frames=options.frame_count,
        loop=options.loop,
        periodic=_is_periodic(world),
    )
    probe_spp = stages.render.probe_spp or point.spp
    retracing = stages.retracing if options.time == "adaptive" else None
    tolerance_us = None if retracing is None else retracing.tolerance_us
    cached = stages.render.light_cache
    level = Level(probe_spp, point.spp, point.first_hit_rays, point.probe_every, tolerance_us, cached=cached)
    # Who wants truth wants it of all frames, and steps between which pixels are traced stay short.
    levels = ladder(level, 0.0 if options.truth or retracing is not None else stages.fps)
    governed = Governed(levels, stages.fps) if options.governed else None
    # Pixels that share uncached light, or a window, with their neighbours need these sampled twice too.
    by_paths = not stages.render.first_hit_rays
    duplicates: DuplicateSampling | None = None
    if not config.facts.windowed and (cached or by_paths):
        stages = replace(stages, render=replace(stages.render, duplicate_every=DUPLICATE_EVERY))
        duplicates = DuplicatePixels(config)
    elif by_paths and (patches := patches_for(config, camera.width, camera.height)) is not None:
        stages = replace(stages, render=replace(stages.render, duplicate_in=patches))
        duplicates = DuplicatePatches(config, patches, stages.planes, choose_device(options.opencl))
    board = stages.board("wait" if options.ring == "block" else "newest")
    window = None if "window" in config.without_use() else config.side
    about = about_run(options.as_dict() | {"window": window}, config, schedule.fps, options.sensor)
    about["options"] = about["options"] | dict(told)
    about |= {} if member is None else member.facts
    own = recorder_openers(options, options.seed, world, schedule, about, stages.render.truth_every)
    outputs = open_sinks(options.outputs, options.files, extra_sinks, (camera.width, camera.height), own)
    pipeline = Pipeline(
        lambda: stages.shown_by(
            PathTracer(world, stages.render, board) if member is None else member.view(stages, board)
        ),
        lambda: stages.build_detector(schedule),
        outputs,
        schedule,
        (stages.planes, camera.height, camera.width),
        ring=options.ring,
        in_step=stages.in_step,
        pace=options.pace,
        board=board,
        governed=governed,
        share_cores=options.render_device == "cpu",
        duplicates=duplicates,
        significance=Significance(config, options.ideal) if config.facts.knows_error and duplicates is None else None,
    )
    meter = meter_for(options.sensor, world.sensor)
    pipeline.watchers += [] if meter is None else [meter]
    return Session(
        world.name,
        camera.width,
        camera.height,
        schedule,
        pipeline,
        about | {"camera": about_camera(camera)},
        stages.warnings,
        (*world.notes, *stages.notes, *_settings_notes(options)),
        *started,
        config.facts.regresses,
        level,
        governed,
        world,
        chosen=stages.chosen,
        truth_every=stages.render.truth_every if options.truth else 0,
        ideal=options.ideal,
        labelled=options.files.labels or "labels" in options.truth,
        meter=meter,
    )


def _settings_notes(options: LiveOptions) -> list[str]:
    """Return what the user should know of settings that follow from other options."""
    notes = []
    if options.quality is not None or options.pace == "real":
        notes.append(f"{options.basis}: {options.point.text()}")
    if options.pace == "real" and options.governor and options.ungovernable is not None:
        notes.append(f"no governor, because of {options.ungovernable}: frames may be late")
    return notes


def open_recording(options: RecordingOptions, extra_sinks: Sequence[Sink] = ()) -> Session:
    """Open a sequence of EXR frames and the outputs; raises InputError before anything is detected."""
    from clsim.frames.exr import ExrSequence

    started = now()
    source = ExrSequence(options.frames, options.fps)
    if options.config.bandwidth == "fixed" and options.config.shrink == 0:
        # Nothing reads the variances then, so they need not be converted frame by frame.
        without_variances = [name for name in source.names if name not in VARIANCE_PLANES]
        source = ExrSequence(options.frames, options.fps, without_variances)
    fps = options.fps or _without_rounding(source.recorded_fps, options.rendered_fps)
    count, size = len(source.files), (source.width, source.height)
    schedule = Schedule(fps, count, count, recorded_times=options.fps is None)
    pipeline = Pipeline(
        lambda: source,
        detector_maker(
            options.config,
            size,
            source.names,
            options.opencl,
            options.seen_by.specimen(options.config.scale),
        ),
        open_sinks(options.outputs, options.files, extra_sinks, size),
        schedule,
        (source.names, source.height, source.width),
    )
    about = about_run(options.as_dict(), options.config, schedule.fps, options.seen_by.sensor)
    about["camera"] = {"width": source.width, "height": source.height}
    name = str(options.frames)
    solves = options.config.facts.regresses
    return Session(
        name,
        source.width,
        source.height,
        schedule,
        pipeline,
        about,
        (*unused_options(options.config), *cost_of(options.seen_by.sensor, source.width, source.height)),
        (),
        *started,
        solves,
        labelled=options.files.labels,
    )


def _without_rounding(recorded_fps: float, rendered_fps: float | None) -> float:
    """Return the rate of a recording: that of its rendering where the times, each rounded to µs, agree with it."""
    if rendered_fps is not None and abs(1e6 / rendered_fps - 1e6 / recorded_fps) <= 1.0:
        return rendered_fps
    return recorded_fps


def now() -> tuple[float, float]:
    """Return wall clock and processor time [s], as a session's start."""
    return time.perf_counter(), _cpu_s()


def _cpu_s() -> float:
    """Return the processor time of this process and of those it began and saw end."""
    return sum(os.times()[:4])


def _output_summary(output: Output) -> dict[str, Any]:
    info: dict[str, Any] = {"name": output.name}
    if isinstance(output.sink, Reporting):
        info |= output.sink.report()
    if output.error is not None:
        info["error"] = output.error
    if output.waits:
        info["replaced"] = False
    return info


def _is_periodic(world: World) -> bool:
    if any(mesh.deformation is not None for mesh in world.meshes) or not world.light_repeats(world.duration_s):
        return False
    return all(np.allclose(m.pose(0.0), m.pose(world.duration_s), atol=1e-6) for m in world.motions())
