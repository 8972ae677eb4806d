"""What ``shots.py`` makes of a function that follows rays."""

from typing import Any

import pytest
import warp as wp

from clsim.render import RenderOptions
from clsim.render.paths import shots
from clsim.render.scene_data import SceneData
from clsim.scene import load_world


def test_every_function_is_inlined(monkeypatch: pytest.MonkeyPatch) -> None:
    """Paths are put into their kernel: called, each ray would have a copy of the scene's structs."""
    world = load_world("two-boxes")
    features = RenderOptions().features(SceneData(world).features, world.camera)
    hints = []

    def recorded(function: Any, inline: bool | None = None) -> Any:
        hints.append(inline)
        return function

    monkeypatch.setattr(wp, "func", recorded)
    shots.make_shoot_at(features, lambda: None)
    assert hints[-1] is True
