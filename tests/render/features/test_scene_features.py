"""What kernels are built for is what a world has: one thing more is one feature more, and nothing else."""

from __future__ import annotations

from dataclasses import fields, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from clsim.render.features.features import SceneFeatures, view_features
from clsim.render.features.scene_features import scene_features
from clsim.render.features.scene_lamps import LampBoxes
from clsim.render.surfaces.upload_materials import upload_materials
from clsim.scene import (
    CheckerTexture,
    EnvironmentMap,
    ImageTexture,
    Instance,
    Material,
    PunctualLight,
    SphereLight,
    Static,
)
from tests.render import hand_worlds as hw
from tests.render.motion.test_blur import Glide

GREY = Material(color=(0.5, 0.5, 0.5))
IMAGE = ImageTexture(np.full((2, 2, 4), 99, np.uint8))
CHECKS = CheckerTexture((0.1, 0.1, 0.1), (0.9, 0.9, 0.9), 2.0)
QUAD = hw.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0))
SPOT = PunctualLight("spot", (8.0, 8.0, 8.0), Static(np.eye(4)), 0.0, 60.0)
BALL = SphereLight(0.1, (9.0, 9.0, 9.0), Static(np.eye(4)))
GLOW: dict[str, Any] = {"color": (0.0, 0.0, 0.0), "emission": (3.0, 3.0, 3.0)}
PLAIN = hw.world(QUAD, materials=(GREY,), environment=(0.0, 0.0, 0.0))
METAL = Material(kind="conductor", color=(0.9, 0.9, 0.9), alpha=0.3)
LIT = {"few_lamps"}


def known(world: Any, interval_s: float = 0.0, instants: bool = False) -> dict[str, Any]:
    found = scene_features(world, interval_s, instants)
    return {field.name: getattr(found, field.name) for field in fields(SceneFeatures)}


def of_material(**more: Any) -> Any:
    return replace(PLAIN, materials=(replace(GREY, **more),), textures=(IMAGE, IMAGE))


