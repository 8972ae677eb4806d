"""Rays into soft shadows that are taken from the frames around: against all of them, traced."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clsim.frames import Frame, frame_time_us, page_aligned
from clsim.render import PathTracer, RenderOptions, SceneData
from clsim.render.subframe.retracer import Retracer
from clsim.scene import load_world

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("ordinary")]
WIDTH, HEIGHT = 96, 72
OPTIONS = RenderOptions(
    spp=4, probe_spp=1, first_hit_rays=32, sampler="sobol", light_cache=True, light_hz=30.0, fps=30.0
)  # fmt: skip


@pytest.fixture(scope="module", params=["diffuse", "coated"])
def found(request):
    """Planes of all pixels of a step at three of its times, from both frames and by all rays; who is lit alike."""
    world = load_world("two-boxes", resolution=(WIDTH, HEIGHT))
    if request.param == "coated":
        coated = {"kind": "plastic", "alpha": 0.3}
        materials = (replace(each, **({} if max(each.emission) else coated)) for each in world.materials)
        world = replace(world, materials=tuple(materials))
    tracer = PathTracer(world, OPTIONS)
    frame = Frame(page_aligned((len(tracer.names), HEIGHT, WIDTH)), tracer.names)
    for index in (0, 1, 2, 3):
        tracer.fill(index, frame)
    ends_s = np.array([frame_time_us(index, 30.0) * 1e-6 for index in (2, 3)])
    times_s = ends_s[0] + (ends_s[1] - ends_s[0]) * np.array([0.3, 0.7, 1.0])
    pixels = np.tile(np.arange(WIDTH * HEIGHT, dtype=np.int32), 3)
    planes = []
    for by_frames in (True, False):
        retracer = Retracer(SceneData(world, instants=True), OPTIONS, lambda: tracer, by_frames)
        planes.append(retracer.trace(pixels, times_s.repeat(WIDTH * HEIGHT)).reshape(-1, 3, WIDTH * HEIGHT))
        steady = retracer.steady_shadows()
        retracer.close()
    tracer.close()
    rays = tracer.names.index("Samples")
    return [each[:3].sum(axis=0) for each in planes], [each[rays] for each in planes], steady


def test_most_rays_into_soft_shadows_are_not_traced_again(found):
    _, (few, every), _ = found
    in_shadow = few[:2] < every[:2]
    assert in_shadow.sum() > 100 and few[:2][in_shadow].mean() < 0.2 * every[:2][in_shadow].mean()
    assert (few <= every).all()


def test_light_is_that_which_all_rays_find(found):
    """At a frame's time it is the frame's; between two, a few rays met something that no frame saw."""
    (told, traced), (few, every), _ = found
    off = np.abs(told / traced - 1.0)
    assert off[2].max() < 1e-5
    in_shadow = few[:2] < every[:2]
    assert np.quantile(off[:2][in_shadow], 0.95) < 2e-3
    assert (off[:2][~in_shadow] < 1e-6).all()


def test_light_that_the_same_rays_found_is_a_line_in_time(found):
    """Where it is found by one ray more or less in one frame, it is not told to be steady."""
    (_, traced), (few, every), steady = found
    in_shadow = few[0] < every[0]
    assert 30 < (steady & in_shadow).sum() < in_shadow.sum()
    # Steady pixels needed no ray inside but one for what is small.
    assert few[:2][:, steady & in_shadow].max() <= 2 < few[:2][:, ~steady & in_shadow].max()
    assert traced.min() > 0.0


def test_black_squares_are_no_shadow():
    """Against plain paths: rays that meet them also tell whether the lamps reach the floor there."""
    world = load_world("two-boxes", resolution=(48, 36))
    black = (0.0, 0.0, 0.0)
    world = replace(world, textures=tuple(replace(texture, color_b=black) for texture in world.textures))
    found = []
    for options in (replace(OPTIONS, light_hz=None), RenderOptions(spp=1024, sampler="sobol", fps=30.0)):
        tracer = PathTracer(world, options)
        frame = Frame(page_aligned((len(tracer.names), 36, 48)), tracer.names)
        tracer.fill(0, frame)
        tracer.close()
        found.append(frame.planes[:3].sum(axis=0))
    sparse, plain = (np.log(each[found[1] > 0.01]) for each in found)
    assert np.sqrt(np.mean((sparse - plain) ** 2)) < 0.3
