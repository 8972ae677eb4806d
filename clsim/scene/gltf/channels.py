"""Which animations of a glTF play, and their channels, those of KHR_animation_pointer included."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from clsim.errors import InputError
from clsim.scene.gltf import schema
from clsim.scene.gltf.accessors import GltfFile
from clsim.scene.gltf.animation import Channel, Property

WIDTHS: dict[Property, int] = {
    "translation": 3,
    "rotation": 4,
    "scale": 3,
    "lamp color": 3,
    "lamp intensity": 1,
    "emissive factor": 3,
    "emissive strength": 1,
}
"""Numbers per keyframe; weights have as many as there are morph targets."""
_NUMBER = "([0-9]{1,9})"
_NODE = f"/nodes/{_NUMBER}/"
_LAMP = f"/extensions/KHR_lights_punctual/lights/{_NUMBER}/"
_MATERIAL = f"/materials/{_NUMBER}/"
POINTERS: tuple[tuple[str, Property], ...] = (
    (_NODE + "translation", "translation"),
    (_NODE + "rotation", "rotation"),
    (_NODE + "scale", "scale"),
    (_NODE + "weights", "weights"),
    (_LAMP + "color", "lamp color"),
    (_LAMP + "intensity", "lamp intensity"),
    (_MATERIAL + "emissiveFactor", "emissive factor"),
    (_MATERIAL + "extensions/KHR_materials_emissive_strength/emissiveStrength", "emissive strength"),
)
"""Where a pointer may lead, and what it changes there."""
Place = tuple[int, Property]


def read_channels(file: GltfFile, choice: str | None, warn: Callable[[str], None], notes: list[str]) -> list[Channel]:
    """Return the channels that play; what others there are is added to ``notes``, what is not played is warned of.

    Args:
        file: the glTF.
        choice: name or index of the one animation to play; None plays all that do not contradict each other.
        warn: takes what cannot be played.
        notes: where others are named.

    Raises:
        InputError: one sentence that names the file and what is wrong with it.
    """
    animations = file.json.animations
    if choice is not None:
        chosen = [_chosen(file.path, animations, choice)]
    else:
        chosen, others = [], []
        taken: set[Place] = set()
        for i, animation in enumerate(animations):
            moved = {place for channel in animation.channels if (place := _place(channel.target)) is not None}
            if moved & taken:
                others.append(animation.name or str(i))
                continue
            taken |= moved
            chosen.append(i)
        if others:
            first = animations[chosen[0]].name or "0"
            name = file.path.name
            notes.append(
                f"{name}: plays its animation {first}; it also has {', '.join(others)}, which {name}#{others[0]} "
                "would play"
            )
    return [channel for i in chosen for channel in _animation(file, i, warn)]


def _place(target: schema.Target) -> Place | None:
    """Return what a channel changes, and of which node, lamp or material; None for what is not played."""
    pointed = target.extensions.KHR_animation_pointer
    if target.path == "pointer" and pointed is not None:
        for pattern, changed in POINTERS:
            if found := re.fullmatch(pattern, pointed.pointer):
                return int(found[1]), changed
    elif target.node is not None and target.path in ("translation", "rotation", "scale", "weights"):
        return target.node, target.path  # type: ignore[return-value]
    return None


def _animation(file: GltfFile, index: int, warn: Callable[[str], None]) -> list[Channel]:
    animation, found = file.json.animations[index], []
    for k, channel in enumerate(animation.channels):
        name = f"{file.path}: animations[{index}].channels[{k}]"
        place = _place(channel.target)
        if place is None:
            pointed = channel.target.extensions.KHR_animation_pointer
            if channel.target.node is not None or pointed is not None:
                warn(f"animations of {channel.target.path if pointed is None else pointed.pointer} are not played")
            continue
        at, changed = place
        width = WIDTHS.get(changed, 0)
        if changed.startswith("lamp"):
            file.item("lights", file.json.extensions.KHR_lights_punctual.lights, at)
        elif changed.startswith("emissive"):
            file.item("materials", file.json.materials, at)
        else:
            node = file.item("nodes", file.json.nodes, at)
            if node.matrix is not None and changed != "weights":
                raise InputError(f"{name} moves nodes[{at}], whose place is a matrix")
            if changed == "weights":
                mesh = None if node.mesh is None else file.item("meshes", file.json.meshes, node.mesh)
                width = 0 if mesh is None else len(mesh.primitives[0].targets)
        sampler = file.item(f"animations[{index}].samplers", animation.samplers, channel.sampler)
        found.append(_channel(file, name, place, width, sampler, warn))
    return found


def _channel(
    file: GltfFile,
    name: str,
    place: Place,
    width: int,
    sampler: schema.AnimationSampler,
    warn: Callable[[str], None],
) -> Channel:
    times = file.accessor(sampler.input, "animation times", "SCALAR")[:, 0].astype(np.float64)
    values = file.accessor(sampler.output, "animation values", "SCALAR", "VEC3", "VEC4").astype(np.float64)
    if not len(times) or times[0] < 0 or (np.diff(times) < 0).any():
        raise InputError(f"{name} has times that do not increase from 0 or later")
    per_key = 3 if sampler.interpolation == "CUBICSPLINE" else 1
    if not width or values.size != len(times) * per_key * width:
        raise InputError(f"{name} has {values.size} numbers, expected {len(times)} keyframes of {per_key} × {width}")
    keyed = values.reshape(len(times), per_key, width)
    at, changed = place
    if changed == "rotation" and (np.linalg.norm(keyed[:, per_key // 2], axis=1) < 1e-9).any():
        raise InputError(f"{name} has a quaternion of length 0, expected rotations")
    last = np.append(np.diff(times) > 0, True)
    if not last.all():
        warn(f"of keyframes at the same time the last is played (first at {times[~last][0]:g} s)")
        times, keyed = times[last], keyed[last]
    return Channel(at, changed, times, keyed if per_key == 3 else keyed[:, 0], sampler.interpolation)


def _chosen(path: Path, animations: list[schema.Animation], choice: str) -> int:
    names = [animation.name for animation in animations]
    if choice in names:
        return names.index(choice)
    if choice.isdecimal() and int(choice) < len(animations):
        return int(choice)
    known = ", ".join(name or str(i) for i, name in enumerate(names)) or "(it has none)"
    raise InputError(f"{path}: has no animation {choice!r}, expected one of {known}")
