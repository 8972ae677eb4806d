"""Mitsuba's XML, versions 0.6 to 3: elements with their properties, names in the spelling of version 3.

A document type, and with it every entity, is refused; size, depth and the number of elements are bounded.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.parsers import expat

import numpy as np

from clsim.errors import InputError
from clsim.scene.mitsuba.values import Element, Setting, file_of, numbers, shown, value_of
from clsim.scene.motion import Matrix, look_at
from clsim.scene.rigid import across, rotation_about

MAX_BYTES = 64 << 20
MAX_DEPTH = 64
MAX_ELEMENTS = 1_000_000
MAX_INCLUDES = 100
MAX_TEXT = 1 << 16
UNUSED = ("integrator", "sampler", "rfilter")
"""Objects that change nothing here: their parameters need no values."""
PROPERTIES = ("float", "integer", "boolean", "string", "rgb", "srgb", "spectrum", "blackbody", "point", "vector")


@dataclass(frozen=True)
class Animation:
    """Transforms at times."""

    times_s: tuple[float, ...]
    matrices: tuple[Matrix, ...]


TOLD = ("shape", "emitter", "luminaire", "bsdf", "texture", "sensor", "camera")
"""Objects whose properties are told where nothing reads them."""
HARMLESS = {
    *("sampling_weight", "silhouette_sampling_weight", "near_clip", "far_clip", "focus_distance", "srf", "id"),
    *("sample_visible", "flip_invalid_normals", "use_shadowing_function", "mis_compensation", "accel", "format"),
    *("max_anisotropy", "cache", "collapse", "fast_approx", "strict_normals", "allow_transmission", "shutter_open"),
}
"""Properties that say how Mitsuba samples, or that change no picture here."""


class Values(dict[str, Any]):
    """The properties of an object, which remember what was asked for."""

    def __init__(self) -> None:
        """Begin without any."""
        super().__init__()
        self.asked: set[str] = set()

    def get(self, name: str, default: Any = None) -> Any:
        """Return a property, or what stands for a missing one."""
        self.asked.add(name)
        return super().get(name, default)

    def __contains__(self, name: object) -> bool:
        """Tell whether there is a property."""
        self.asked.add(str(name))
        return super().__contains__(name)


@dataclass
class Plugin:
    """An object of the scene: a shape, a bsdf, a texture…

    Attributes:
        kind: the element's tag.
        type: the plugin's name.
        name: the parameter that it stands for in its parent, if any.
        values: its properties; transforms as 4×4 matrices or `Animation`.
        children: objects inside it, references resolved.
        place: file and line.
        folder: where its files lie.
        id: by which others refer to it, if any.
    """

    kind: str
    type: str
    name: str
    values: Values
    children: list[Plugin]
    place: str
    folder: Path
    id: str = ""

    def get(self, name: str, default: Any) -> Any:
        """Return a property; raises InputError where its type is not that of the default."""
        value = self.values.get(name, default)
        if not (default is None or isinstance(value, type(default))):
            raise InputError(f"{self.place}: {self.type}.{name} is {shown(value)}, expected a {type(default).__name__}")
        return value

    def child(self, name: str) -> Plugin | None:
        """Return the object that stands for a parameter."""
        self.values.asked.add(name)
        return next((child for child in self.children if child.name == name), None)

    def pass_over(self) -> None:
        """Take all properties as read: the object is left out, and that was told."""
        self.values.asked.update(self.values, (child.name for child in self.children))

    def unread(self) -> Iterator[str]:
        """Yield what was not read of the properties of this object and those inside, once for each type and name."""
        told = self.values.asked and self.kind in TOLD
        for name in self.values if told else ():
            if name not in self.values.asked | HARMLESS and not name.endswith("_sampling_rate"):
                yield f"the {name} of a {self.type} {self.kind} is left out"
        for child in self.children:
            if told and child.kind == "texture" and child.name not in self.values.asked:
                yield f"the texture {child.name or 'without a name'} of a {self.type} {self.kind} is left out"
            yield from child.unread()

    def of_kind(self, *kinds: str) -> list[Plugin]:
        """Return the objects inside of some kinds."""
        found = [child for child in self.children if child.kind in kinds]
        self.values.asked.update(child.name for child in found)
        return found


class Parameters(dict[str, str]):
    """What stands for ``$name`` in a file.

    Attributes:
        used: the names that were asked for.
    """

    def __init__(self, given: Mapping[str, str]) -> None:
        """Begin with what is given, which goes before a file's own defaults."""
        super().__init__(given)
        self.used: set[str] = set()


