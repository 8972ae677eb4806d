"""A camera pipeline of a driven simulator: the stages of a live run, from its view of the scene to its events."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from clsim.detect.pack import FrameMemory
from clsim.errors import InputError, require_choice
from clsim.events import Causes, EventBatch
from clsim.frames import TRUTH_PLANES, Frame, page_aligned
from clsim.live.pipeline import InterestedDetector
from clsim.live.stages import Stages
from clsim.opencl.workplace import Workplace
from clsim.render import SceneData, View
from clsim.scene import Camera
from clsim.simulator.snapshot import Snapshot
from clsim.truth.cut import cut

_SHARED = (SceneData, Camera, FrameMemory, Workplace)
"""What a snapshot leaves as it is: the scene on its device, memory that is lent and taken back, kernels' arguments."""
_ELSEWHERE = {"poses": "; poses are what `Simulator.pose` returns"}


def check_truth(asked: Sequence[str]) -> None:
    """Raise InputError where what is asked for is recorded beside files alone, and no plane of a frame."""
    for name in asked:
        if name not in ("all", "none", "intensity", *TRUTH_PLANES):
            raise InputError(
                f"`truth` of a simulator must be of all, none, intensity, {', '.join(TRUTH_PLANES)}, got {name!r}"
                f"{_ELSEWHERE.get(name, '')}"
            )


class CameraPipeline:
    """One camera's view, frame and detector.

    Attributes:
        stages: what is rendered and how, and how events are found; `connect` builds them.
        view: what renders; None before.
        detector: what finds events; None before.
    """

    def __init__(self, stages: Stages) -> None:
        """Prepare; nothing is built yet."""
        self.stages = stages
        self.view: View | None = None
        self.detector: Any = None
        self._board: Any = None
        camera = stages.world.camera
        planes = stages.planes
        self._frame = Frame(page_aligned((len(planes), camera.height, camera.width)), planes)
        self._causes: list[Causes] = []

    def connect(self, data: SceneData) -> None:
        """Build a view of the scene, and a detector, without a past."""
        self.release()
        self._board = self.stages.board("refuse")
        self.view = self.stages.shown_by(View(data, self.stages.render, self._board, self.stages.world.camera))
        self.detector = self.stages.build_detector()

    def advance(self, number: int, time_us: int, before_us: int | None, data: SceneData) -> EventBatch:
        """Render the frame of that number and time, and return its events.

        ``before_us`` is the time of the frame before, if there was one.
        """
        assert self.view is not None, "it is connected first"
        stages = self.stages
        self.view.fill_at(number, time_us, self._frame)
        if stages.render.truth:
            after_us = time_us + round(1e6 / stages.fps)
            self.view.fill_truth(self._frame, before_us, after_us, after_us)
            data.restart_motion()  # a pose may yet be set for a time at which the scene was for the sake of flow
        events: EventBatch = self.detector.step(self._frame).copy()
        causes = getattr(self.detector, "causes", None)  # not all detectors tell them
        self._causes.append(np.zeros(len(events), np.uint8) if causes is None else causes)
        if self._board is not None:
            self._board.publish(cast(InterestedDetector, self.detector).interest())
        return events

    def forget_light(self) -> None:
        """Empty the radiance cache, if there is one, before the next frame."""
        if self.view is not None:
            self.view.forget_light()

    @property
    def causes(self) -> Causes:
        """What caused each event since `begin_step`: an index of `clsim.events.CAUSES`."""
        return np.concatenate([np.zeros(0, np.uint8), *self._causes])

    def begin_step(self) -> None:
        """Forget what caused the events of the last step."""
        self._causes.clear()

    def frame(self) -> Frame:
        """Return a copy of the last frame."""
        return self._frame.copy()

    def truth(self, names: tuple[str, ...]) -> dict[str, npt.NDArray[np.float32]]:
        """Return what is known of the last frame's pixels; raises InputError where a name is not among its planes."""
        known = ("intensity", *self.stages.render.truth)
        for name in names:
            if name in TRUTH_PLANES and name not in known:
                raise InputError(f"this simulator has no {name}: make it with truth=({name!r},)")
            require_choice("names", name, known)
        return cut(self.frame(), names or known)

    def snapshot(self) -> Snapshot:
        """Return all that the stages remember."""
        queue = getattr(self.detector, "queue", None)  # what runs in numpy has none
        return Snapshot((self.view, self.detector, self._board, self._frame, self._causes), queue, _SHARED)

    def release(self) -> None:
        """Release the devices' memory; safe to call twice."""
        for part in (self.view, self.detector):
            if part is not None:  # there is a view alone where no detector could be built
                part.close()
        self.view = self.detector = None
