"""Deforming meshes: each frame shows the shape of its time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from clsim.frames import Frame, page_aligned
from clsim.render import PathTracer, RenderOptions
from clsim.scene import Camera, Instance, Lens, Material, Static, load_world
from tests.render import hand_worlds as hw

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("any_lights")]  # kernels of their own are compiled

FOX = Path(__file__).parents[3].parent / "shared" / "assets" / "gltf" / "Fox.glb"


@dataclass(frozen=True)
class Swell:
    """A ball that grows, leaves its place and turns into an ellipsoid."""

    rest: object
    smooth: bool = True
    duration_s: float = 4.0

    def vertices_at(self, time_s):
        stretch = np.array((1 + time_s, 1.0, 1 + 0.5 * time_s))
        vertices = self.rest.vertices * stretch + (0.3 * time_s, 0.0, 0.0)
        normals = self.rest.normals / stretch
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return vertices.astype(np.float32), normals.astype(np.float32) if self.smooth else None


@dataclass(frozen=True)
class Lift:
    duration_s: float = 4.0

    def pose(self, time_s):
        return hw.translation(-0.8, 0.1 * time_s, 0.0)


def swelling(time_s=None, moving=False, smooth=True):
    """A deforming ball next to a still one; at a given time, the same with a mesh that has that shape for good."""
    rest = hw.ball(0.4, rings=8, smooth=True)
    deforming = replace(rest, deformation=Swell(rest, smooth))
    motion = Lift() if moving else hw.IDENTITY
    if time_s is not None:
        vertices, normals = deforming.deformation.vertices_at(time_s)
        deforming = replace(rest, vertices=vertices, normals=normals)
        motion = Static(motion.pose(time_s))
    scene = hw.world(
        hw.quad((-3, -0.5, 3), (6, 0, 0), (0, 0, -6)),
        deforming,
        motions=[hw.IDENTITY, motion],
        view=hw.camera(hw.look_from((0.5, 1, 4), (0, 0, 0)), 24, 18),
        environment=(1.0, 0.9, 0.8),
        fps=2.0,
    )
    twin = Instance(1, Static(hw.translation(-0.5, 0.8, -1.0)))
    return replace(scene, instances=(*scene.instances, twin))


def same(a, b):
    for name in a.names[:12]:
        # Roundings differ, so that a path may fall on the other side of an edge now and then.
        x, y = a.plane(name), b.plane(name)
        assert np.isclose(x, y, rtol=1e-3, atol=1e-4).mean() > 0.96, name
        assert abs(x.mean() - y.mean()) < 0.01 * (np.abs(y).mean() + 1e-3), name


@pytest.mark.parametrize("tree", ["bvh16", pytest.param("warp", marks=pytest.mark.slow)])
@pytest.mark.parametrize("options", [{}, {"moving": True}, {"smooth": False}])
def test_a_frame_shows_the_shape_of_its_time(tree, options):
    for index in (0, 3, 5):
        shown = hw.render(swelling(**options), index, spp=16, tree=tree)
        same(shown, hw.render(swelling(index / 2, **options), spp=16, tree=tree))


def test_frames_may_come_in_any_order():
    tracer = PathTracer(swelling(), RenderOptions(spp=2, threads=1, variances=True))
    frame = Frame(page_aligned((len(tracer.names), 18, 24)), tracer.names)
    for index in (5, 0, 3, 8, 3):
        tracer.fill(index, frame)
        np.testing.assert_array_equal(frame.planes, hw.render(swelling(), index, spp=2).planes)
    tracer.close()


def test_a_deformation_without_an_end_has_its_one_shape():
    """A skin that no animation moves: still, yet not at rest."""
    scene = swelling()
    mesh = scene.meshes[1]

    @dataclass(frozen=True)
    class Held:
        duration_s: float = 0.0

        def vertices_at(self, time_s):
            return mesh.deformation.vertices_at(1.5)

    held = replace(scene, meshes=(scene.meshes[0], replace(mesh, deformation=Held())))
    same(hw.render(held, spp=16), hw.render(swelling(1.5), spp=16))


@dataclass(frozen=True)
class Slide:
    """A motion and a deformation: the same way, by the one or the other."""

    rest: object = None
    duration_s: float = 4.0

    def pose(self, time_s):
        return hw.translation(2.0 * (time_s - 2.0), 0.0, 0.0)

    def vertices_at(self, time_s):
        return np.add(self.rest.vertices, (2.0 * (time_s - 2.0), 0.0, 0.0), dtype=np.float32), None


def sliding(deforming, shutter_s, emission=(0.0, 0.0, 0.0), spp=256, **options):
    """A square that crosses eight of 48 pixels within the exposure, at the time when it is in the middle."""
    square = hw.quad((-0.5, -0.5, 0), (1, 0, 0), (0, 1, 0))
    view = hw.camera(hw.translation(0, 0, 3), 48, 12, 2 * np.degrees(np.arctan(0.5)))
    scene = hw.world(
        replace(square, deformation=Slide(square)) if deforming else square,
        materials=(Material(color=(0.5, 0.5, 0.5), emission=emission),),
        motions=[hw.IDENTITY if deforming else Slide()],
        view=replace(view, shutter_s=shutter_s),
        environment=(0.0, 0.0, 0.0) if any(emission) else (1.0, 1.0, 1.0),
        fps=1.0,
    )
    return hw.render(scene, 2, spp=spp, **options)


@pytest.mark.parametrize("tree", ["bvh16", pytest.param("warp", marks=pytest.mark.slow)])
def test_what_deforms_blurs_as_what_moves(tree):
    """Nine shapes make steps of a pixel here, whose halves at the ends are 1/16 of the ramp."""
    blurred = sliding(True, 0.25, tree=tree).plane("Coverage").mean(axis=0)
    moved = sliding(False, 0.25, tree=tree).plane("Coverage").mean(axis=0)
    assert np.abs(blurred - moved).max() < 1 / 16 + 0.04
    assert abs(blurred.sum() - moved.sum()) < 0.2
    ramp = (moved > 0.1) & (moved < 0.9)
    assert ramp.sum() >= 12
    still = sliding(True, 0.0, tree=tree).plane("Coverage").mean(axis=0)
    assert np.abs(still - moved)[ramp].max() > 0.4


def test_a_blurred_lamp_that_deforms_is_found_both_ways():
    """What a deforming lamp gives to a wall does not depend on how it is found."""
    lamp = hw.quad((-0.5, 1.0, -0.5), (0, 0, 1), (1, 0, 0), material=1)
    wall = hw.quad((-3, 0, 3), (6, 0, 0), (0, 0, -6))
    scene = hw.world(
        wall,
        replace(lamp, deformation=Slide(lamp)),
        materials=(hw.GREY, Material(color=(0, 0, 0), emission=(5.0, 5.0, 5.0))),
        view=replace(hw.camera(hw.look_from((0, 3, 0.1), (0, 0, 0)), 16, 12, 60.0), shutter_s=0.5),
        fps=1.0,
    )
    (by_light, error), (by_scatter, other) = (
        hw.mean_and_error(hw.render(scene, 2, spp=512, strategy=strategy)) for strategy in ("light", "scatter")
    )
    assert (np.abs(by_light - by_scatter) < 4 * np.hypot(error, other)).all()
    assert (other < 0.02 * by_light).all()


def test_what_deforms_is_in_the_middle_of_its_way_on_average():
    """Shapes that came late by a sixteenth of the exposure would be half a pixel off."""
    places = np.arange(48)
    centres = [
        (coverage * places).sum() / coverage.sum()
        for coverage in (sliding(d, 0.25, spp=256).plane("Coverage").mean(axis=0) for d in (True, False))
    ]
    assert abs(centres[0] - 23.5) < 0.1 and abs(centres[1] - 23.5) < 0.1


@pytest.mark.skipif(not FOX.exists(), reason="the folder of shared scenes is not there")
def test_the_fox_walks():
    """Its legs are at other places, and each frame shows the mesh of its time."""
    world = load_world(str(FOX))
    deforming = [mesh for mesh in world.meshes if mesh.deformation is not None]
    assert deforming and deforming[0].deformation.duration_s > 0
    vertices, _ = deforming[0].deformation.vertices_at(0.0)
    instance = next(i for i in world.instances if world.meshes[i.mesh].deformation is not None)
    placed = vertices @ instance.motion.pose(0.0)[:3, :3].T + instance.motion.pose(0.0)[:3, 3]
    centre, size = placed.mean(axis=0), np.ptp(placed, axis=0).max()
    pose = hw.look_from(np.add(centre, (size, 0.3 * size, 0)), centre)
    world = replace(world, camera=Camera(48, 36, 60.0, Static(pose), lens=Lens()))
    frames = [hw.render(world, index, spp=4) for index in (0, 20, 40)]
    seen = [frame.plane("Coverage") > 0.5 for frame in frames]
    assert all(mask.mean() > 0.05 for mask in seen)
    time_s = frames[1].time_us * 1e-6
    frozen = tuple(
        replace(
            mesh,
            deformation=None,
            **dict(zip(("vertices", "normals"), mesh.deformation.vertices_at(time_s), strict=True)),
        )
        if mesh.deformation
        else mesh
        for mesh in world.meshes
    )
    np.testing.assert_allclose(
        hw.render(replace(world, meshes=frozen), 20, spp=4).plane("Depth"), frames[1].plane("Depth"), rtol=1e-3
    )
    depths = [frame.plane("Depth") for frame in frames]
    assert (np.abs(depths[0] - depths[1]) > 0.02 * size).mean() > 0.01
