"""The published adaptive sampler: its moments, its test, and what it counts."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from clsim.frames import ALL_PLANES, Frame
from clsim.render import PathTracer, RenderOptions
from clsim.scene import Sensor, load_world
from tools.peers import manabe
from tools.peers.manabe import Moments, decide, run_manabe

SENSOR = Sensor(threshold_on=0.2, threshold_off=0.3, floor=1e-4)


def moments(samples: np.ndarray) -> Moments:
    """Return those of samples ``[n, H, W]``."""
    n = np.full(samples.shape[1:], float(len(samples)))
    return Moments(n, samples.mean(axis=0), samples.var(axis=0) * len(samples))


def test_merged_moments_are_those_of_all_samples() -> None:
    samples = np.random.default_rng(0).lognormal(size=(320, 2, 3))
    some = np.array([[True, False, True], [True, True, False]])
    merged = moments(samples[:256])
    merged.merge(moments(samples[256:]), some)
    whole, part = moments(samples), moments(samples[:256])
    for name in ("count", "mean", "m2"):
        expected = np.where(some, getattr(whole, name), getattr(part, name))
        np.testing.assert_allclose(getattr(merged, name), expected, rtol=1e-12)


def test_a_frames_moments_are_those_of_its_samples() -> None:
    """Two batches merged have the planes of one rendering that holds both: samples are prefixes of longer ones."""
    world = load_world("two-boxes", resolution=(8, 6))

    def rendered(spp: int) -> Moments:
        tracer = PathTracer(world, RenderOptions(spp=spp, variances=True, frames=1))
        frame = Frame(np.zeros((len(ALL_PLANES), 6, 8), np.float32), ALL_PLANES)
        tracer.fill(0, frame)
        tracer.close()
        return Moments.of(frame)

    two, three = rendered(2), rendered(3)
    third = 3 * three.mean - 2 * two.mean
    two.merge(Moments(np.ones((6, 8)), third, np.zeros((6, 8))), np.ones((6, 8), dtype=bool))
    np.testing.assert_allclose(two.m2, three.m2, rtol=1e-3, atol=1e-6)


def test_the_test_is_welchs() -> None:
    """Against SciPy's own, on brightness as the delta method has it."""
    rng = np.random.default_rng(1)
    then, now = moments(rng.gamma(2.0, 0.5, (512, 20, 20))), moments(rng.gamma(2.0, 0.6, (256, 20, 20)))
    (old, old_variance), (new, variance) = then.log_brightness(SENSOR), now.log_brightness(SENSOR)
    np.testing.assert_allclose(new - old, decide(now, then, SENSOR).change)
    threshold = np.where(new > old, SENSOR.threshold_on, SENSOR.threshold_off)
    result = stats.ttest_ind_from_stats(
        np.abs(new - old), np.sqrt(variance * 256), 256, threshold, np.sqrt(old_variance * 512), 512, equal_var=False
    )
    decision = decide(now, then, SENSOR)
    np.testing.assert_array_equal(decision.beyond, (result.pvalue <= 0.05) & (result.statistic > 0))
    np.testing.assert_array_equal(decision.within, (result.pvalue <= 0.05) & (result.statistic < 0))
    assert 0 < (decision.beyond | decision.within).mean() < 1


def test_wrong_decisions_are_as_rare_as_stated() -> None:
    """At the threshold itself, one look is wrong about either side in 2.5 % of the cases."""
    rng = np.random.default_rng(2)
    then = moments(rng.gamma(4.0, 0.25, (256, 100, 100)))
    now = moments(rng.gamma(4.0, 0.25 * np.exp(SENSOR.threshold_on), (256, 100, 100)))
    decision = decide(now, then, SENSOR)
    assert decision.beyond.mean() == pytest.approx(0.025, abs=0.006)
    assert decision.within.mean() == pytest.approx(0.025, abs=0.006)


def test_the_logarithm_has_no_bias() -> None:
    samples = np.random.default_rng(3).gamma(0.5, 2.0, (64, 200, 200))
    level, variance = moments(samples).log_brightness(SENSOR)
    assert abs(level.mean()) < 0.002 < variance.mean() / 4
    assert variance.mean() == pytest.approx(level.var(), rel=0.06)


def test_darkness_decides_at_once() -> None:
    dark = Moments(np.full((1, 1), 256.0), np.zeros((1, 1)), np.zeros((1, 1)))
    decision = decide(dark, dark, SENSOR)
    assert decision.within.all() and not decision.beyond.any()


def test_paths_are_those_that_pixels_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in (("FIRST", 8), ("STEP", 4), ("CAP", 16)):
        monkeypatch.setattr(manabe, name, value)
    world, pixels, told = load_world("two-boxes", resolution=(12, 9)), 12 * 9, []
    run = run_manabe(world, RenderOptions(frames=4, fps=20.0, seed=1), told.append)
    rendered = sum(told) * pixels
    least = (16 + 3 * 8) * pixels
    assert set(told) == {8, 4} and least < run.paths < rendered == (4 * 16) * pixels
    assert len(run.events) > 0 and np.all(np.diff(run.events["t"]) >= 0)
    assert set(run.events["t"]) <= {50_000, 100_000, 150_000}
    assert 0 < run.undecided < 1 and run.render_cpu_s > 0 and run.testing.cpu_s > 0
    monkeypatch.setattr(manabe, "CONFIDENCE", 0.0)
    assert run_manabe(world, RenderOptions(frames=4, fps=20.0, seed=1), told.append).paths == least
