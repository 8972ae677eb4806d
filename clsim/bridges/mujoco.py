"""MuJoCo: a model becomes a world, and a simulator follows its data, physics step by physics step.

>>> scene = MujocoScene(model, data, camera="eye")  # doctest: +SKIP
>>> with clsim.Simulator(scene.world, clock="caller") as simulator:  # doctest: +SKIP
...     scene.follow(simulator)
...     for _ in range(8):
...         mujoco.mj_step(model, data)
...         scene.follow(simulator)
...     events = simulator.step(scene.time_us)

An environment of Gymnasium's follows it too: ``EventObservation(env, simulator, scene.follow)``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from clsim.scene import Sensor, World
from clsim.scene.mujoco.model import ShownModel

if TYPE_CHECKING:
    from clsim.simulator import Simulator


class MujocoScene:
    """A model and its data as a world, +y up: x, y, z here are x, z, −y there.

    Each body that can move is an object under its own name, or ``body3`` where it has none (a slash in a name becomes a
    colon), and is made of its geoms. Flexible bodies, skins, tendons, and the skybox are left out, as the ``warnings``
    of the world say.

    Attributes:
        world: the world, with everything where it is in ``data`` now.
        time_us: time of ``data`` since the scene was made, or since its time went back [µs].
    """

    def __init__(
        self,
        model: Any,
        data: Any,
        *,
        camera: str | int = 0,
        resolution: tuple[int, int] = (346, 260),
        sensor: Sensor | None = None,
        fps: float = 1000.0,
    ) -> None:
        """Build the world.

        Args:
            model: an ``MjModel``.
            data: its ``MjData``; what has been computed of it is brought up to date.
            camera: name or number of a camera of the model; its vertical field of view holds, or its intrinsics.
                A model without cameras is seen as MuJoCo's own viewer sees it at first.
            resolution: width and height [pixels].
            sensor: the event pixel.
            fps: frames per simulated second, where the simulator is not told another number.

        Raises:
            InputError: there is no such camera, or something cannot be shown.
            clsim.Error: MuJoCo is not installed.
        """
        self._data, self._shown = data, ShownModel(model, data, camera, resolution)
        self._start_s = self._last_s = float(data.time)
        self.world: World = self._shown.world("mujoco", sensor, fps)

    @property
    def time_us(self) -> int:
        """Time of the data since the scene was made, or since its time went back [µs]."""
        return round((float(self._data.time) - self._start_s) * 1e6)

    def follow(self, simulator: Simulator) -> int:
        """Tell the simulator where all is at the data's time; call it before the first step and after each of MuJoCo's.

        It returns the data's time, as `time_us`. Where that went back, as in ``mj_resetData``, the simulator has to be
        reset before.
        """
        data, shown = self._data, self._shown
        if data.time < self._last_s:
            self._start_s = float(data.time)
        self._last_s = float(data.time)
        at_us = self.time_us
        if at_us == simulator.frame_time_us:
            return at_us
        shown.update()
        positions, quaternions = shown.body_places()
        for name, *place in zip(shown.bodies.values(), positions.tolist(), quaternions.tolist(), strict=True):
            simulator.set_pose(name, place, at_us)
        simulator.set_camera(shown.camera_pose(), at_us)
        for index, name in shown.lights.items():
            simulator.set_pose(name, shown.light_pose(index), at_us)
        return at_us
