"""Keys of a TOML scene that change nothing, for want of another key or because of one."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

_NEEDED = {
    "emission_texture": "emission",
    "bump_scale": "bump_texture",
    "normal_scale": "normal_texture",
    "opacity": "alpha_mode",
    "opacity_texture": "alpha_mode",
    "alpha_cutoff": "alpha_mode",
    "sensor_width_mm": "focal_length_mm",
    "trajectory_axes": "trajectory",
    "map_scale": "map",
    "map_rotation_deg": "map",
    "map_turn_deg_per_s": "map",
}
"""Keys that say nothing without another."""
_OF_METALS = tuple((told, shown) for told in ("metal", "eta") for shown in ("color", "texture", "checker"))
"""Keys of a material of which the second has no use beside the first."""


def unused_keys(data: dict[str, Any], source: Path) -> Iterator[str]:
    """Yield a warning for each key of a scene, which was found right, that changes nothing."""
    groups = {f"materials.{name}": table for name, table in data.get("materials", {}).items()}
    groups |= {name: data[name] for name in ("environment", "camera") if name in data}
    for group in ("objects", "sphere_lights", "lights"):
        groups |= {f"{group}[{i}]": table for i, table in enumerate(data.get(group, []))}
    for path, table in groups.items():
        for sentence in _unused(table):
            yield f"{source.name}: {path}.{sentence}"


def _unused(table: dict[str, Any]) -> Iterator[str]:
    for key, needed in _NEEDED.items():
        if key in table and needed not in table:
            yield f"{key} changes nothing without {needed}"
    for metal, key in _OF_METALS:
        if metal in table and key in table:
            yield f"{key} changes nothing beside {metal}"
    for key in ("inner_deg", "outer_deg"):
        if key in table and table.get("kind") != "spot":
            yield f"{key} changes nothing but of a spot"
    if "look_at" in table.get("orbit", {}) and "rotation_deg" in table:
        yield "rotation_deg changes nothing beside an orbit with look_at"
    turned = [key for key in table.get("keyframes", []) if "rotation_deg" in key or "quaternion" in key]
    if "look_at" in table and len(turned) == len(table.get("keyframes", [])) > 0:
        yield "look_at changes nothing beside keyframes that turn"
