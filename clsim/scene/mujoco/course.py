"""How a model of MuJoCo's moves by itself: its physics, computed as far as someone asks for it.

The state at every so many steps is kept, which is small, and where things are in between only lately: what was let go
of is computed anew, with the same bits. So a run may be long, and any of its times be asked for again.
"""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.scene.driven import CAMERA, place_of
from clsim.scene.motion import Matrix, compose, rotation_matrix, slerp
from clsim.scene.mujoco.model import ShownModel
from clsim.scene.mujoco.warnings import warnings_to

DURATION_S = 5.0
"""How long a run is where nothing is asked for [s]; physics has no end of its own."""
_STEPS = 256
"""Steps of the physics from one kept state to the next."""
_SPANS = 16
"""Spans of so many steps of which places are kept."""
_STILL = 1e-6
"""Change of positions [m] and quaternions up to which things stand still."""
F64 = npt.NDArray[np.float64]


class Course:
    """What moves in a model, step by step of its physics from the start, with nobody at the controls.

    Attributes:
        names: of what moves: bodies, lights, and the camera if it does.
    """

    def __init__(self, path: Path, model: Any, data: Any, shown: ShownModel) -> None:
        """Begin where the data is; nobody else may step it. ``path`` is named where the physics fails."""
        import mujoco

        self._path, self._model, self._data, self._shown = path, model, data, shown
        self._lock = threading.Lock()
        self._kind = int(mujoco.mjtState.mjSTATE_INTEGRATION)
        self._lights = [index for index in shown.lights if index >= 0 or shown.camera_moves]
        self.names = [*shown.bodies.values(), *(shown.lights[index] for index in self._lights)]
        self.names += [CAMERA] * shown.camera_moves
        self._states: list[F64] = [self._state()]
        self._spans: OrderedDict[int, F64] = OrderedDict()

    def stands_still(self) -> bool:
        """Whether nothing moves in `DURATION_S`."""
        last = math.ceil(DURATION_S / float(self._model.opt.timestep)) // _STEPS
        start = self._places(0)[0]
        return all((np.abs(self._places(span) - start) < _STILL).all() for span in range(last + 1))

    def pose(self, row: int, time_s: float) -> Matrix:
        """Return the pose ``[4, 4]`` at that time of what has that number in `names`.

        Between steps it goes straight and turns by slerp.

        Raises:
            InputError: the physics fails before that time.
        """
        steps = max(time_s, 0.0) / float(self._model.opt.timestep)
        span, step = divmod(int(steps), _STEPS)
        weight = steps - int(steps)
        before, after = self._places(span)[step : step + 2, row]
        turn = rotation_matrix(slerp(before[3:], after[3:], weight))
        return compose((1.0 - weight) * before[:3] + weight * after[:3], turn)

    def _places(self, span: int) -> F64:
        """Return positions and quaternions x, y, z, w in a span, its end included: ``[steps + 1, names, 7]``."""
        with self._lock:
            for number in range(min(span, len(self._states) - 1), span + 1):
                if number in self._spans:
                    self._spans.move_to_end(number)
                else:
                    self._spans[number] = self._computed(number)
                    if len(self._spans) > _SPANS:
                        self._spans.popitem(last=False)
            return self._spans[span]

    def _computed(self, span: int) -> F64:
        import mujoco

        model, data = self._model, self._data
        bad = mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC
        mujoco.mj_setState(model, data, self._states[span], self._kind)
        places = [self._now()]
        with warnings_to([]):
            for step in range(_STEPS):
                mujoco.mj_step(model, data)
                if any(data.warning[each].number for each in bad):  # MuJoCo has gone back to the start
                    at_s = (span * _STEPS + step + 1) * float(model.opt.timestep)
                    raise InputError(
                        f"{self._path}: its physics is unstable at {at_s:.3g} s; expected a smaller timestep than "
                        f"{model.opt.timestep:g} s, or a stabler integrator"
                    )
                places.append(self._now())
        if span + 1 == len(self._states):
            self._states.append(self._state())
        return np.array(places)

    def _state(self) -> F64:
        import mujoco

        state = np.empty(mujoco.mj_stateSize(self._model, self._kind))
        mujoco.mj_getState(self._model, self._data, state, self._kind)
        return state

    def _now(self) -> F64:
        """Return where all is now, ``[names, 7]``."""
        shown = self._shown
        shown.update()
        matrices = [shown.light_pose(index) for index in self._lights]
        matrices += [shown.camera_pose()] * shown.camera_moves
        others = [(*position, *rotation) for position, rotation, _ in map(place_of, matrices)]
        bodies = np.concatenate(shown.body_places(), axis=1)
        return np.concatenate([bodies, np.array(others).reshape(-1, 7)])


class Track:
    """The motion of one thing of a course; it goes on beyond ``duration_s``."""

    def __init__(self, course: Course, row: int) -> None:
        """Follow what has that number in the course's names."""
        self._course, self._row = course, row

    @property
    def duration_s(self) -> float:
        """How long a run is where nothing is asked for [s]."""
        return DURATION_S

    def pose(self, time_s: float) -> Matrix:
        """Return the pose at that time; raises InputError where the physics fails before."""
        return self._course.pose(self._row, time_s)
