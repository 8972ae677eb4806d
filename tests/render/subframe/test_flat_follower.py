"""What pixels reflect that show one flat surface, at any time, against rays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

import clsim
from clsim.detect.subframe.flat_pixels import FlatBrightness, FlatPixels
from clsim.detect.subframe.knots import Knots
from clsim.frames import ALBEDO, Fineness
from clsim.render import RenderOptions, SceneData
from clsim.render.camera.film import Sample
from clsim.render.kernel_input import settings_of
from clsim.render.subframe.flat_pixels import build_flat_pixels
from clsim.scene import Lens, load_world
from clsim.score.matching import Sampling, one_to_one
from tests.render.primary.test_steered import textured_world

SIZE = (64, 48)
PARALLEL = Lens(model="orthographic", view_width_m=4.0)
START_S, END_S = 0.0333333, 0.0666667


@pytest.mark.parametrize("coated", [False, True])
def test_kernels_of_textured_scenes_are_declared(coated):
    world = textured_world()
    if coated:
        floor, *others = world.materials
        world = replace(world, materials=(replace(floor, kind="plastic"), *others))
    features = RenderOptions(light_cache=True, first_hit_rays=16, probe_spp=1).features_of(world)
    assert features.coats == coated and len(build_flat_pixels(features)) == 3


def test_light_of_a_surface_s_own_or_of_a_coat_bounds_what_its_texture_tells():
    """It is not in proportion to the albedo. Corners of a floor see the one or the other, or both; the rest is flat."""
    world, (width, height) = textured_world(), (12, 9)
    data, options = SceneData(world), RenderOptions(light_cache=True, first_hit_rays=16, probe_spp=1)
    y, x = np.indices((height + 1, width + 1)).reshape(2, -1)
    seen = np.zeros(len(x), Sample.numpy_dtype())
    seen["position"], seen["uv"] = np.stack([x, y, 0 * x], axis=1), np.stack([x, y], axis=1)
    seen["normal"], seen["depth"], seen["material"], seen["hit"], seen["front"] = (0, 0, 1), 5.0, 1, True, True
    shines, coated = (x > 2) & (x < 6) & (y > 3), (x > 4) & (x < 9) & (y > 5)
    seen["emission"][shines], seen["coat"][coated] = (0.1, 0.0, 0.0), (0.0, 0.02, 0.02)
    bound, *_ = build_flat_pixels(options.features(data.features, world.camera, requests=True))
    bounds = wp.full(len(x), 9, dtype=wp.uint8, device="cpu")
    settings = settings_of(options, replace(world.camera, width=width, height=height), world.sensor)
    given = [data.scene, settings, 0, len(x), height + 1, wp.array(seen, dtype=Sample, device="cpu")]
    wp.launch(bound, 1, inputs=given, outputs=[bounds], device="cpu")
    last = (x == width) | (y == height)
    np.testing.assert_array_equal(bounds.numpy() != 0, shines | coated | last)


@pytest.mark.slow
@pytest.mark.parametrize(("linear", "lens"), [(True, Lens()), (False, Lens()), (True, PARALLEL)])
def test_albedo_between_frames_is_what_rays_find(monkeypatch, linear, lens):
    """Lines between the times that are told stay within what was asked for, and its ends are the frames'."""
    options = {"quality": "balanced", "time": "adaptive", "fps": 30.0}
    found, find = [], FlatPixels.find
    monkeypatch.setattr(FlatPixels, "find", lambda *given: found.append(find(*given)) or found[-1])
    world = load_world("two-boxes")
    world = replace(world, camera=replace(world.camera, lens=lens, width=SIZE[0], height=SIZE[1]))
    with clsim.Simulator(world, **options) as simulator:
        simulator.step(66_667)
        tracer = simulator._camera_pipeline.detector._tracer
        pixels = np.flatnonzero(found[-1].known)
        fineness = Fineness(least=0.002, late=0.0, longest=0.5, finest=1e-4, linear=linear)
        light = np.zeros((6, SIZE[0] * SIZE[1]), np.float32)
        light[[1, 4]] = [[1.0], [1.1]]
        told = tracer.reflected(pixels, light, START_S, END_S, fineness)
        assert len(told.known) > 500 and 100 < len(told.pixels) < len(told.known)
        assert (told.shares[told.firsts[:-1]] == 0).all() and (told.shares[told.firsts[1:] - 1] == 1).all()
        random = np.random.default_rng(1)
        chosen = random.choice(len(told.pixels), 200)
        shares = random.uniform(0, 1, 200)
        rows = [slice(*told.firsts[i : i + 2]) for i in chosen]
        shape = (lambda a: a, lambda a: a) if linear else (np.log, np.exp)
        lines = [
            shape[1](np.interp(share, told.shares[row], shape[0](told.values[row])))
            for share, row in zip(shares, rows, strict=True)
        ]
        planes = tracer.trace(told.pixels[chosen].astype(np.int32), START_S + shares * (END_S - START_S))
        seen = planes[tracer.names.index(ALBEDO[1])] * (1.0 + 0.1 * shares)
        # Beside the lines there is what float32 leaves of places on far surfaces.
        assert np.quantile(np.abs(lines / seen - 1), 0.95) < 0.004 and np.abs(lines / seen - 1).max() < 0.02
        # What stays as it is does so for rays.
        rest = np.setdiff1d(told.known, told.pixels)[:100].astype(np.int32)
        ends = [tracer.trace(rest, np.full(len(rest), time))[tracer.names.index(ALBEDO[1])] for time in (START_S, 0.05)]
        np.testing.assert_allclose(*ends, rtol=1e-4)


