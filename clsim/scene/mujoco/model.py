"""A model of MuJoCo's as a world, with what of it moves."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.errors import Error, InputError
from clsim.scene.builder import WorldBuilder
from clsim.scene.driven import CAMERA
from clsim.scene.motion import Matrix, Static, look_at
from clsim.scene.mujoco.cameras import FREE, camera_of, free_pose
from clsim.scene.mujoco.shapes import mesh_of
from clsim.scene.mujoco.surfaces import COLOR_ROLES, Surfaces, headlight, light, sky
from clsim.scene.world import Material, Mesh, Sensor, World
from clsim.values import read_value

_SHOWN_GROUPS = 3
"""Groups of geoms that MuJoCo shows if it is not told otherwise: 0, 1 and 2. In the others are what collides unseen."""
_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""MuJoCo's world has +z up, ours +y."""
_HALF = np.sqrt(0.5)
_HEADLIGHT = "headlight"


class ShownModel:
    """A model and its data, shown: x, y, z of our world are x, z, −y of MuJoCo's.

    Attributes:
        bodies: names of the bodies that can move, by number.
        lights: names of the lights that can move, or go with the camera, by number; the headlight's is −1.
        camera_moves: whether the camera can.
    """

    def __init__(self, model: Any, data: Any, camera: str | int, resolution: tuple[int, int]) -> None:
        """Bring the data up to date, and find what there is.

        Args:
            model: an ``MjModel``.
            data: its ``MjData``.
            camera: name or number of a camera of the model; one without cameras is seen as MuJoCo's viewer does.
            resolution: width and height [pixels].

        Raises:
            InputError: there is no such camera, or one of the first two is something else.
            clsim.Error: MuJoCo is not installed.
        """
        try:
            import mujoco
        except ImportError:
            raise Error("MuJoCo is not installed; pip install 'clsim[mujoco]'") from None
        for name, value, kind in (("model", model, mujoco.MjModel), ("data", data, mujoco.MjData)):
            if not isinstance(value, kind):
                raise InputError(f"`{name}` must be an {kind.__name__}, got {type(value).__name__}")
        if (len(data.qpos), len(data.xpos), len(data.geom_xpos)) != (model.nq, model.nbody, model.ngeom):
            raise InputError(
                f"`data` is of another model: it has {len(data.xpos)} bodies and {len(data.geom_xpos)} geoms, expected "
                f"{model.nbody} and {model.ngeom}"
            )
        mujoco.mj_forward(model, data)  # which would read beyond data that are smaller
        self._model, self._data = model, data
        self._resolution = read_value("resolution", resolution, tuple[int, int])
        self._camera = _camera_number(model, camera.item() if isinstance(camera, np.generic) else camera)
        self.camera_moves = self._camera != FREE and _goes(
            model, model.cam_bodyid[self._camera], model.cam_mode[self._camera]
        )
        self.bodies: dict[int, str] = {}
        self.lights: dict[int, str] = {}

    def world(self, name: str, sensor: Sensor | None, fps: float) -> World:
        """Return the world, with everything where it is in the data now; raises InputError for what cannot be shown."""
        eye = camera_of(self._model, self._camera, self._resolution, Static(self.camera_pose()))
        builder = WorldBuilder(eye, name)
        names = {CAMERA}
        surfaces = self._add_bodies(builder, names)
        self._add_lights(builder, names)
        world = builder.world(environment=sky(self._model), sensor=sensor, fps=fps)
        return _with_warnings(world, self._model, surfaces.means)

    def update(self) -> None:
        """Compute from the data's state where bodies, cameras and lights are; the state stays as it is."""
        import mujoco

        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)

    def body_places(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Return positions ``[B, 3]`` and quaternions x, y, z, w ``[B, 4]`` of `bodies`, in our world."""
        numbers = list(self.bodies)
        return self._data.xpos[numbers] @ _UP.T, _lifted(self._data.xquat[numbers])

    def camera_pose(self) -> Matrix:
        """Return the camera's pose ``[4, 4]`` in our world."""
        if self._camera == FREE:
            pose = free_pose(self._model)
            pose[:3] = _UP @ pose[:3]
            return pose
        pose = np.eye(4)
        pose[:3, :3] = _UP @ self._data.cam_xmat[self._camera].reshape(3, 3)
        pose[:3, 3] = _UP @ self._data.cam_xpos[self._camera]
        return pose

    def light_pose(self, index: int) -> Matrix:
        """Return the pose ``[4, 4]`` of a light of that number in our world; it shines along −z."""
        if index < 0:
            return self.camera_pose()
        place, towards = _UP @ self._data.light_xpos[index], _UP @ self._data.light_xdir[index]
        return look_at(place, place + towards)

    def _add_bodies(self, builder: WorldBuilder, names: set[str]) -> Surfaces:
        model, surfaces = self._model, Surfaces(self._model, builder)
        for body in range(model.nbody):
            first = int(model.body_geomadr[body])
            parts: dict[str, tuple[Mesh, Matrix, Material]] = {}
            inside: set[str] = set()
            for geom in range(first, first + int(model.body_geomnum[body])):
                mesh = mesh_of(model, geom) if model.geom_group[geom] < _SHOWN_GROUPS else None
                material = None if mesh is None else surfaces.of(geom, mesh)
                if mesh is not None and material is not None:
                    offset = _matrix(model.geom_pos[geom], model.geom_quat[geom])
                    parts[_own(model.geom(geom).name or f"geom{geom}", inside)] = (mesh, offset, material)
            if not parts:
                continue
            name = _own(model.body(body).name or f"body{body}", names)
            pose = _matrix(self._data.xpos[body], self._data.xquat[body])
            pose[:3] = _UP @ pose[:3]
            builder.add_parts(name, parts, pose)
            if _goes(model, body, 0):
                self.bodies[body] = name
        return surfaces

    def _add_lights(self, builder: WorldBuilder, names: set[str]) -> None:
        model = self._model
        active = np.flatnonzero(model.light_active & ~_of_pictures(model)).tolist()
        for index in active:
            name = _own(f"light:{model.light(index).name or f'light{index}'}", names)
            builder.add_light(name, light(model, index, self._data.light_xpos[index]), self.light_pose(index))
            if _goes(model, model.light_bodyid[index], model.light_mode[index]):
                self.lights[index] = name
        if not active and model.vis.headlight.active:
            self.lights[-1] = _own(_HEADLIGHT, names)
            builder.add_light(self.lights[-1], headlight(model), self.camera_pose())


def _goes(model: Any, body: int, mode: int) -> bool:
    """Whether what is fixed to a body, or follows one by its mode, can move."""
    # Mocap bodies are the world's children. In MuJoCo 3.6 they count as welded to it, with all that is on them.
    carried = model.body_mocapid[model.body_rootid[body]] >= 0
    return bool(model.body_weldid[body] != 0 or carried or mode != 0)


def _camera_number(model: Any, camera: str | int) -> int:
    names = [model.camera(k).name for k in range(model.ncam)]
    if isinstance(camera, str) and camera in names:
        return names.index(camera)
    if model.ncam == 0 and camera == 0:
        return FREE
    if isinstance(camera, int) and 0 <= camera < model.ncam:
        return camera
    raise InputError(f"`camera` is {camera!r}, expected one of the model's: {', '.join(names) or 'it has none'}")


def _own(name: str, names: set[str]) -> str:
    """Return a name that our world can have, as near to that as can be, and add it to those that others have."""
    own = name.replace("/", ":")
    while own in names:
        own += "_"
    names.add(own)
    return own


def _of_pictures(model: Any) -> npt.NDArray[np.bool_]:
    """Tell which lights shine from a picture all around."""
    import mujoco

    return np.asarray(model.light_type == mujoco.mjtLightType.mjLIGHT_IMAGE)


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
    return np.asarray(np.stack([x - w, y + z, z - y, w + x], axis=1) * _HALF)


def _with_warnings(world: World, model: Any, means: int) -> World:
    import mujoco

    lacking = [
        (model.nflex, "flexible bodies"),
        (model.nskin, "skins"),
        (model.ntendon, "tendons"),
        (((model.site_group < _SHOWN_GROUPS) & (model.site_rgba[:, 3] > 0)).sum(), "sites"),
        (_of_pictures(model).sum(), "lights of pictures"),
        ((np.delete(model.mat_texid, COLOR_ROLES, axis=1) >= 0).sum(), "textures of other things than colours"),
        ((model.geom_type == mujoco.mjtGeom.mjGEOM_SDF).sum(), "signed distance fields"),
        ((model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX).sum(), "a skybox"),
        ((model.mat_reflectance > 0).sum(), "reflectance"),
        (means, "textures on things without coordinates (their mean colour stands in)"),
    ]
    left_out = [f"mujoco: the model has {what}, which clsim leaves out" for count, what in lacking if count]
    return replace(world, warnings=(*world.warnings, *left_out))
