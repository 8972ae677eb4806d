"""The renderer's bench in scenes from files."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from clsim.bench.throughput import scene
from clsim.bench.throughput.scene import WIDTH, narrow, scene_throughput
from clsim.scene import load_world


def test_a_picture_keeps_its_shape():
    camera = narrow(load_world("two-boxes", resolution=(640, 480))).camera
    assert (camera.width, camera.height) == (WIDTH, 3 * WIDTH // 4)


def test_figures_of_two_pictures_by_hand(monkeypatch):
    """Of 1 and 3 everywhere: a mean of 2 and a deviation of √2; five seconds each."""
    monkeypatch.setattr(scene, "_tracer", lambda world, spp, seed: SimpleNamespace(seed=seed, close=lambda: None))
    monkeypatch.setattr(scene, "_picture", lambda tracer: np.full((3, 120, 160), 1.0 + 2 * tracer.seed))
    monkeypatch.setattr(scene, "take_turns", lambda works, rounds: ({}, dict.fromkeys(works, 5.0)))
    found = scene_throughput(load_world("two-boxes", resolution=(32, 24)), spp=7)
    figures = {name: value["clsim"] for name, value in found.items()}
    pixels = 160 * 120
    assert figures == pytest.approx({
        "mean_radiance": 2.0, "relative_noise": 2**-0.5, "paths_per_cpu_second": 7 * pixels / 5,
        "efficiency": pixels / (5 * 0.5),
    })  # fmt: skip


@pytest.mark.slow
def test_noise_and_efficiency_are_of_the_same_picture():
    def other(seed):
        return 2.0 + np.random.default_rng(seed).normal(scale=0.1, size=(3, 400, 400))

    coarse, fine = (scene_throughput(load_world("two-boxes"), spp=spp, others={"other": other}) for spp in (4, 16))
    assert abs(coarse["relative_noise"]["other"] / 0.05 - 1) < 0.02
    assert coarse["mean_radiance"]["other"] == pytest.approx(2.0, rel=1e-3)
    assert fine["mean_radiance"]["clsim"] == pytest.approx(coarse["mean_radiance"]["clsim"], rel=0.02)
    # Four times the paths: half the noise, and the same efficiency, but for what a picture costs beside its paths.
    assert 1.5 < coarse["relative_noise"]["clsim"] / fine["relative_noise"]["clsim"] < 2.7
    assert 0.4 < fine["efficiency"]["clsim"] / coarse["efficiency"]["clsim"] < 2.5
    rate, noise = fine["paths_per_cpu_second"]["clsim"], fine["relative_noise"]["clsim"]
    assert fine["efficiency"]["clsim"] == pytest.approx(rate / 16 / noise**2)
    assert rate > WIDTH