WORLDS: dict[str, tuple[Any, set[str]]] = {
    "an image": (of_material(texture=0), {"textures", "images"}),
    "another image": (of_material(texture=1), {"textures", "images"}),
    "checks": (replace(of_material(texture=0), textures=(CHECKS,)), {"textures", "checkers"}),
    "normals": (of_material(normal_texture=0), {"textures", "images", "normal_maps"}),
    "a cut": (of_material(alpha_mode="mask"), {"alpha"}),
    "a black back": (of_material(back="black"), {"dark_backs"}),
    "no back": (of_material(back="culled"), {"culled_backs"}),
    "a rough metal": (replace(PLAIN, materials=(METAL,)), {"kinds", "diffuse_lit", "glossy"}),
    "a mirror": (replace(PLAIN, materials=(replace(METAL, alpha=0.0),)), {"kinds", "diffuse_lit", "mirrors"}),
    "another rough metal": (
        replace(PLAIN, materials=(replace(METAL, distribution="beckmann", stretch=2.0),)),
        {"kinds", "diffuse_lit", "glossy", "beckmann", "anisotropic"},
    ),
    "smooth glass": (
        replace(PLAIN, materials=(Material(kind="principled", transmission=1.0, alpha=0.0),)),
        {"kinds", "diffuse_lit", "transmission", "mirrors"},
    ),
    "glass with a black back": (
        replace(PLAIN, materials=(Material(kind="dielectric", alpha=0.3, back="black"),)),
        {"kinds", "diffuse_lit", "transmission", "glossy"},
    ),
    "what would dim light if that came through": (of_material(absorption=(1.0, 1.0, 1.0)), set()),
    "glass that dims light": (
        replace(PLAIN, materials=(Material(kind="dielectric", alpha=0.3, absorption=(0.0, 1.0, 0.0)),)),
        {"kinds", "diffuse_lit", "transmission", "glossy", "absorption"},
    ),
    "a metal that is smooth here and there": (
        of_material(kind="principled", metallic=1.0, alpha=0.3, roughness_texture=0),
        {"kinds", "diffuse_lit", "textures", "images", "roughness_textures", "mirrors", "glossy"},
    ),
    "a metal with bumps": (
        of_material(kind="conductor", alpha=0.3, bump_texture=0),
        {"kinds", "diffuse_lit", "textures", "images", "normal_maps", "bump_maps"},
    ),
    "a blend with a blend with metal": (
        replace(PLAIN, materials=(replace(GREY, blend_with=1), replace(GREY, blend_with=2), METAL)),
        {"kinds", "blends", "glossy"},
    ),
    "a picture of light on what is dark": (of_material(emission_texture=0), set()),
    "a lamp": (of_material(**GLOW), {"triangle_lights", "diffuse_lit", *LIT}),
    "five lamps of one shape": (
        replace(of_material(**GLOW), instances=(Instance(0, Static(np.eye(4))),) * 5),
        {"triangle_lights", "light_tree", "diffuse_lit"},
    ),
    "a lamp with holes": (
        of_material(**GLOW, alpha_mode="mask"),
        {"triangle_lights", "still_lamps", "diffuse_lit", "alpha"},
    ),
    "half of what does not shine": (of_material(emits_behind=False), set()),
    "a picture of roughness on what has none": (of_material(roughness_texture=0), set()),
    "brushed metal": (
        replace(PLAIN, materials=(replace(METAL, stretch=0.5),)),
        {"kinds", "diffuse_lit", "glossy", "anisotropic"},
    ),
    "half a lamp": (
        of_material(**GLOW, emits_behind=False),
        {"triangle_lights", "one_sided_lamps", "diffuse_lit", *LIT},
    ),
    "a lamp that goes": (
        hw.world(QUAD, QUAD, materials=(replace(GREY, **GLOW),), motions=[Static(np.eye(4)), Glide()]),
        {"two_level", "triangle_lights", "still_lamps", "lamps_move", "light_changes", "diffuse_lit", *LIT},
    ),
    "a ball that shines": (replace(PLAIN, sphere_lights=(BALL,)), {"sphere_lights", *LIT}),
    "eight balls": (replace(PLAIN, sphere_lights=(BALL,) * 8), {"sphere_lights", "light_tree", *LIT}),
    "nine balls": (replace(PLAIN, sphere_lights=(BALL,) * 9), {"sphere_lights", "light_tree"}),
    "31 balls": (replace(PLAIN, sphere_lights=(BALL,) * 31), {"sphere_lights", "light_tree"}),
    "32 balls": (replace(PLAIN, sphere_lights=(BALL,) * 32), {"sphere_lights", "light_tree", "sphere_tree"}),
    "a ball that goes": (
        replace(PLAIN, sphere_lights=(replace(BALL, motion=Glide()),)),
        {"sphere_lights", "lamps_move", "light_changes", *LIT},
    ),
    "a spot": (replace(PLAIN, punctual_lights=(SPOT,)), {"punctual_lights", *LIT}),
    "a spot with a sharp edge": (
        replace(PLAIN, punctual_lights=(replace(SPOT, inner_deg=59.5),)),
        {"punctual_lights"},
    ),
    "a point": (
        replace(PLAIN, punctual_lights=(replace(SPOT, kind="point", inner_deg=59.5),)),
        {"punctual_lights", *LIT},
    ),
    "a slide": (
        replace(PLAIN, punctual_lights=(replace(SPOT, picture=0, picture_size=(0.5, 0.5)),), textures=(IMAGE,)),
        {"punctual_lights", "light_pictures", "textures", "images"},
    ),
    "a sky": (replace(PLAIN, environment=(0.0, 0.1, 0.0)), {"environment"}),
    "a picture of a sky": (
        replace(PLAIN, environment_map=EnvironmentMap(np.ones((2, 4, 3), np.float32), np.eye(3))),
        {"environment", "environment_map"},
    ),
    "a way": (hw.world(QUAD, materials=(GREY,), motions=[Glide()]), {"two_level", "light_changes"}),
    "a shape that stays": (
        hw.world(replace(QUAD, deformation=SimpleNamespace(duration_s=0.0)), materials=(GREY,)),
        set(),
    ),
    "smooth normals": (hw.world(hw.ball(1.0, smooth=True), materials=(GREY,)), {"smooth_normals"}),
    "colours of corners": (
        hw.world(replace(QUAD, colors=np.ones((4, 3), np.float32)), materials=(GREY,)),
        {"vertex_colors"},
    ),
}


