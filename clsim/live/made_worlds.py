"""Worlds that a program made, where a scene's name or file may stand."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from clsim.errors import InputError
from clsim.scene import World, validate


def check_world(world: World, given: Mapping[str, Any]) -> None:
    """Check such a world, and that no option is given which belongs to scene files; raises InputError."""
    for option in ("resolution", "camera_path"):
        if given[option] is not None:
            raise InputError(f"`{option}` is for scenes that are loaded; a World's camera has its own")
    validate(world, world.name)
