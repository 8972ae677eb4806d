"""Frames as a live run would render them, one after the other in the caller's thread, for files."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, replace
from typing import Any, cast

from clsim.errors import InputError
from clsim.frames import TRUTH_PLANES, Frame, page_aligned
from clsim.live.options import LiveOptions
from clsim.live.pipeline import InterestedDetector
from clsim.live.schedule import plan
from clsim.live.sensors import RecordedSensor
from clsim.live.sidecars import about_camera, about_run, camera_pose
from clsim.live.stages import plan_stages
from clsim.truth.names import plane_names


class Rendering:
    """The frames of a run: what ``clsim detect`` makes of them is what the run itself would have fired.

    Where sampling is adaptive a detector looks at each frame, for it decides where the paths of later ones go.

    Attributes:
        width: of the frames [pixels].
        height: of the frames [pixels].
        frame_count: how many there are.
        warnings: what is asked for and will not be, one sentence each.
        notes: what was chosen where the scene leaves it open, likewise.
        settings: how they are rendered, in a few words.
        about: what a sidecar tells of the frames: options, the detector they were made for, camera, poses.
    """

    def __init__(self, options: LiveOptions) -> None:
        """Load the scene; raises InputError where it or an option cannot be used."""
        if options.loop:
            raise InputError("`loop` is for live runs; for frames give `duration_s` or `frame_count`")
        if options.truth and not plane_names(options.truth):
            raise InputError(f"`truth` {options.truth[0]} is no plane; frames hold of it {', '.join(TRUTH_PLANES)}")
        stages = self._stages = plan_stages(options)
        world, camera = stages.world, stages.world.camera
        schedule = plan(world.duration_s, stages.fps, duration_s=options.duration_s, frames=options.frame_count)
        self.width, self.height = camera.width, camera.height
        self.frame_count = schedule.total or 0
        self.warnings, self.notes = stages.warnings, world.notes
        self.settings = stages.options.point.text()
        times_us = [schedule.time_us(index) for index in range(self.frame_count)]
        self.about: dict[str, Any] = about_run(stages.options.as_dict(), stages.detector, stages.fps) | {
            "detector": asdict(stages.detector),
            "seen_by": asdict(RecordedSensor(options.sensor, options.seed, stages.world.sensor.lux_per_unit)),
            "camera": about_camera(camera),
            "poses": [
                {"time_us": time_us, "camera_to_world": camera_pose(camera, time_us * 1e-6).tolist()}
                for time_us in times_us
            ],
        }

    def frames(self) -> Iterator[Frame]:
        """Yield each frame, with its variances unless there are first-hit rays; the next one overwrites it."""
        from clsim.render import View

        stages = self._stages
        board = stages.board("refuse")
        every_frame = replace(stages.render, variances=stages.render.first_hit_rays == 0, truth_every=1)
        view = View(stages.scene_data(), every_frame, board)
        frame = Frame(page_aligned((len(view.names), self.height, self.width)), view.names)
        detector = None if board is None else stages.build_detector()
        try:
            for index in range(self.frame_count):
                view.fill(index, frame)
                if detector is not None and board is not None:
                    detector.step(frame)
                    board.publish(cast(InterestedDetector, detector).interest())
                yield frame
        finally:
            view.close()
            if detector is not None:
                detector.close()
