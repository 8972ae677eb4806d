"""From what is drawn for a sequence to its scene file."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from clsim.datasets.toml import read_toml, to_toml
from clsim.errors import InputError
from clsim.scene.load import bundled_names

_FILES = ("file", "frames", "map", "trajectory", "camera_path", "imu_noise")
"""Keys of a scene and of a run that name files, besides those of textures; ``base`` and ``sensor`` may."""


def scene_text(drawn: Mapping[str, Any]) -> str:
    """Return the text of a scene.

    ``base`` names a bundled scene or a scene in TOML, whose keys those drawn replace; objects and lights are added to
    its own, materials and the camera's keys joined with them.

    Raises:
        InputError: the base cannot be read.
    """
    scene = dict(drawn)
    base = scene.pop("base", None)
    if base is not None:
        scene = _joined(_read_base(str(base)), scene)
    return to_toml(scene)


def whole_paths(value: Any, folder: Path, key: str = "") -> Any:
    """Return a scene or a run, or its template, with the files that it names relative to ``folder`` by whole paths."""
    if isinstance(value, Mapping):
        # What a distribution chooses from is named by the key that it gives a value to.
        return {name: whole_paths(each, folder, key if name == "choice" else name) for name, each in value.items()}
    if isinstance(value, list):
        return [whole_paths(each, folder, key) for each in value]
    named = key in _FILES or key.endswith("texture") or (key == "base" and isinstance(value, str) and "." in value)
    named = named or (key == "sensor" and isinstance(value, str) and value.endswith(".toml"))
    return str(folder / value) if isinstance(value, str) and named else value


def _read_base(name: str) -> dict[str, Any]:
    bundled = Path(str(resources.files("clsim.scenes")))
    path = bundled / f"{name}.toml" if name in bundled_names() else Path(name)
    if path.suffix != ".toml":
        raise InputError(f"scene.base {name}: must be a bundled scene or a .toml; name models as objects: file = …")
    told: dict[str, Any] = whole_paths(read_toml(path), path.resolve().parent)
    return told


def _joined(base: Mapping[str, Any], more: Mapping[str, Any]) -> dict[str, Any]:
    out = dict(base)
    for key, value in more.items():
        old = out.get(key)
        if key == "camera" and isinstance(old, dict):
            # A place or motion that is drawn takes the base's place.
            moves = ("position", "keyframes", "orbit", "trajectory")
            kept = old if not set(moves) & set(value) else {k: v for k, v in old.items() if k not in moves}
            out[key] = kept | value
        elif isinstance(old, dict) and isinstance(value, Mapping):
            out[key] = old | dict(value)
        elif isinstance(old, list) and isinstance(value, list):
            out[key] = old + value
        else:
            out[key] = value
    return out
