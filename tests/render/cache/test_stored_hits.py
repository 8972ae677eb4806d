"""What pixels saw while the camera stands: seen again where nothing came in the way, and as if it were sampled."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clsim.frames import RADIANCE, Frame, page_aligned
from clsim.render import PathTracer, RenderOptions
from clsim.render.cache.stored_hits import StoredHits
from clsim.render.cache.stored_hits_host import StoredHitsHost
from clsim.render.features import scene_lamps
from clsim.render.primary.effort import Effort
from clsim.scene import Material, PunctualLight, SphereLight, Static
from clsim.scene.motion import Keyframes
from tests.render import hand_worlds as hw
from tests.render.motion.test_blur import Glide
from tests.render.motion.test_deform import Swell

pytestmark = pytest.mark.usefixtures("ordinary")

OPTIONS = RenderOptions(
    spp=4, probe_spp=1, probe_every=1000, first_hit_rays=16, sampler="sobol", light_cache=True, fps=100, frames=8
)
SIZE = (28, 20)
BULB = SphereLight(0.2, (40.0, 40.0, 40.0), Static(hw.translation(1.2, 3.5, 1.0)), "bulb")
SUN = PunctualLight("directional", (2.0, 2.0, 2.0), Static(hw.look_from((3.0, 4.0, 2.0), (0.0, 0.0, 0.0))))
PANEL = hw.quad((-0.5, 3.9, 0.5), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0), material=2)
INTO_VIEW, ABOVE_IT = Glide((-1.4, 0.4, 0.2), (6.0, 0.0, 0.0)), Glide((-0.8, 2.6, 0.6), (9.0, 0.0, 0.0))
MATERIALS = (
    hw.GREY,
    Material(color=(0.7, 0.1, 0.1)),
    Material(emission=(9.0, 9.0, 9.0)),
    Material(kind="conductor", color=(0.9, 0.9, 0.9), alpha=0.0),
)


def world_of(box, *more, lamps=(BULB,), suns=(), floor=0, shape=None, environment=(0.3, 0.3, 0.4), camera=None):
    """A floor and a wall, before which a box goes its way; the sky is seen above and beside them."""
    pose = hw.look_from((0.4, 1.4, 4.5), (0, 0.6, -0.5))
    meshes = (
        hw.quad((-2, 0, 2), (4, 0, 0), (0, 0, -4), material=floor),
        hw.quad((-1, 0, -2), (2, 0, 0), (0, 1.5, 0)),
        shape or hw.box((-0.3, -0.3, -0.3), (0.3, 0.3, 0.3), material=1),
        *more,
    )
    return hw.world(
        *meshes,
        materials=MATERIALS,
        view=replace(hw.camera(pose, *SIZE), motion=camera or Static(pose)),
        motions=[hw.IDENTITY, hw.IDENTITY, box, *[hw.IDENTITY] * len(more)],
        sphere_lights=lamps,
        punctual_lights=suns,
        environment=environment,
    )


BALL = hw.ball(0.4, rings=8, smooth=True)
WORLDS = {
    "goes by": world_of(INTO_VIEW),
    "only its shadow is seen": world_of(ABOVE_IT),
    "in sunlight": world_of(ABOVE_IT, lamps=(), suns=(SUN,)),
    "below a panel": world_of(ABOVE_IT, PANEL, lamps=()),
    "in skylight alone": world_of(INTO_VIEW, lamps=(), environment=(1.0, 1.0, 1.0)),
    "seen in a mirror": world_of(Glide((-1.4, 0.9, 0.2), (6.0, 0.0, 0.0)), floor=3),
    "swells": world_of(hw.IDENTITY, shape=replace(BALL, deformation=Swell(BALL, smooth=True))),
    "is a lamp": world_of(INTO_VIEW, lamps=(replace(BULB, motion=Glide((-1.0, 2.0, 1.0), (5.0, 0.0, 0.0))),)),
}

OWN_KERNELS = ("in sunlight", "in skylight alone", "seen in a mirror", "swells")


def pictures(world, count=8, then=lambda tracer, index: None):
    """Return the radiance of frames 10 ms apart ``[frames, 3, H, W]``, and how many primary rays each took."""
    tracer = PathTracer(world, OPTIONS)
    frame = Frame(page_aligned((len(tracer.names), tracer.height, tracer.width)), tracer.names)
    shown, rays = [], [0]
    try:
        for index in range(count):
            then(tracer, index)
            tracer.fill_at(index, index * 10_000, frame)
            shown.append(np.stack([frame.plane(name) for name in RADIANCE]))
            rays.append(tracer.first_hit_rays)
    finally:
        tracer.close()
    return np.stack(shown), np.diff(rays)


def sampled(monkeypatch, *about):
    """Return what `pictures` does where all pixels are sampled in every frame."""
    with monkeypatch.context() as patch:
        patch.setattr(StoredHitsHost, "prepare", lambda *_: StoredHits())
        return pictures(*about)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in OWN_KERNELS)) for name in WORLDS]
)
def test_a_standing_camera_sees_what_it_would_see_if_all_were_sampled(monkeypatch, name):
    """To a rounding, in all pixels; what moves, shades or is mirrored changes some of them."""
    # Just beyond all there is: so near that a direction to a place there would differ from pixel to pixel.
    monkeypatch.setattr(scene_lamps, "_FAR_M", 8.0)
    shown, rays = pictures(WORLDS[name])
    every, all_rays = sampled(monkeypatch, WORLDS[name])
    np.testing.assert_allclose(shown, every, rtol=1e-5, atol=1e-7)
    changes = np.abs(np.diff(np.log(every.mean(axis=1) + 1e-3), axis=0)).max(axis=(1, 2))
    assert changes[2:].max() > 0.02
    # From the third frame on: the second one tells that the camera stands.
    if name not in ("is a lamp", "seen in a mirror"):
        assert rays[2:].sum() < 0.7 * all_rays[2:].sum()
    assert np.all(rays <= all_rays)


def test_a_camera_that_stops_and_goes_on_sees_all_anew(monkeypatch):
    pose = hw.look_from((0.4, 1.4, 4.5), (0, 0.6, -0.5))
    there, here = tuple(pose[:3, 3]), (0.5, 1.5, 4.4)
    camera = Keyframes((0.0, 0.02, 0.05, 0.07), (there, here, here, there), ((0.0, 0.0, 0.0, 1.0),) * 4)
    world = world_of(INTO_VIEW, camera=camera)
    shown, rays = pictures(world)
    every, all_rays = sampled(monkeypatch, world)
    np.testing.assert_allclose(shown, every, rtol=1e-5, atol=1e-7)
    assert list(rays < 0.8 * all_rays) == [False] * 4 + [True, True] + [False] * 2


def test_other_light_and_another_effort_are_seen_at_once(monkeypatch):
    def then(tracer, index):
        if index == 4:
            tracer._data.set_light("bulb", (5.0, 5.0, 5.0))
            tracer.forget_light()
        if index == 6:
            tracer.effort = Effort(4, 1, 4, 1000)

    world = world_of(INTO_VIEW)
    shown, rays = pictures(world, 8, then)
    every, all_rays = sampled(monkeypatch, world, 8, then)
    np.testing.assert_allclose(shown, every, rtol=1e-5, atol=1e-7)
    assert list(rays < 0.8 * all_rays) == [False, False, True, True, False, True, False, True]


def test_where_nearly_all_moves_nothing_is_stored_for_a_while(monkeypatch):
    """A box before the whole picture: after a try, pixels are sampled without asking what they saw."""
    written, prepare = [], StoredHitsHost.prepare

    def noted(host, *about):
        hits = prepare(host, *about)
        written.append(bool(hits.writes))
        return hits

    monkeypatch.setattr(StoredHitsHost, "prepare", noted)
    pictures(world_of(Glide((0.0, 0.9, 2.5), (0.3, 0.0, 0.0)), shape=hw.box((-2, -2, -0.1), (2, 2, 0.1))), 22)
    assert written == [False, True, True] + [False] * 16 + [True, True, False]
