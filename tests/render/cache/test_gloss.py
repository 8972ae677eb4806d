"""Glossy metals and coats in cached light: what they reflect hangs on the direction from which they are seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clsim.frames import RADIANCE, Frame, page_aligned
from clsim.render import PathTracer, RenderOptions
from clsim.render.features.scene_features import may_be_glossy
from clsim.scene import Material, PunctualLight, SphereLight, Static
from tests.render import hand_worlds as hw
from tests.render.motion.test_blur import Glide

CACHED = RenderOptions(
    spp=8, probe_spp=1, probe_every=4, first_hit_rays=32, sampler="sobol", light_cache=True, fps=100, frames=8
)
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
METAL = Material(kind="conductor", color=(0.9, 0.8, 0.6), alpha=0.12)
SOME = {
    "a metal": METAL,
    "glTF's": Material(kind="principled", color=(0.9, 0.8, 0.6), metallic=1.0, alpha=0.2),
    "Disney's": Material(kind="disney", color=(0.9, 0.8, 0.6), metallic=1.0, alpha=0.3),
}
FROSTED = {
    "glass": Material(kind="dielectric", alpha=0.04),
    "glTF's": Material(kind="principled", transmission=1.0, alpha=0.09),
}

PLASTIC = Material(kind="plastic", color=(0.5, 0.3, 0.2), alpha=0.3)
GLTF = Material(kind="principled", color=(0.5, 0.3, 0.2), alpha=0.1)
COATED = {
    "plastic below a panel": (PLASTIC, "panel", 0.12),
    "glTF's below a panel": (GLTF, "panel", 0.18),
    "plastic below a sphere": (PLASTIC, "sphere", 0.07),
    "clear coat below a sphere": (replace(GLTF, alpha=0.4, clearcoat=1.0, clearcoat_alpha=0.1), "sphere", 0.11),
    "plastic in the sun": (replace(PLASTIC, alpha=0.1), "sun", 0.06),
    "a mirroring coat in the sun": (replace(PLASTIC, alpha=0.0), "sun", 0.05),
}
"""A material, what lights it, and how far off log brightness may be."""


def lit_by(world, lamp):
    """Return a world with another lamp than its panel."""
    if lamp != "panel":
        world = replace(world, meshes=world.meshes[:3], instances=world.instances[:3])
    if lamp == "sphere":
        world = replace(world, sphere_lights=(SphereLight(0.3, (14.0,) * 3, Static(hw.translation(0.6, 2.5, 0.6))),))
    if lamp == "sun":
        sun = PunctualLight("directional", (3.0,) * 3, Static(hw.look_from((0.6, 2.0, 1.2), (0, 0, 0))))
        world = replace(world, punctual_lights=(sun,))
    return world


def world_of(material, sky):
    """A ball that moves before a wall and over a floor, below a panel of light or in the light of the sky."""
    pose = hw.look_from((0.3, 1.2, 3.0), (0, 0.5, -0.3))
    meshes = [
        hw.quad((-2, 0, 2), (4, 0, 0), (0, 0, -4)),
        hw.quad((-2, 0, -1.5), (4, 0, 0), (0, 2, 0)),
        hw.ball(0.5, rings=24, smooth=True),
        hw.quad((0.2, 2.5, 0.4), (0.0, 0.0, -0.8), (0.8, 0.0, 0.0)),
    ]
    for index, mesh in enumerate(meshes):
        meshes[index] = replace(mesh, material_ids=np.full_like(mesh.material_ids, [0, 0, 1, 2][index]))
    return hw.world(
        *meshes,
        materials=(hw.GREY, material, Material(emission=(0.0 if sky else 6.0,) * 3)),
        view=replace(hw.camera(pose, 28, 20), motion=Static(pose)),
        motions=[hw.IDENTITY, hw.IDENTITY, Glide((-0.5, 0.6, -0.2), (10.0, 0.0, 0.0)), hw.IDENTITY],
        environment=(0.5, 0.7, 1.0) if sky else (0.0, 0.0, 0.0),
    )


def brightness(world, options, frames):
    """Return the log luminance of these frames of a run, 10 ms apart, ``[frames, H, W]``."""
    tracer = PathTracer(world, options)
    frame = Frame(page_aligned((len(tracer.names), tracer.height, tracer.width)), tracer.names)
    shown = []
    try:
        for index in frames:
            tracer.fill_at(index, index * 10_000, frame)
            shown.append(np.tensordot(LUMINANCE, np.stack([frame.plane(name) for name in RADIANCE]), 1))
    finally:
        tracer.close()
    return np.log(np.maximum(shown, 1e-3))


@pytest.mark.slow
@pytest.mark.parametrize("sky", [False, True], ids=["below a panel", "in skylight"])
@pytest.mark.parametrize("material", SOME.values(), ids=SOME)
def test_a_ball_that_moves_is_as_bright_as_paths_find(material, sky):
    world = world_of(material, sky)
    cached = brightness(world, CACHED, range(8))[[0, 7]]
    paths = brightness(world, RenderOptions(spp=2048, sampler="sobol"), [0, 7])
    on_ball = np.zeros(paths.shape, bool)
    on_ball[0, 8:14, 7:11] = on_ball[1, 8:14, 15:19] = True
    off = (cached - paths)[on_ball]
    assert np.sqrt(np.mean(off**2)) < (0.05 if sky else 0.25)
    assert abs(off.mean()) < 0.03


@pytest.mark.slow
@pytest.mark.parametrize(("material", "lamp", "allowed"), COATED.values(), ids=COATED)
def test_a_coated_ball_that_moves_is_as_bright_as_paths_find(material, lamp, allowed):
    """Light that has no size is seen in no perfect mirror."""
    world = lit_by(world_of(material, sky=False), lamp)
    cached = brightness(world, CACHED, range(8))[[0, 7]]
    paths = brightness(world, RenderOptions(spp=2048, sampler="sobol"), [0, 7])
    on_ball = np.zeros(paths.shape, bool)
    on_ball[0, 6:14, 6:12] = on_ball[1, 6:14, 14:20] = True
    off = (cached - paths)[on_ball]
    assert np.sqrt(np.mean(off**2)) < allowed


@pytest.mark.slow
def test_it_has_the_same_bits_for_any_number_of_threads():
    one, three = (
        brightness(world_of(METAL, sky=False), replace(CACHED, threads=threads), range(4)) for threads in (1, 3)
    )
    np.testing.assert_array_equal(one, three)


@pytest.mark.slow
@pytest.mark.parametrize(("glass", "allowed"), [(FROSTED["glass"], 0.1), (FROSTED["glTF's"], 0.24)], ids=FROSTED)
def test_what_moves_behind_frosted_glass_is_as_bright_as_paths_find(glass, allowed):
    """Its two faces blur it, each by as much as rays through it tell; cells would show it where it was."""
    world = world_of(replace(METAL, kind="diffuse", color=(0.1, 0.1, 0.1)), sky=False)
    pane = hw.box((-1.2, 0.0, 0.6), (1.2, 1.3, 0.63), material=3)
    world = replace(
        world,
        meshes=(*world.meshes, pane),
        materials=(*world.materials, glass),
        instances=(*world.instances, replace(world.instances[0], mesh=4)),
    )
    cached = brightness(world, CACHED, range(8))[[0, 7]]
    paths = brightness(world, RenderOptions(spp=512, sampler="sobol"), [0, 7])
    off = (cached - paths)[:, 8:14, 6:22]
    assert np.sqrt(np.mean(off**2)) < allowed


def test_a_mirror_before_the_dark_stays_dark_though_things_move_before_it():
    """Where it shows nothing it has no light; what its stored paths meet elsewhere as things move is not seen there."""
    pose = hw.look_from((0.3, 1.2, 3.0), (0, 0.5, -0.3))
    world = hw.world(
        hw.quad((-2, 0, 2), (4, 0, 0), (0, 0, -4)),
        hw.quad((-0.6, 0, -1), (1.2, 0, 0), (0, 2, 0), material=1),
        hw.quad((0.2, 2.5, 0.4), (0.0, 0.0, -0.8), (0.8, 0.0, 0.0), material=2),
        hw.box((-0.2, 0.0, 0.0), (0.2, 0.9, 0.4)),
        materials=(hw.GREY, replace(METAL, alpha=0.0), Material(emission=(6.0,) * 3)),
        view=replace(hw.camera(pose, 40, 30), motion=Static(pose)),
        motions=[hw.IDENTITY, hw.IDENTITY, hw.IDENTITY, Glide((-0.3, 0.0, 0.0), (4.0, 0.0, 0.0))],
    )
    cached = brightness(world, CACHED, range(8))[-1]
    paths = brightness(world, RenderOptions(spp=256, sampler="sobol"), [7])[0]
    dark = paths <= np.log(1e-3)
    assert dark[4:12, 18:28].sum() > 30, "there is the mirror"
    assert cached[4:12, 18:28][dark[4:12, 18:28]].max() < np.log(1.01e-3)


def test_gloss_whose_normals_are_bent_is_taken_from_cells():
    """Each bend would take rays of its own, and nothing but metal and glass is meant."""
    others = (
        replace(METAL, bump_texture=0), replace(METAL, normal_texture=0), replace(METAL, alpha=0.0),
        PLASTIC, replace(FROSTED["glass"], bump_texture=0), replace(SOME["glTF's"], metallic=0.4),
    )  # fmt: skip
    assert all(may_be_glossy(material) for material in (*SOME.values(), *FROSTED.values()))
    assert not any(may_be_glossy(material) for material in others)
