"""Scenes by chance, and the same scenes larger, brighter, or with a speck that nobody sees."""

from __future__ import annotations

import copy
import json
import random
from typing import Any

Scene = dict[str, Any]
SPECK = {
    "shape": "box",
    "size": [0.01] * 3,
    "keyframes": [{"time_s": 0.0, "position": [0.0, -30.0, 0.0]}, {"time_s": 1.0, "position": [0.5, -31.0, 0.0]}],
}
_KINDS = (
    "diffuse",
    "diffuse",
    "diffuse",
    "conductor",
    "dielectric",
    "thin-dielectric",
    "plastic",
    "principled",
    "disney",
)
_ROUGH = ("conductor", "dielectric", "plastic", "principled", "disney")


def scene_of(seed: int) -> Scene:
    """Return a room or a floor with some things and lamps; lengths and light are sums of powers of two.

    The camera moves, or something before it.
    """
    chance = random.Random(seed)

    def number(low: float, high: float) -> float:
        return round(chance.uniform(low, high) * 256) / 256

    def way(start: list[float], reach: float, **more: Any) -> Scene:
        end = [each + number(-reach, reach) for each in start]
        return {"keyframes": [{"time_s": 0.0, "position": start, **more}, {"time_s": 1.0, "position": end, **more}]}

    materials: Scene = {}

    def material() -> str:
        kind = chance.choice(_KINDS)
        made: Scene = {"kind": kind}
        if "dielectric" not in kind:
            colors = [[number(0.05, 0.9) for _ in range(3)] for _ in range(2)]
            made["color"] = colors[0]
            if chance.random() < 0.4:
                squares = float(chance.choice((1, 2, 4, 8)))
                del made["color"]
                made["checker"] = {"color_a": colors[0], "color_b": colors[1], "squares_per_m": squares}
        if kind in _ROUGH:
            made["roughness"] = chance.choice((0.0, 0.125, 0.25, 0.5, 0.875))
        if kind in ("principled", "disney"):
            made["metallic"] = chance.choice((0.0, 0.0, 0.5, 1.0))
        materials[f"m{len(materials)}"] = made
        return f"m{len(materials) - 1}"

    def wall(size: list[float], position: list[float], turn: list[float]) -> Scene:
        return {"shape": "quad", "size": size, "position": position, "rotation_deg": turn, "material": material()}

    objects = [wall([4.0, 4.0], [0.0] * 3, [0.0] * 3)]
    if chance.random() < 0.7:
        objects.append(wall([4.0, 2.0], [0.0, 1.0, -2.0], [90.0, 0.0, 0.0]))
        objects += [wall([2.0, 4.0], [2.0 * side, 1.0, 0.0], [0.0, 0.0, 90.0 * side]) for side in (-1, 1)]
    moves = False
    for _ in range(chance.randint(1, 4)):
        shape = chance.choice(("box", "sphere", "quad"))
        sizes = {
            "box": {"size": [number(0.1, 0.7) for _ in range(3)]},
            "sphere": {"radius_m": number(0.1, 0.4), "segments": 12},
            "quad": {"size": [number(0.2, 1.0) for _ in range(2)]},
        }
        place, turn = [number(-1, 1), number(0.3, 1.2), number(-1.5, 0.5)], [number(-90, 90) for _ in range(3)]
        stands = chance.random() < 0.55
        moves = moves or not stands
        there = {"position": place, "rotation_deg": turn} if stands else way(place, 1.0, rotation_deg=turn)
        objects.append({"shape": shape, "material": material(), **sizes[shape], **there})
    eye, look = [number(-1, 1), number(0.6, 1.5), number(1.0, 1.9)], [number(-0.5, 0.5), number(0.3, 0.9), -1.0]
    seen = {"position": eye, "look_at": look} if moves and chance.random() < 0.4 else way(eye, 0.8, look_at=look)
    scene: Scene = {"fps": 120.0, "camera": {"resolution": [32, 24], "fov_deg": 50.0, **seen}}
    scene |= {"sensor": {"scale": 1.0, "floor": 2.0**-13}, "materials": materials, "objects": objects}
    for _ in range(chance.randint(1, 3)):
        place = [number(-1.5, 1.5), number(1.2, 1.9), number(-1.5, 1.5)]
        there = {"position": place} if chance.random() < 0.8 else way(place, 0.5)
        kind = chance.choice(("sphere", "sphere", "point", "sky"))
        if kind == "sphere":
            lamp = {**there, "radius_m": number(0.05, 0.3), "radiance": [number(2, 60)] * 3}
            scene.setdefault("sphere_lights", []).append(lamp)
        elif kind == "point":
            scene.setdefault("lights", []).append({"kind": "point", **there, "intensity": [number(1, 20)] * 3})
        else:
            scene["environment"] = {"radiance": [number(0.1, 2)] * 3}
    return scene


def larger(scene: Scene, times: float) -> Scene:
    """Return the scene with all lengths so many times as large, which looks the same."""
    made = copy.deepcopy(scene)
    for table in (made["camera"], *made["objects"], *made.get("sphere_lights", []), *made.get("lights", [])):
        for place in (table, *table.get("keyframes", [])):
            for key in ("position", "look_at", "size"):
                if key in place:
                    place[key] = [each * times for each in place[key]]
        if "radius_m" in table:
            table["radius_m"] *= times
        if "intensity" in table:
            table["intensity"] = [each * times**2 for each in table["intensity"]]
    for material in made["materials"].values():
        if "checker" in material:
            material["checker"]["squares_per_m"] /= times
    return made


def brighter(scene: Scene, times: float) -> Scene:
    """Return the scene in so many times the light, before a sensor that sees the same of it."""
    made = copy.deepcopy(scene)
    lamps = [*made.get("sphere_lights", []), *made.get("lights", []), made.get("environment", {})]
    for lamp in lamps:
        for key in ("radiance", "intensity"):
            if key in lamp:
                lamp[key] = [each * times for each in lamp[key]]
    made["sensor"]["scale"] /= times
    return made


def at_rest(scene: Scene) -> Scene:
    """Return the scene as it is at first, for ever."""
    made = copy.deepcopy(scene)
    for table in (made["camera"], *made["objects"], *made.get("sphere_lights", []), *made.get("lights", [])):
        for place in table.pop("keyframes", [])[:1]:
            table |= place
            del table["time_s"]
    return made


def with_speck(scene: Scene) -> Scene:
    """Return the scene with a box of 1 cm that moves far below the floor."""
    return scene | {"objects": [*scene["objects"], SPECK]}


def as_toml(scene: Scene) -> str:
    """Return the scene as the text of a file."""

    def value(of: Any) -> str:
        if isinstance(of, dict):
            return "{ " + ", ".join(f"{key} = {value(each)}" for key, each in of.items()) + " }"
        if isinstance(of, list):
            return "[" + ", ".join(map(value, of)) + "]"
        return json.dumps(of)

    return "\n".join(f"{key} = {value(of)}" for key, of in scene.items()) + "\n"
