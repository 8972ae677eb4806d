"""Scenes by chance with materials, textures and lamps of all kinds, which all need the same kernels."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from tests.laws.random_scenes import Scene, scene_of

RICH: dict[str, Any] = {
    "two_level": True,
    "bump_maps": True,
    "beckmann": True,
    "anisotropic": True,
    "absorption": True,
    "blends": False,
    "sphere_tree": False,
    "light_pictures": True,
    "light_tree": True,
    "environment_map": True,
    "motion_blur": False,
    "instants": True,
}
"""What kernels of these scenes know beyond lights, materials and textures."""
_PICTURES = {"large.png": (12, 16), "small-one.png": (5, 7)}
"""Rows and columns of each picture."""


def rich_scene_of(seed: int, folder: Path) -> Scene:
    """Return the scene of that seed, its materials and lamps made rich; the pictures are written into the folder."""
    for name in _PICTURES:
        a_picture(folder, name)
    scene, chance = scene_of(seed), _Chance(1000 + seed)
    for index, material in enumerate(scene["materials"].values()):
        _enrich(material, chance)
        if index and material["kind"] in ("diffuse", "principled") and chance.happens(0.4):
            mode = chance.one_of("mask", "blend")
            material |= {"alpha_mode": mode, "opacity": 0.75, "opacity_texture": chance.picture()}
    orbit = {"center": [0.0, 0.5, 0.0], "radius_m": 0.75, "period_s": chance.number(1, 3)}
    scene["objects"].append({"shape": "box", "size": [0.25, 0.5, 0.25], "orbit": orbit, "material": "m0"})
    _add_lamps(scene, chance)
    return scene


def a_picture(folder: Path, name: str = "large.png") -> str:
    """Write a picture of random colours, some of them translucent, and return its name."""
    noise = np.random.default_rng(len(name)).integers(40, 256, (*_PICTURES[name], 4))
    Image.fromarray(noise.astype(np.uint8), "RGBA").save(folder / name)
    return name


class _Chance:
    """What chance gives."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)

    def number(self, low: float, high: float) -> float:
        return round(self._random.uniform(low, high) * 256) / 256

    def colour(self, low: float, high: float) -> list[float]:
        return [self.number(low, high) for _ in range(3)]

    def happens(self, share: float) -> bool:
        return self._random.random() < share

    def one_of(self, *these: Any) -> Any:
        return self._random.choice(these)

    def picture(self) -> Scene:
        """Return the table of a texture."""
        wrap, nearest = self.one_of("repeat", "clamp", "mirror"), self.happens(0.3)
        return {"file": self.one_of(*sorted(_PICTURES)), "wrap": wrap, "nearest": nearest, "repeats": [2.0, 1.5]}

    def flicker(self) -> Scene:
        """Return how a lamp changes, or nothing."""
        sine = {"kind": "sine", "frequency_hz": self.number(20, 90), "depth": self.number(0.1, 0.9)}
        return {"modulation": sine} if self.happens(0.5) else {}


def _enrich(material: Scene, chance: _Chance) -> None:
    """Give a material more of what its kind may have."""
    kind, rough = material["kind"], bool(material.get("roughness"))
    if "checker" not in material and "dielectric" not in kind and chance.happens(0.4):
        material["texture"] = chance.picture()
    if rough and kind in ("conductor", "dielectric", "plastic"):
        material["distribution"] = chance.one_of("ggx", "beckmann")
    if rough and kind in ("conductor", "dielectric", "disney"):
        material["stretch"] = chance.one_of(0.5, 1.0, 2.0)
    if kind == "conductor" and chance.happens(0.5):
        material["metal"] = chance.one_of("Au", "Cu")
    if kind == "dielectric":
        material |= {"ior": chance.number(1.1, 1.8), "absorption": chance.colour(0, 3)}
    if kind == "plastic":
        material["nonlinear"] = chance.happens(0.5)
    if kind == "principled":
        material["roughness_texture"] = chance.picture()
    if kind == "disney":
        shares = ("specular_tint", "sheen", "sheen_tint", "flatness", "clearcoat", "clearcoat_roughness")
        material |= {share: chance.number(0, 1) for share in shares}
        material["transmission"] = chance.one_of(0.0, 0.0, 0.75)
    if "dielectric" not in kind:
        material["back"] = chance.one_of("same", "same", "black", "culled")
        if chance.happens(0.3):
            material |= {"normal_texture": chance.picture(), "normal_scale": 0.25}
        elif chance.happens(0.3):
            material |= {"bump_texture": chance.picture(), "bump_scale": 0.02}


def _add_lamps(scene: Scene, chance: _Chance) -> None:
    """Add an area lamp, a spot, a sun and a sky with a picture."""
    lamp = {"color": [0.0] * 3, "emission": chance.colour(2, 9), "emits_behind": chance.happens(0.5)}
    if chance.happens(0.5):
        lamp["emission_texture"] = chance.picture()
    scene["materials"]["lamp"] = lamp | chance.flicker()
    turn = [chance.number(-180, 180) for _ in range(3)]
    way = [
        {"time_s": time_s, "position": [chance.number(-1, 1), 1.5, 0.0], "rotation_deg": turn}
        for time_s in (0.0, 0.025, 0.05)
    ]
    joined = {"keyframes": way, "interpolation": chance.one_of("linear", "cubic")}
    there = joined if chance.happens(0.5) else {"position": [0.5, 1.5, 0.0], "rotation_deg": turn}
    scene["objects"].append({"shape": "quad", "size": [0.5, 0.75], "material": "lamp", **there})
    spot = {"kind": "spot", "position": [chance.number(-1, 1), 1.75, 1.0], "look_at": [0.0, 0.25, 0.0]}
    spot |= {
        "intensity": chance.colour(4, 20),
        "inner_deg": chance.number(0, 30),
        "outer_deg": 40.0,
        **chance.flicker(),
    }
    if chance.happens(0.5):
        spot["picture"] = {"file": "large.png"}
    turn = [chance.number(-90, -20), chance.number(-40, 40), 0.0]
    sun = {"kind": "directional", "intensity": chance.colour(0.2, 2), "rotation_deg": turn}
    scene.setdefault("lights", []).extend([spot, sun])
    sky = {"radiance": chance.colour(0.05, 0.2), "map": "small-one.png", "map_scale": chance.number(0.1, 0.8)}
    turns = {"map_rotation_deg": chance.number(0, 360), "map_turn_deg_per_s": chance.number(0, 90)}
    scene["environment"] = sky | turns