@pytest.mark.slow
def test_flat_pixels_fire_as_if_they_were_traced(monkeypatch):
    def run():
        options = {"resolution": SIZE, "quality": "balanced", "time": "adaptive", "time_tolerance_us": 10.0}
        with clsim.Simulator("two-boxes", fps=30.0, **options) as simulator:
            events = simulator.step(100_000)
            return events, simulator._camera_pipeline.detector.between.stats.requests

    find = FlatPixels.find

    def nothing_known(*given):
        """All are traced where they may fire by themselves, as those are over which something else may come."""
        told = find(*given)
        numbers = np.concatenate([told.knots.pixels, told.unsure_knots.pixels + len(told.pixels)])
        times, levels = (
            np.concatenate([getattr(part, name) for part in (told.knots, told.unsure_knots)])
            for name in ("times", "levels")
        )
        every = Knots(numbers, times, levels, np.zeros(len(numbers)), told.knots.linear_light)
        nowhere = told.knots.of(np.zeros(len(told.knots.pixels), bool))
        unsure = np.concatenate([told.pixels, told.unsure])
        return FlatBrightness(np.zeros_like(told.known), told.pixels[:0], nowhere, unsure, every)

    events, few = run()
    monkeypatch.setattr(FlatPixels, "find", nothing_known)
    traced, many = run()
    differences = np.abs(one_to_one(events, traced, Sampling(*SIZE, 30.0), 1000))
    assert few < 0.8 * many and len(differences) > 0.99 * max(len(events), len(traced))
    # Most events are of pixels that are traced in both runs: the median would tell nothing of the others.
    assert np.quantile(differences, 0.9) < 80


@pytest.mark.slow
def test_nothing_is_told_of_what_has_a_coat(monkeypatch):
    """Light from there is not in proportion to the texture: a coat reflects as much over dark squares."""
    found, find = [], FlatPixels.find
    monkeypatch.setattr(FlatPixels, "find", lambda *given: found.append(find(*given)) or found[-1])
    scene = load_world("two-boxes")
    coated = tuple(replace(each, kind="plastic") if each.texture >= 0 else each for each in scene.materials)
    camera = replace(scene.camera, width=SIZE[0], height=SIZE[1])
    scene = replace(scene, materials=coated, camera=camera)
    with clsim.Simulator(scene, quality="balanced", time="adaptive", fps=30.0) as simulator:
        assert len(simulator.step(66_667))
    assert not found[-1].known.any()
