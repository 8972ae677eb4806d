"""Scenes by chance, what is asked of each, and the events that they had when they were last looked at.

``python -m tests.laws.as_before`` makes the events anew. Do so only where they are meant to change, and say why in the
commit: that a change meant to be none is none is what they are for.
"""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

import numpy as np
import numpy.typing as npt

import clsim
from clsim.render import scene_data
from clsim.render.features.scene_features import scene_features
from tests.laws.random_scenes import Scene, as_toml, scene_of
from tests.laws.rich_scenes import RICH, a_picture, rich_scene_of
from tests.shared_kernels import LIGHTS, MATERIALS, ORDINARY, widened

EVENTS = Path(__file__).parent / "as_before.npz"
GREY = {"kind": "diffuse", "color": [0.5, 0.25, 0.125]}
FISHEYE = {"model": "fisheye", "distortion": [0.05, -0.01, 0.0, 0.0], "aperture_radius_m": 0.01}

ASKED: dict[str, tuple[int, Scene, dict[str, Any]]] = {
    "balanced-1": (20, {}, {}),
    "balanced-2": (7, {}, {"threads": 1}),
    "balanced-3": (13, {}, {"seed": 5}),
    "balanced-4": (18, {"resolution": [37, 21]}, {"fps": 45.0}),
    "fixed-time": (9, {}, {"time": "fixed", "frame_count": 9}),
    "draft-1": (3, {}, {"quality": "draft"}),
    "draft-2": (5, {"resolution": [21, 37]}, {"quality": "draft", "frame_count": 16}),
    "accurate": (7, {}, {"quality": "accurate", "frame_count": 3}),
    "materials-1": (2, {}, {"sampling": "adaptive"}),
    "materials-2": (4, {}, {"sampling": "adaptive", "quality": "draft"}),
    "materials-3": (5, {}, {"sampling": "adaptive", "time": "fixed"}),
    "materials-4": (7, {}, {"sampling": "adaptive"}),
    "materials-5": (8, {}, {"sampling": "adaptive"}),
    "materials-6": (9, {}, {"sampling": "adaptive", "threads": 1}),
    "materials-7": (11, {}, {"sampling": "adaptive"}),
    "materials-8": (13, {}, {"sampling": "adaptive", "quality": "accurate"}),
    "standing-1": (22, {}, {"time": "adaptive", "frame_count": 12}),
    "standing-2": (30, {}, {}),
    "standing-3": (55, {}, {"quality": "draft", "time": "adaptive", "fps": 30.0}),
    "adaptive-time": (7, {}, {"time": "adaptive", "fps": 60.0}),
    "textured-1": (6, {}, {"frame_count": 24}),
    "textured-2": (8, {}, {"quality": "draft", "frame_count": 24}),
    "textured-3": (10, {}, {"seed": 3, "frame_count": 12}),
    "rich-1": (1, {}, {"sampling": "adaptive"}),
    "rich-2": (2, {}, {"sampling": "adaptive"}),
    "rich-3": (3, {}, {"sampling": "adaptive"}),
    "rich-4": (4, {}, {"sampling": "adaptive", "frame_count": 2}),
    "rich-5": (5, {}, {"sampling": "adaptive", "frame_count": 2}),
    "rich-6": (6, {}, {"sampling": "adaptive"}),
    "rich-cached-1": (11, {}, {}),
    "rich-cached-2": (8, {}, {}),
    "rich-cached-3": (9, {}, {}),
    "rich-cached-4": (10, {}, {}),
    "rich-cached-5": (2, {}, {"time": "adaptive", "fps": 60.0, "frame_count": 3}),
    "published": (6, {}, {"quality": "published", "frame_count": 60}),
    "irradiance": (13, {}, {"method": "irradiance"}),
    "confidence": (6, {}, {"confidence": 0.9, "frame_count": 40}),
    "exact": (6, {}, {"quality": "exact", "spp": 16, "frame_count": 40}),
    "lens": (13, {"lens": FISHEYE, "shutter_s": 0.004}, {"sampling": "adaptive"}),
}
"""The scene's seed, what its camera has, and the options of the run.

Materials of rich scenes, of the lens' and of those named for materials are what chance gave them; others are diffuse.
"""
OWN_KERNELS = ("accurate", "adaptive-time", "lens", "materials", "rich", "standing")
"""How the names of those begin for which kernels are compiled that no other quick test needs."""


def asked(name: str, folder: Path) -> tuple[Scene, dict[str, Any]]:
    """Return the scene of that name, and the options of its run; its pictures are written into the folder."""
    seed, camera, options = ASKED[name]
    scene = rich_scene_of(seed, folder) if name.startswith("rich") else scene_of(seed)
    if _known(name) is ORDINARY:
        for material in scene["materials"].values():
            seen = {"checker": material["checker"]} if "checker" in material else GREY
            if name.startswith("textured"):
                seen = {"texture": {"file": a_picture(folder), "repeats": [1.5, 2.0]}}
            material.clear()
            material |= {"kind": "diffuse"} | seen
    scene["camera"] |= camera
    return scene, {"frame_count": 6, "quality": "balanced", "threads": 2} | options


def events_of(name: str, folder: Path) -> npt.NDArray[np.void]:
    """Return the events of that run; the scene is written into the folder."""
    scene, options = asked(name, folder)
    path = folder / "scene.toml"
    path.write_text(as_toml(scene))
    with (
        patch.object(scene_data, "scene_features", widened(scene_features, _known(name))),
        clsim.stream(str(path), **options) as run,
    ):
        return np.concatenate([batch.copy() for batch in run])


def _known(name: str) -> dict[str, Any]:
    """Return what kernels of that run know, whatever its scene has."""
    if name.startswith("rich"):
        return LIGHTS | MATERIALS | RICH
    return LIGHTS | MATERIALS if name.startswith(("materials", "lens")) else ORDINARY


if __name__ == "__main__":
    with TemporaryDirectory() as made:
        found = {each: events_of(each, Path(made)) for each in sorted(ASKED)}
    np.savez_compressed(EVENTS, **found)
    print({each: len(events) for each, events in found.items()}, EVENTS.stat().st_size, file=sys.stderr)
