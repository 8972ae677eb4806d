"""Kernels that tests share: compiling one takes longer than all that a file of tests renders.

They are built for more than a world has. What is added decides nothing where it is absent: lights of which there are
none, properties that no material has. How rays search, blur and the camera stay the world's own. With ``--own-kernels``
every world is rendered with the kernel that users get.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from clsim.render.features.bsdf_kinds import KINDS
from clsim.render.features.features import SceneFeatures

ORDINARY: dict[str, Any] = {
    "smooth_normals": True,
    "textures": True,
    "checkers": True,
    "images": True,
    "dark_backs": True,
    "one_sided_lamps": True,
    "triangle_lights": True,
    "still_lamps": False,
    "sphere_lights": True,
    "punctual_lights": True,
    "environment": True,
}
"""What the bundled scenes have, and most small worlds of tests."""
LIGHTS: dict[str, Any] = {
    "smooth_normals": True,
    "one_sided_lamps": True,
    "triangle_lights": True,
    "still_lamps": False,
    "sphere_lights": True,
    "punctual_lights": True,
    "environment": True,
}
MATERIALS: dict[str, Any] = {
    "kinds": tuple(KINDS),
    "textures": True,
    "checkers": True,
    "images": True,
    "roughness_textures": True,
    "emission_textures": True,
    "normal_maps": True,
    "alpha": True,
    "transmission": True,
    "mirrors": True,
    "dark_backs": True,
    "culled_backs": True,
}


def widened(scene_features: Callable[..., SceneFeatures], known: dict[str, Any]) -> Callable[..., SceneFeatures]:
    """Return that function with all of this ``known``, whatever a world has."""

    def all_known(*given: Any, **more: Any) -> SceneFeatures:
        return replace(scene_features(*given, **more), **known)

    return all_known


def widen(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest, known: dict[str, Any]) -> None:
    """Build kernels that know all this, whatever the world has, until the test ends."""
    # Programs that tests start import this file while they import these.
    from clsim.render import scene_data
    from clsim.render.features.scene_features import scene_features

    if not request.config.getoption("own_kernels"):
        monkeypatch.setattr(scene_data, "scene_features", widened(scene_features, known))
