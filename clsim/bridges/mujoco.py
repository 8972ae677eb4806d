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

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from clsim.bridges.mujoco_cameras import FREE, camera_of, free_pose
from clsim.bridges.mujoco_shapes import mesh_of
from clsim.bridges.mujoco_surfaces import Surfaces, headlight, light, sky
from clsim.errors import Error, InputError
from clsim.scene import Material, Mesh, Sensor, Static, World, WorldBuilder, look_at
from clsim.scene.driven import CAMERA
from clsim.scene.motion import Matrix

if TYPE_CHECKING:
    from clsim.simulator import Simulator

_SHOWN_GROUPS = 3
"""Groups of geoms that MuJoCo shows if it is not told otherwise: 0, 1 and 2. In the others are what collides unseen."""
_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""MuJoCo's world has +z up, ours +y."""
_HALF = math.sqrt(0.5)
_HEADLIGHT = "headlight"


class MujocoScene:
    """A model and its data as a world, +y up: x, y, z here are x, z, −y there.

    Each body that can move is an object under its own name, or ``body3`` where it has none (a slash in a name becomes a
    colon), and is made of its geoms. Flexible bodies, skins, tendons, and the skybox are left out, as ``warnings`` say.

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
        try:
            import mujoco
        except ImportError:
            raise Error("MuJoCo is not installed; pip install 'clsim[mujoco]'") from None
        self._model, self._data = model, data
        mujoco.mj_forward(model, data)
        self._camera = _camera_number(model, camera)
        self._start_s = self._last_s = float(data.time)
        self._moving: dict[int, str] = {}
        eye, lacking = camera_of(model, data, self._camera, resolution, Static(self._camera_pose()))
        builder = WorldBuilder(eye, "mujoco")
        self._add_bodies(builder)
        self._lights = self._add_lights(builder)
        world = builder.world(environment=sky(model), sensor=sensor, fps=fps)
        self.world: World = _with_warnings(world, model, lacking)

    @property
    def time_us(self) -> int:
        """Time of the data since the scene was made, or since its time went back [µs]."""
        return round((float(self._data.time) - self._start_s) * 1e6)

    def follow(self, simulator: Simulator) -> int:
        """Tell the simulator where all is at the data's time; call it before the first step and after each of MuJoCo's.

        It returns the data's time, as `time_us`. Where that went back, as in ``mj_resetData``, the simulator has to be
        reset before.
        """
        import mujoco

        model, data = self._model, self._data
        if data.time < self._last_s:
            self._start_s = float(data.time)
        self._last_s = float(data.time)
        at_us = self.time_us
        if at_us == simulator.time_us > 0:
            return at_us
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_camlight(model, data)
        bodies = list(self._moving)
        positions, quaternions = data.xpos[bodies] @ _UP.T, _lifted(data.xquat[bodies])
        for name, *place in zip(self._moving.values(), positions.tolist(), quaternions.tolist(), strict=True):
            simulator.set_pose(name, place, at_us)
        simulator.set_camera(self._camera_pose(), at_us)
        for index, name in self._lights.items():
            simulator.set_pose(name, self._light_pose(index), at_us)
        return at_us

    def _add_bodies(self, builder: WorldBuilder) -> None:
        model, surfaces = self._model, Surfaces(self._model, builder)
        for body in range(model.nbody):
            first = int(model.body_geomadr[body])
            parts: dict[str, tuple[Mesh, Matrix, Material]] = {}
            for geom in range(first, first + int(model.body_geomnum[body])):
                mesh = mesh_of(model, geom) if model.geom_group[geom] < _SHOWN_GROUPS else None
                material = None if mesh is None else surfaces.of(geom, mesh)
                if mesh is not None and material is not None:
                    offset = _matrix(model.geom_pos[geom], model.geom_quat[geom])
                    parts[_name(model.geom(geom).name, "geom", geom)] = (mesh, offset, material)
            if not parts:
                continue
            name = _name(model.body(body).name, "body", body)
            pose = _matrix(self._data.xpos[body], self._data.xquat[body])
            pose[:3] = _UP @ pose[:3]
            builder.add_parts(name, parts, pose)
            if model.body_weldid[body] != 0 or model.body_mocapid[body] >= 0:
                self._moving[body] = name

    def _add_lights(self, builder: WorldBuilder) -> dict[int, str]:
        """Add the lights and return the names of those that move, by number; the headlight's is −1."""
        model, found = self._model, {}
        active = np.flatnonzero(model.light_active).tolist()
        for index in active:
            name = f"light:{_name(model.light(index).name, 'light', index)}"
            builder.add_light(name, light(model, index, self._data.light_xpos[index]), self._light_pose(index))
            if model.body_weldid[model.light_bodyid[index]] != 0 or model.light_mode[index] != 0:
                found[index] = name
        if not active and model.vis.headlight.active:
            builder.add_light(_HEADLIGHT, headlight(model), self._camera_pose())
            found[-1] = _HEADLIGHT
        return found

    def _camera_pose(self) -> Matrix:
        if self._camera == FREE:
            pose = free_pose(self._model)
            pose[:3] = _UP @ pose[:3]
            return pose
        pose = np.eye(4)
        pose[:3, :3] = _UP @ self._data.cam_xmat[self._camera].reshape(3, 3)
        pose[:3, 3] = _UP @ self._data.cam_xpos[self._camera]
        return pose

    def _light_pose(self, index: int) -> Matrix:
        if index < 0:
            return self._camera_pose()
        place, towards = _UP @ self._data.light_xpos[index], _UP @ self._data.light_xdir[index]
        return look_at(place, place + towards)


def _camera_number(model: Any, camera: str | int) -> int:
    names = [model.camera(k).name for k in range(model.ncam)]
    if isinstance(camera, str) and camera in names:
        return names.index(camera)
    if model.ncam == 0 and camera == 0:
        return FREE
    if isinstance(camera, int) and 0 <= camera < model.ncam:
        return camera
    raise InputError(f"`camera` is {camera!r}, expected one of the model's: {', '.join(names) or 'it has none'}")


def _name(name: str, kind: str, index: int) -> str:
    """Return a name that our world can have; ``camera`` is what it calls its own."""
    own = name.replace("/", ":")
    return f"{kind}{index}" if own in ("", CAMERA) else own


def _matrix(position: Any, quaternion: Any) -> Matrix:
    """Return the 4×4 matrix of a position and a quaternion w, x, y, z."""
    import mujoco

    pose, turn = np.eye(4), np.zeros(9)
    mujoco.mju_quat2Mat(turn, quaternion)
    pose[:3, :3], pose[:3, 3] = turn.reshape(3, 3), position
    return pose


def _lifted(quaternions: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return quaternions x, y, z, w in our world of MuJoCo's w, x, y, z: a quarter turn about −x goes before them."""
    w, x, y, z = quaternions.T
    return np.stack([x - w, y + z, z - y, w + x], axis=1) * _HALF


def _with_warnings(world: World, model: Any, camera: str) -> World:
    import mujoco

    lacking = [
        (model.nflex, "flexible bodies"),
        (model.nskin, "skins"),
        (model.ntendon, "tendons"),
        ((model.geom_type == mujoco.mjtGeom.mjGEOM_SDF).sum(), "signed distance fields"),
        ((model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX).sum(), "a skybox"),
        ((model.mat_reflectance > 0).sum(), "reflectance"),
    ]
    left_out = [f"mujoco: the model has {what}, which clsim leaves out" for count, what in lacking if count]
    if camera:
        left_out.append(f"mujoco: {camera}")
    return replace(world, warnings=(*world.warnings, *left_out))