@pytest.mark.parametrize("what", sorted(WORLDS))
def test_one_thing_more_is_one_feature_more(what: str) -> None:
    world, expected = WORLDS[what]
    before, found = known(PLAIN), known(world)
    assert {name for name, value in found.items() if value != before[name]} == expected


def test_a_grey_sheet_that_stands_in_the_dark_needs_next_to_nothing() -> None:
    """Of its lamps, of which there are none, all stand still."""
    found = {name for name, value in known(PLAIN).items() if value}
    assert found == {"kinds", "still_lamps", "diffuse_lit"} and known(PLAIN)["kinds"] == ("diffuse",)


def test_what_moves_is_blurred_while_a_shutter_is_open_and_placed_for_each_instant() -> None:
    moving = hw.world(QUAD, materials=(GREY,), motions=[Glide()])
    for world, moves in ((PLAIN, False), (moving, True)):
        assert known(world, 0.01)["motion_blur"] is moves and known(world, instants=True)["instants"] is moves
        assert not known(world)["motion_blur"] and not known(world)["instants"]


@pytest.mark.parametrize(("shutter_s", "motion"), [(0.0, Glide()), (0.01, Glide()), (0.01, Static(np.eye(4)))])
def test_a_camera_blurs_what_stands_if_it_goes_while_it_exposes(shutter_s: float, motion: Any) -> None:
    camera = replace(PLAIN.camera, shutter_s=shutter_s, motion=motion)
    blurs = view_features(scene_features(PLAIN, shutter_s), camera).camera_blur
    assert blurs == (shutter_s > 0 and motion.duration_s > 0)


@pytest.mark.parametrize("requests", [False, True])
def test_pixels_between_frames_have_no_planes_for_variances(requests: bool) -> None:
    found = view_features(scene_features(PLAIN, 0.0), PLAIN.camera, variances=True, requests=requests)
    assert found.variances is not requests


def test_backs_are_black_unless_light_must_come_back() -> None:
    glass = Material(kind="dielectric", alpha=0.3, back="black")
    world = replace(PLAIN, materials=(replace(GREY, back="black"), glass, GREY))
    assert upload_materials(world, "cpu").rows.numpy()["dark_back"].tolist() == [1, 0, 0]


def test_lamps_lie_in_their_boxes_and_the_sun_where_its_light_comes_from() -> None:
    """It shines along its -z: from +x, where this one is turned to."""
    turned = np.array([[0.0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]])
    world = hw.world(
        QUAD, materials=(replace(GREY, **GLOW),), motions=[Glide()],
        sphere_lights=(replace(BALL, motion=Static(hw.translation(1.0, 2.0, 3.0))),),
        punctual_lights=(PunctualLight("directional", (1.0, 1.0, 1.0), Static(turned)),),
    )  # fmt: skip
    low, high, is_far = LampBoxes(world).at(2.0, np.array((1.0, 1.0, 1.0)))
    assert is_far.tolist() == [False, True, False, False]
    np.testing.assert_allclose((low[0], high[0]), ((-0.1, 0.9, 1.9), (0.1, 1.1, 2.1)))
    np.testing.assert_allclose((low[1], high[1]), [(1e5, 0.0, 0.0)] * 2, atol=1e-9)
    np.testing.assert_allclose((low[2:].min(axis=0), high[2:].max(axis=0)), ((0.0, -2.0, -1.0), (2.0, 0.0, -1.0)))
