"""Models of MuJoCo's (MJCF) from files, which move by their physics."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.parsers import expat

import numpy as np

from clsim.errors import InputError
from clsim.scene.defaults.framing import RESOLUTION
from clsim.scene.driven import CAMERA
from clsim.scene.motion import Attached
from clsim.scene.world import World

_HEAD = 1 << 16
"""Bytes of a file in which its first element begins, comments before it included."""
_FPS = 120.0


def is_mjcf(path: Path) -> bool:
    """Whether the first element of an XML file is that of a model of MuJoCo's; False where it is no XML."""
    tags: list[str] = []
    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda tag, _: tags.append(tag)
    try:
        with path.open("rb") as file:
            parser.Parse(file.read(_HEAD), False)
    except (expat.ExpatError, OSError, LookupError, ValueError):
        pass  # who reads the file as a scene says what is wrong
    return tags[:1] == ["mujoco"]


def _resolution(model: Any) -> tuple[int, int]:
    """Return how many pixels the first camera has; one that tells none counts as one of a single pixel."""
    width, height = map(int, model.cam_resolution[0]) if model.ncam else (1, 1)
    return (width, height) if max(width, height) > 1 else RESOLUTION


def load_mujoco(path: Path) -> World:
    """Load a model, seen from its first camera, or as MuJoCo's viewer sees it at first where it has none.

    Bodies move by the model's physics from its initial state, with all controls at 0, as far as a run asks for; where
    nothing does in 5 s, all stands still.

    Raises:
        InputError: MuJoCo refuses the file, is not installed, or something cannot be shown.
    """
    if importlib.util.find_spec("mujoco") is None:
        raise InputError(f"{path}: models of MuJoCo's need mujoco; install it with: pip install 'clsim[mujoco]'")
    import mujoco

    from clsim.scene.mujoco.course import DURATION_S, Course, Track
    from clsim.scene.mujoco.model import ShownModel
    from clsim.scene.mujoco.warnings import warnings_to

    told: list[str] = []
    try:
        with warnings_to(told):
            model = mujoco.MjModel.from_xml_path(str(path))
            data = mujoco.MjData(model)
            shown = ShownModel(model, data, 0, _resolution(model))
    except (ValueError, mujoco.FatalError) as error:
        raise InputError(f"{path}: MuJoCo cannot load it ({' '.join(str(error).split())})") from None
    places = data.xpos, data.xquat, data.light_xpos, data.light_xdir, data.cam_xpos, data.cam_xmat
    if not all(np.isfinite(each).all() for each in places):
        raise InputError(f"{path}: has numbers that are not finite: expected a place for each body, light and camera")
    world = shown.world(path.stem, None, _FPS)
    world = replace(world, notes=(*world.notes, *(f"mujoco: {text}" for text in told)))
    if not world.instances:
        raise InputError(f"{path}: has no triangles: the model has no geoms, or none in the groups that MuJoCo shows")
    course = Course(path, model, data, shown)
    if course.stands_still():
        return world
    tracks = {name: Track(course, row) for row, name in enumerate(course.names)}

    def moved(each: Any) -> Any:
        track = tracks.get(each.name.partition("/")[0])
        if track is None:
            return each
        return replace(each, motion=Attached(track, each.motion.offset) if "/" in each.name else track)

    return replace(
        world,
        camera=replace(world.camera, motion=tracks.get(CAMERA, world.camera.motion)),
        instances=tuple(map(moved, world.instances)),
        punctual_lights=tuple(map(moved, world.punctual_lights)),
        duration_s=DURATION_S,
    )