def read_scene(path: Path, given: Mapping[str, str]) -> tuple[Plugin, bool]:
    """Read a scene; return it and whether its version is before 2 (defaults differ).

    Args:
        path: the file.
        given: values of its parameters.

    Raises:
        InputError: with file and line.
    """
    root = _parse(path)
    if root.tag != "scene":
        if root.tag == "mujocoinclude":
            raise InputError(
                f"{root.place}: is a part of MuJoCo models (<mujocoinclude>), expected a model that has it"
            )
        raise InputError(f"{root.place}: is <{root.tag}>, expected <scene> of Mitsuba's or <mujoco>")
    match = re.match(r"\d+", root.attributes.get("version", ""))
    if match is None:
        raise InputError(f"{root.place}: <scene> has no version, expected one such as 3.0.0")
    legacy = int(match[0]) < 2
    parameters = Parameters(given)
    scene = _Reader(path.parent, legacy, root).plugin(root, path.parent, parameters)
    if unknown := sorted(set(given) - parameters.used):
        known = ", ".join(sorted(parameters.used | set(parameters) - set(given))) or "(it has none)"
        raise InputError(f"{path}: has no parameter {unknown[0]!r}, expected one of {known}")
    return scene, legacy


def _parse(path: Path) -> Element:
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(f"{path}: is larger than {MAX_BYTES >> 20} MiB, expected a scene's XML")
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    parser = expat.ParserCreate()
    top: list[Element] = []
    stack: list[Element] = []
    count = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        place = f"{path}:{parser.CurrentLineNumber}"
        if len(stack) >= MAX_DEPTH or count > MAX_ELEMENTS:
            raise InputError(f"{place}: is nested deeper than {MAX_DEPTH} or has more than {MAX_ELEMENTS} elements")
        element = Element(tag, attributes, place)
        (stack[-1].children if stack else top).append(element)
        stack.append(element)

    def end(_: str) -> None:
        stack.pop()

    def refuse(*_: object) -> None:
        raise InputError(f"{path}:{parser.CurrentLineNumber}: has a document type, which could hide entities")

    parser.StartElementHandler, parser.EndElementHandler, parser.StartDoctypeDeclHandler = start, end, refuse
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise InputError(f"{path}:{error.lineno}: is not well-formed XML ({expat.ErrorString(error.code)})") from None
    except (LookupError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: is not XML text that can be read ({error})") from None
    return top[0]


def _within(element: Element) -> Iterator[Element]:
    """Yield the objects of a type inside an element, those of the scene's own first."""
    objects = [child for child in element.children if "type" in child.attributes]
    yield from objects
    for each in objects:
        yield from _within(each)


class _Reader:
    """Turns elements into plugins: parameters filled in, files included, references resolved."""

    def __init__(self, folder: Path, legacy: bool, scene: Element) -> None:
        self.root, self.legacy = folder, legacy
        self.named: dict[str, Plugin] = {}
        self.later = {child.attributes["id"]: child for child in _within(scene) if "id" in child.attributes}
        self.searched: list[Path] = []
        self.includes = 0

    def plugin(self, element: Element, folder: Path, defaults: Parameters) -> Plugin:
        """Return the plugin of an element whose type is given or whose tag is ``scene``."""
        attributes = _filled(element, defaults)
        found = Plugin(
            element.tag,
            attributes.get("type", element.tag),
            _snake(attributes.get("name", "")),
            Values(),
            [],
            element.place,
            folder,
            attributes.get("id", ""),
        )
        self._fill(found, element, folder, defaults)
        if "id" in attributes:
            self.named[attributes["id"]] = found
        return found

    def _fill(self, plugin: Plugin, element: Element, folder: Path, defaults: Parameters) -> None:
        for child in element.children:
            if child.tag in UNUSED:
                told = {
                    _snake(each.attributes.get("name", "")): each.attributes.get("value") for each in child.children
                }
                if told.get("hide_emitters") == "true":
                    plugin.values["hide_emitters"] = True
                continue
            if child.tag == "default":
                attributes = _filled(child, defaults)
                defaults.setdefault(attributes.get("name", ""), attributes.get("value", ""))
                defaults.used.add(attributes.get("name", ""))
                continue
            attributes = _filled(child, defaults)
            name = _snake(attributes.get("name", ""))
            if child.tag == "include":
                self._include(plugin, child, attributes, folder, defaults)
            elif child.tag == "ref":
                plugin.children.append(self._reference(child, attributes, name, defaults))
            elif child.tag == "alias":
                self.named[attributes.get("as", "")] = self._reference(child, attributes, "", defaults)
            elif child.tag in PROPERTIES:
                setting = Setting(folder, self.legacy, plugin.kind in ("emitter", "luminaire"))
                plugin.values[name] = value_of(child, attributes, setting)
                if name == "filename":
                    plugin.values[name] = self._found(plugin.values[name], folder)
            elif child.tag == "transform":
                plugin.values[name] = _transform(child, defaults)
            elif child.tag == "animation":
                plugin.values[name] = _animation(child, defaults)
            elif "type" in attributes:
                plugin.children.append(self.plugin(child, folder, defaults))
            elif child.tag == "path":
                self.searched.append((folder / attributes.get("value", "")).absolute())
            else:
                raise InputError(f"{child.place}: <{child.tag}> is neither a property nor an object with a type")

    def _found(self, name: Any, folder: Path) -> Any:
        """Return a file's name, with the folder that <path> tells of where it is not beside the scene."""
        if isinstance(name, str) and not (folder / name).exists():
            return next((str(other / name) for other in self.searched if (other / name).exists()), name)
        return name

    def _reference(self, element: Element, attributes: dict[str, str], name: str, defaults: Parameters) -> Plugin:
        wanted = attributes.get("id", "")
        if wanted not in self.named and wanted in self.later:  # defined further down; each is tried once
            self.plugin(self.later.pop(wanted), self.root, defaults)
        target = self.named.get(wanted)
        if target is None:
            raise InputError(
                f"{element.place}: refers to {attributes.get('id', '')!r}, which is not defined in the scene"
            )
        return Plugin(
            target.kind, target.type, name, target.values, target.children, target.place, target.folder, target.id
        )

    def _include(
        self, plugin: Plugin, element: Element, attributes: dict[str, str], folder: Path, defaults: Parameters
    ) -> None:
        self.includes += 1
        if self.includes > MAX_INCLUDES:
            raise InputError(f"{element.place}: is the {MAX_INCLUDES + 1}th include: do files include each other?")
        path = file_of(element.place, self._found(attributes.get("filename", ""), self.root), self.root)
        included = _parse(path)
        if included.tag == "scene":
            self._fill(plugin, included, folder, defaults)
        else:
            plugin.children.append(self.plugin(included, folder, defaults))


def _filled(element: Element, defaults: Parameters) -> dict[str, str]:
    """Return the attributes with their $parameters filled in."""
    filled = {}
    for key, text in element.attributes.items():
        if "$" in text:
            for name in sorted(defaults, key=len, reverse=True):
                if f"${name}" in text:
                    defaults.used.add(name)
                    text = text.replace(f"${name}", defaults[name])
                if len(text) > MAX_TEXT:
                    raise InputError(f"{element.place}: {key} is longer than {MAX_TEXT} characters with its defaults")
            if missing := re.search(r"\$([A-Za-z_]\w*)", text):
                file = Path(element.place.rpartition(":")[0]).name
                raise InputError(
                    f"{element.place}: {key} is {text!r}, of which no <default> gives the value; give it after the "
                    f"file's name, as {file}#{missing[1]}=VALUE"
                )
        filled[key] = text
    return filled


def _snake(name: str) -> str:
    """Return a parameter's name as version 3 spells it: intIOR, toWorld become int_ior, to_world."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


def _transform(element: Element, defaults: Parameters) -> Matrix:
    """Return the product of a transform's steps, the last one applied last."""
    matrix = np.eye(4)
    for step in element.children:
        matrix = _step(step, _filled(step, defaults)) @ matrix
    if not np.isfinite(matrix).all():
        raise InputError(f"{element.place}: the transform has a number that is not finite")
    return matrix


def _step(element: Element, attributes: dict[str, str]) -> Matrix:
    place, matrix = element.place, np.eye(4)

    def vector(missing: float) -> list[float]:
        if "value" in attributes:
            found = numbers(place, attributes["value"], (1, 3))
            return found if len(found) == 3 else found * 3
        return [numbers(place, attributes.get(axis, str(missing)), (1,))[0] for axis in "xyz"]

    if element.tag == "matrix":
        entries = np.array(numbers(place, attributes.get("value", ""), (9, 16)))
        size = 4 if len(entries) == 16 else 3
        matrix[:size, :size] = entries.reshape(size, size)
    elif element.tag == "translate":
        matrix[:3, 3] = vector(0.0)
    elif element.tag == "scale":
        matrix[:3, :3] = np.diag(vector(1.0))
    elif element.tag == "rotate":
        axis = np.array(vector(0.0))
        angle = np.radians(numbers(place, attributes.get("angle", ""), (1,))[0])
        if not np.linalg.norm(axis) > 0:
            raise InputError(f"{place}: rotates about no axis")
        matrix[:3, :3] = rotation_about(axis, float(angle))
    elif element.tag in ("lookat", "look_at", "lookAt"):
        origin, target = (numbers(place, attributes.get(key, ""), (3,)) for key in ("origin", "target"))
        if np.allclose(origin, target):
            raise InputError(f"{place}: looks at its own origin")
        up = numbers(place, attributes["up"], (3,)) if "up" in attributes else across(np.subtract(target, origin))
        # Mitsuba looks along +z with x to the left
        matrix = look_at(origin, target, up) @ np.diag((-1.0, 1.0, -1.0, 1.0))
    else:
        raise InputError(f"{place}: <{element.tag}> is no transform, expected matrix, translate, rotate, scale, lookat")
    return matrix


def _animation(element: Element, defaults: Parameters) -> Animation:
    keys: list[tuple[float, Matrix]] = []
    for child in element.children:
        time = numbers(child.place, _filled(child, defaults).get("time", ""), (1,))[0]
        keys.append((time, _transform(child, defaults)))
    times = tuple(time for time, _ in keys)
    if not keys or times[0] < 0 or any(b <= a for a, b in pairwise(times)):
        raise InputError(f"{element.place}: expected transforms at increasing times from 0 or later")
    return Animation(times, tuple(matrix for _, matrix in keys))
