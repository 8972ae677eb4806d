"""What is wrong with a scene's TOML: all of its problems at once, each with its key, what was found and expected."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, get_args, get_origin

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from clsim.errors import InputError
from clsim.scene.pictures.film import is_video
from clsim.scene.toml.schema import OBJECTS, CameraTable, MountTable, ObjectTable, SceneTable
from clsim.scene.toml.schema_base import Table
from clsim.scene.toml.schema_light import MODULATIONS
from clsim.scene.wording import plainly
from clsim.values import hint

_COUNTS = {2: "two", 3: "three", 4: "four"}
_ROUGH = ("conductor", "dielectric", "plastic", "principled", "disney")
KINDS_WITH: dict[str, tuple[str, ...]] = {
    "roughness": _ROUGH,
    "roughness_texture": _ROUGH,
    "metallic": ("principled", "disney"),
    "ior": ("dielectric", "thin-dielectric", "plastic", "principled", "disney"),
    "metal": ("conductor",),
    "eta": ("conductor",),
    "k": ("conductor",),
    "specular_color": ("conductor", "dielectric", "thin-dielectric", "plastic", "principled"),
    "distribution": ("conductor", "dielectric", "plastic"),
    "stretch": ("conductor", "dielectric", "disney"),
    "absorption": ("dielectric", "disney"),
    "nonlinear": ("plastic",),
    "specular_tint": ("disney",),
    "sheen": ("disney",),
    "sheen_tint": ("disney",),
    "flatness": ("disney",),
    "transmission": ("principled", "disney"),
    "clearcoat": ("principled", "disney"),
    "clearcoat_roughness": ("principled", "disney"),
}
"""Which kinds of material have a key; what is not named here all have."""
_SMALL_DEG = 2.0
"""Hardly a lens sees less, and radians are less."""


RENAMED: dict[str, tuple[tuple[str, ...], str]] = {
    "two_sided": (
        ("emits_behind", "back"),
        "expected emits_behind (whether the back emits too) and, for what it scatters, back, such as 'same' or 'black'",
    ),
}
"""Keys that once were: what took their place, and in words."""


def small_angles(scene: SceneTable, source: Path) -> Iterator[str]:
    """Yield a warning for each field of view that is likely in radians."""
    cameras: list[tuple[str, CameraTable | MountTable | None]] = [("camera", scene.camera)]
    cameras += [(f"cameras[{i}]", mount) for i, mount in enumerate(scene.cameras)]
    for key, table in cameras:
        if table is not None and table.fov_deg is not None and table.fov_deg < _SMALL_DEG:
            yield (
                f"{source.name}: {key}.fov_deg is {table.fov_deg:g}° (if it is in radians, write "
                f"{math.degrees(table.fov_deg):.4g})"
            )


def parse(data: dict[str, Any], source: Path) -> SceneTable:
    """Turn a TOML's contents into the checked scene.

    Raises:
        InputError: with all problems, one line each: file, key path, what was found and expected.
    """
    problems: list[str] = []
    scene = None
    try:
        scene = SceneTable.model_validate(data)
    except ValidationError as error:
        found = [e for e in error.errors(include_url=False) if not _follows_from_items(e)]
        problems = [f"{_key_path(e['loc'], data)}: {_sentence(e)}" for e in found]
    problems += _conflicts(data)
    if problems or scene is None:
        raise InputError("\n".join(f"{source}: {problem}" for problem in dict.fromkeys(problems)))
    return scene


def _follows_from_items(error: ErrorDetails) -> bool:
    """Tell whether a list is called too short only because what is wrong with its items was told before."""
    return error["type"] == "too_short" and len(error["input"]) >= error["ctx"]["min_length"]


def _conflicts(data: dict[str, Any]) -> Iterator[str]:
    """Yield what no single key can tell; works on raw data, so that these errors come along with all others."""
    if "camera" not in data and "base" not in data:
        yield "camera: is missing"
    materials = data.get("materials")
    materials = materials if isinstance(materials, dict) else {}
    names = list(materials)
    for name in names:
        for first, second in (("color", "checker"), ("texture", "checker"), ("metal", "eta"), ("metal", "k")):
            if _has(materials[name], first, second):
                yield f"materials.{name}: has {first} and {second}, expected one of them"
        if isinstance(materials[name], dict) and ("eta" in materials[name]) != ("k" in materials[name]):
            yield f"materials.{name}: has one of eta and k, expected both or none"
    for name in names:
        yield from _modulation_conflicts(f"materials.{name}", materials[name])
        yield from _film_conflicts(f"materials.{name}", materials[name])
        yield from _keys_of_other_kinds(f"materials.{name}", materials[name])
    environment = data.get("environment")
    yield from _modulation_conflicts("environment", environment)
    if _has(environment, "map", "daylight"):
        yield "environment: has map and daylight, expected one of them"
    for key in ("map_scale", "map_rotation_deg", "map_turn_deg_per_s"):
        if _has(environment, "daylight", key):
            yield f"environment: has daylight and {key}, which belongs to map"
    daylight = environment.get("daylight") if isinstance(environment, dict) else None
    if isinstance(daylight, dict) and ("elevation_deg" in daylight) == _has(daylight, "latitude_deg", "time"):
        yield "environment.daylight: expected either elevation_deg, or latitude_deg and time"
    mounts = data.get("cameras")
    called = [table.get("name") for table in mounts if isinstance(table, dict)] if isinstance(mounts, list) else []
    for name in sorted({name for name in called if isinstance(name, str) and called.count(name) > 1}):
        yield f"cameras: {name!r} is the name of {called.count(name)} cameras, expected one of each"
    cameras = [("camera", data.get("camera"))]
    cameras += [(f"cameras[{i}]", table) for i, table in enumerate(mounts)] if isinstance(mounts, list) else []
    for path, table in cameras:
        yield from _lens_conflicts(path, table)
    placed = [("camera", data.get("camera"))]
    for group in ("objects", "sphere_lights", "lights"):
        tables = data.get(group)
        placed += [(f"{group}[{i}]", table) for i, table in enumerate(tables)] if isinstance(tables, list) else []
    for path, table in placed:
        if not isinstance(table, dict):
            continue
        material = table.get("material")
        if isinstance(material, str) and path.startswith("objects") and material not in names:
            yield f"{path}.material: got {material!r}, expected one of the materials {_listed(names)}"
        ways = [key for key in ("position", "keyframes", "orbit", "trajectory") if key in table]
        if len(ways) > 1:
            yield f"{path}: has {' and '.join(ways)}, expected one of them"
        if path == "camera" and not ways:
            yield f"{path}: expected one of position, keyframes, orbit and trajectory"
        if _has(table, "fov_deg", "focal_length_mm"):
            yield f"{path}: has fov_deg and focal_length_mm, expected one of them"
        if _has(table, "trajectory", "look_at") or _has(table, "trajectory", "rotation_deg"):
            yield f"{path}: has trajectory and a direction to look in, expected one of them"
        if _has(table, "look_at", "rotation_deg"):
            yield f"{path}: has look_at and rotation_deg, expected one of them"
        if "rotation_deg" in table and "keyframes" in table:
            yield f"{path}.rotation_deg: expected it in each of the keyframes instead"
        if "picture" in table and table.get("kind") != "spot":
            yield f"{path}.picture: expected it of a spot only"
        yield from _film_conflicts(path, table)
        yield from _keyframe_conflicts(path, table)
        yield from _modulation_conflicts(path, table)


def _lens_conflicts(path: str, table: Any) -> Iterator[str]:
    """Yield what a camera says that only lenses of another model have."""
    lens = table.get("lens") if isinstance(table, dict) else None
    if not isinstance(lens, dict):
        return
    if lens.get("model") != "orthographic":
        if "view_width_m" in lens:
            yield f"{path}.lens.view_width_m: expected it of an orthographic model only"
        return
    if "view_width_m" not in lens:
        yield f"{path}.lens: is orthographic and has no view_width_m, expected the width of what is seen"
    for key in ("fov_deg", "focal_length_mm"):
        if key in table:
            yield f"{path}: has {key} and an orthographic lens, expected view_width_m of the lens alone"


def _keyframe_conflicts(path: str, table: dict[str, Any]) -> Iterator[str]:
    keyframes = table.get("keyframes")
    if not isinstance(keyframes, list):
        return
    keys = [key for key in keyframes if isinstance(key, dict)]
    for i, key in enumerate(keys):
        turns = [name for name in ("rotation_deg", "quaternion", "look_at") if name in key]
        if len(turns) > 1:
            yield f"{path}.keyframes[{i}]: has {' and '.join(turns)}, expected one of them"
    looking = sum("look_at" in key for key in keys)
    if 0 < looking < len(keys) and "look_at" not in table:
        yield f"{path}.keyframes: some have look_at and some do not, expected all or none"
    yield from _times_that_do_not_increase(path, keys)


def _times_that_do_not_increase(path: str, keys: list[dict[str, Any]]) -> Iterator[str]:
    times = [time for key in keys if isinstance(time := key.get("time_s"), int | float)]
    if any(not a < b for a, b in pairwise(times)):
        yield f"{path}.keyframes: times must increase, got {', '.join(str(time) for time in times)}"


def _modulation_conflicts(path: str, table: Any) -> Iterator[str]:
    """Yield what is wrong with the times at which the light of a table changes."""
    modulation = table.get("modulation") if isinstance(table, dict) else None
    keyframes = modulation.get("keyframes") if isinstance(modulation, dict) else None
    if isinstance(keyframes, list):
        keys = [key for key in keyframes if isinstance(key, dict)]
        yield from _times_that_do_not_increase(f"{path}.modulation", keys)


def _keys_of_other_kinds(path: str, material: Any) -> Iterator[str]:
    """Yield which keys of a material its kind does not have."""
    kind = material.get("kind", "diffuse") if isinstance(material, dict) else None
    for key, kinds in KINDS_WITH.items():
        if isinstance(kind, str) and key in material and kind not in kinds:
            yield f"{path}.{key}: {kind} materials have none, expected the kind {' or '.join(kinds)}"


def _film_conflicts(path: str, material: Any) -> Iterator[str]:
    """Yield what is wrong with the files of a material's textures, or of a lamp's picture."""
    for key, table in material.items() if isinstance(material, dict) else ():
        if not (key.endswith(("texture", "picture")) and isinstance(table, dict)):
            continue
        file, frames = table.get("file"), "frames" in table
        video = isinstance(file, str) and is_video(file)
        if (file is None) != frames:
            yield f"{path}.{key}: expected either file or frames"
        if frames and "fps" not in table:
            yield f"{path}.{key}: has frames, expected fps with it"
        if not (frames or video) and ("fps" in table or "loop" in table):
            yield f"{path}.{key}: has fps or loop, which belong to frames and to videos"
        if (frames or video) and key not in ("texture", "emission_texture", "picture"):
            yield f"{path}.{key}: is a film, expected one in texture or emission_texture only"


def _has(table: Any, *keys: str) -> bool:
    return isinstance(table, dict) and all(key in table for key in keys)


def _listed(names: list[str]) -> str:
    return ", ".join(sorted(names)) if names else "(none are defined)"


def _key_path(location: tuple[int | str, ...], data: Any) -> str:
    """Write a location as a path of keys, without the tags that pydantic adds where a value has alternatives."""
    path = ""
    for k, part in enumerate(location):
        if isinstance(part, int):
            if k == len(location) - 1 and _missing(data, part):
                break  # what lacks items is named, not each item that it lacks
            path += f"[{part}]"
            data = data[part] if isinstance(data, list) and part < len(data) else None
        elif isinstance(data, dict) and (part in data or k == len(location) - 1):
            path += f".{part}" if path else part
            data = data.get(part)
    return path


def _missing(items: Any, index: int) -> bool:
    return isinstance(items, list) and index >= len(items)


def _sentence(error: ErrorDetails) -> str:
    kind, got = error["type"], error["input"]
    if kind in ("missing", "tuple_type", "too_long") and (expected := _items_expected(error["loc"])):
        return f"expected {expected}, got {_short(got)}"
    if kind == "missing":
        return plainly(error)
    if kind == "extra_forbidden":
        key, known = str(error["loc"][-1]), _known_keys(error["loc"])
        if key in RENAMED and set(known).issuperset(RENAMED[key][0]):
            return f"is no longer a key: {RENAMED[key][1]}"
        return f"unknown key, {hint(key, sorted(known))}"
    if kind in ("union_tag_not_found", "union_tag_invalid") and "modulation" in error["loc"]:
        return f"expected a kind out of {', '.join(map(repr, MODULATIONS))}, got {_short(got)}"
    if kind in ("union_tag_not_found", "union_tag_invalid"):
        shapes = ", ".join(repr(shape) for shape in OBJECTS if shape != "file")
        return f"expected either a file or a shape out of {shapes}" + (
            f", got {got['shape']!r}" if isinstance(got, dict) and "shape" in got else ""
        )
    return f"{plainly(error)}, got {_short(got)}"


def _items_expected(location: tuple[int | str, ...]) -> str | None:
    """Return what the list at a location, or around a missing item of it, holds; None if it is no list of its own."""
    keys = list(location)
    while keys and isinstance(keys[-1], int):
        keys.pop()
    pending: list[Any] = [t.model_fields[str(keys[-1])].annotation for t in _known_tables(tuple(keys))] if keys else []
    while pending:
        annotation = pending.pop()
        items = get_args(annotation)
        if get_origin(annotation) is not tuple:
            pending += items
        elif items[-1] is not Ellipsis:
            whole = get_args(items[0])[:1] == (int,)
            kind, example = ("whole numbers", [640, 480, 1]) if whole else ("numbers", [1.0, 0.5, 0.0, 0.0])
            return f"{_COUNTS[len(items)]} {kind} such as {example[: len(items)]}"
        elif get_args(items[0])[:1] != (float,) and all(isinstance(part, str) for part in location):
            return f"tables: write [[{'.'.join(map(str, location))}]] with two brackets"
    return None


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "…"


def _known_keys(location: tuple[int | str, ...]) -> list[str]:
    """Return the keys of the table that a location lies in."""
    return list(dict.fromkeys(key for table in _tables_around(location) for key in table.model_fields))


def _known_tables(location: tuple[int | str, ...]) -> list[type[Table]]:
    """Return the tables that may lie around a location and know its key."""
    return [table for table in _tables_around(location) if location[-1] in table.model_fields]


def _tables_around(location: tuple[int | str, ...]) -> list[type[Table]]:
    tables: list[type[Table]] = [SceneTable]
    for part in location[:-1]:
        if part in OBJECTS and ObjectTable in tables[0].__mro__:
            tables = [OBJECTS[str(part)]]
            continue
        inner = [t for table in tables if part in table.model_fields for t in _tables(table, str(part))]
        tables = inner or tables
    return tables


def _tables(table: type[Table], key: str) -> list[type[Table]]:
    found: list[type[Table]] = []
    pending: list[Any] = [table.model_fields[key].annotation]
    while pending:
        item = pending.pop()
        if isinstance(item, type) and issubclass(item, Table):
            found.append(item)
        pending += get_args(item)
    return found
