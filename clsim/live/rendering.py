"""Frames as a live run would render them, one after the other in the caller's thread, for files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from typing import Any, cast

from clsim.errors import InputError
from clsim.frames import TRUTH_PLANES, Frame, page_aligned
from clsim.live.options import LiveOptions
from clsim.live.outputs.noting import NO_REQUESTS, NotingTracer, Requests
from clsim.live.outputs.sidecars import about_camera, about_run, camera_pose
from clsim.live.pacing.schedule import plan
from clsim.live.pipeline import InterestedDetector
from clsim.live.sensors import RecordedSensor
from clsim.live.stages import plan_stages
from clsim.truth.names import plane_names


class Rendering:
    """The frames of a run: what ``clsim detect`` makes of them is what the run itself would have fired at frames alone.

    What a run traces between frames is there where `LiveOptions.time` asks for it, and not where it is auto.

    Where sampling is adaptive a detector takes each frame, for it decides where the paths of later ones go.

    Attributes:
        width: of the frames [pixels].
        height: of the frames [pixels].
        frame_count: how many there are.
        warnings: what is asked for and will not be, one sentence each.
        notes: what was chosen where the scene leaves it open, likewise.
        settings: how they are rendered, in a few words.
        between: whether pixels are traced between frames.
        about: what a sidecar tells of the frames: options, the detector they were made for, camera, poses, and their
            times where these were given.
    """

    def __init__(self, options: LiveOptions, times_us: Sequence[int] | None = None) -> None:
        """Load the scene; raises InputError where it or an option cannot be used.

        Frames are at ``times_us`` [µs], which rise; None takes those of a run.
        """
        if options.loop:
            raise InputError("`loop` is for live runs; for frames give `duration_s` or `frame_count`")
        if options.truth and not plane_names(options.truth):
            raise InputError(f"`truth` {options.truth[0]} is no plane; frames hold of it {', '.join(TRUTH_PLANES)}")
        stages = self._stages = plan_stages(replace(options, time="fixed") if options.time == "auto" else options)
        world, camera = stages.world, stages.world.camera
        told = {} if times_us is None else {"times_us": list(times_us)}
        if times_us is None:
            schedule = plan(world.duration_s, stages.fps, duration_s=options.duration_s, frames=options.frame_count)
            times_us = [schedule.time_us(index) for index in range(schedule.total or 0)]
        elif options.truth:
            raise InputError("`times` are those of pictures; `truth` needs frames at an even rate")
        self.width, self.height = camera.width, camera.height
        self._times_us = times_us
        self.between = stages.retracing is not None
        self.frame_count = len(times_us)
        self.warnings, self.notes = stages.warnings, world.notes
        self.settings = stages.options.point.text()
        self.about: dict[str, Any] = about_run(stages.options.as_dict(), stages.detector, stages.fps) | {
            "detector": asdict(stages.detector),
            "seen_by": asdict(RecordedSensor(options.sensor, options.seed, stages.world.sensor.lux_per_unit)),
            "camera": about_camera(camera),
            "poses": [
                {"time_us": time_us, "camera_to_world": camera_pose(camera, time_us * 1e-6).tolist()}
                for time_us in times_us
            ],
            **told,
        }

    def frames(self) -> Iterator[Frame]:
        """Yield each frame, with its variances unless there are first-hit rays; the next one overwrites it."""
        return (frame for frame, _ in self.frames_and_requests())

    def frames_and_requests(self) -> Iterator[tuple[Frame, Requests]]:
        """Yield each frame, as `frames` does, and the pixels that were traced between it and the one before.

        There are none unless `LiveOptions.time` asks for them; then frames have no variances.
        """
        from clsim.render import View

        stages = self._stages
        board = stages.board("refuse")
        variances = stages.render.first_hit_rays == 0 and stages.retracing is None
        every_frame = replace(stages.render, variances=variances, truth_every=1)
        view = stages.shown_by(View(stages.scene_data(every_frame), every_frame, board))
        frame = Frame(page_aligned((len(view.names), self.height, self.width)), view.names)
        tracer = None if stages.retracing is None else stages.retracing.tracer(stages.world, None)
        noting = None if tracer is None else NotingTracer(tracer, self.width)
        detector = None if board is None and noting is None else stages.make_detector(noting)
        try:
            for index, time_us in enumerate(self._times_us):
                if stages.render.truth:
                    view.fill(index, frame)
                else:
                    view.fill_at(index, time_us, frame)
                if detector is not None:
                    detector.step(frame)
                if board is not None:
                    board.publish(cast(InterestedDetector, detector).interest())
                yield frame, NO_REQUESTS if noting is None else noting.take()
        finally:
            view.close()
            if detector is not None:
                detector.close()
