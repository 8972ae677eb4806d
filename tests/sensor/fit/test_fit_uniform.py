"""Even scenes in several lights tell thresholds, photons and leak: of looks that count photons, drawn one by one."""

import json
import math
import sys

import numpy as np
import pytest
from scipy.stats import norm, poisson

import clsim
from clsim.cli import main
from clsim.errors import InputError
from clsim.events import empty_batch
from clsim.sensor import load_sensor
from clsim.sensor.fit import uniform
from clsim.sensor.fit.fitted import noise_table, sensor_file, uniform_rows
from clsim.sensor.fit.still import Counts
from clsim.sensor.fit.uniform import Rates, UniformFit, fit_uniform, look_probabilities, rates_of

TRUE = {"on": 0.2, "off": 0.25, "per_lux": 5.0, "dark": 2.0, "look_s": 0.005, "leak_hz": 0.5, "per_lux_hz": 0.01}
LUX = (0.2, 1.0, 5.0, 20.0, 60.0, 200.0)
SHAPE = (20, 20)


def looks(generator, lux, count, on, off, per_lux, dark, look_s, leak_hz, per_lux_hz):
    """Return which looks of each pixel fire ON and OFF, ``[looks, H, W]``, and leaks beside."""
    thresholds = [mean * (1 + 0.1 * generator.normal(size=SHAPE)) for mean in (on, off)]
    for light in lux:
        level = np.log(generator.poisson(per_lux * light, (count + 1, *SHAPE)) + dark)
        rise = np.diff(level, axis=0)
        leaks = generator.random(rise.shape) < (leak_hz + per_lux_hz * light) * look_s
        yield rise >= thresholds[0], -rise >= thresholds[1], leaks


def recorded(seed, count=400):
    counts = []
    for on, off, leaks in looks(np.random.default_rng(seed), LUX, count, **TRUE):
        each = Counts.of_size(*SHAPE[::-1])
        each.on[...], each.off[...], each.seconds = (on.sum(0) + leaks.sum(0)), off.sum(0), count * TRUE["look_s"]
        counts.append(each)
    return [rates_of(light, each, np.ones(SHAPE, bool)) for light, each in zip(LUX, counts, strict=True)]


def errors_off(found):
    numbers = found.on, found.off, found.photons_per_lux, found.dark_photons, found.look_s
    numbers += found.leak_hz, found.leak_hz_per_lux
    return np.array([abs(n[0] - true) / n[1] for n, true in zip(numbers, TRUE.values(), strict=True)])


@pytest.mark.parametrize("photons", [3.0, 20.0])
def test_chances_are_those_of_all_pairs_of_counts(photons):
    dark, on, off = 0.4, 0.3, 0.4
    expected = np.zeros(2)
    spread, chance = norm(1.0, 0.1).ppf((np.arange(1000) + 0.5) / 1000), poisson.pmf(np.arange(60), photons)
    for m in range(60):
        for n in range(60):
            step = math.log((n + dark) / (m + dark))
            expected += chance[m] * chance[n] * np.array([(step >= on * spread).mean(), (-step >= off * spread).mean()])
    np.testing.assert_allclose(look_probabilities(photons, dark, on, off), expected, rtol=0.01)


@pytest.mark.parametrize("dark", [0.0, 2.0, 30.0, 100.0])
def test_many_photons_are_normal(dark):
    below, above = (look_probabilities(photons, dark, 0.2, 0.25) for photons in (149.9, 150.1))
    np.testing.assert_allclose(below, above, rtol=0.12)
    assert max(look_probabilities(1e5, 2.0, 0.2, 0.25)) < 1e-12


def test_thresholds_photons_and_leak_are_found(tmp_path):
    rates = recorded(3)
    found = fit_uniform(rates)
    # A sensor file has lights from the darkest on, in whatever order they were recorded.
    (tmp_path / "a.toml").write_text(noise_table(rates[::-1], found))
    noise = load_sensor(str(tmp_path / "a.toml")).noise
    assert noise.lux == LUX and noise.off_hz == pytest.approx([each.off_hz[0] for each in rates], rel=1e-4)
    # What leaks is no noise; where chance has it that there is less than that, there is none.
    leaks = [found.leak_hz[0] + found.leak_hz_per_lux[0] * lux for lux in LUX]
    expected = [max(0.0, each.on_hz[0] - leak) for each, leak in zip(rates, leaks, strict=True)]
    assert noise.on_hz == pytest.approx(expected, rel=1e-4)
    assert (errors_off(found) < 3.5).all(), found
    errors = [getattr(found, name)[1] for name in ("on", "off", "photons_per_lux", "dark_photons", "look_s")]
    assert (np.array(errors) < (0.01, 0.01, 0.2, 0.1, 1e-4)).all(), found
    assert found.leak_hz[1] < 0.4 and found.leak_hz_per_lux[1] < 0.002
    assert found.misfit < 1.5


@pytest.mark.slow
def test_errors_are_as_large_as_they_say():
    found = [fit_uniform(recorded(seed)) for seed in range(30)]
    off = np.array([errors_off(each) for each in found if each.on])
    # In a few recordings other thresholds explain the rates as well, and none is told.
    assert len(off) >= 24 and off.max() < 6
    inside = (off < 2).mean(axis=0)
    # 95 of 100; of 30, 24 and more in all but one of ten thousand.
    assert (inside >= 0.8).all(), inside
    assert (np.median(off, axis=0) > 0.3).all()  # nor much larger, of any number


@pytest.mark.slow
def test_thresholds_are_not_told_where_others_explain_the_rates_as_well():
    """Here .065 and .2 do: so few events fell in the bright."""
    found = fit_uniform(recorded(16))
    assert found.on is found.off is found.photons_per_lux is None
    assert found.misfit < 1


@pytest.mark.slow
def test_errors_are_those_of_the_fit_where_rates_are_off_by_more_than_they_say():
    rates = recorded(3)
    sure = [Rates(each.lux, *((hz, error / 4) for hz, error in (each.on_hz, each.off_hz))) for each in rates]
    assert fit_uniform(sure).on[1] > 0.5 * fit_uniform(rates).on[1]


def test_noise_of_another_kind_tells_no_thresholds():
    """Rates that do not fall with light are of no photons."""
    rates = [Rates(lux, (1.0 + 0.1 * k, 0.002), (1.0 + 0.3 * k, 0.002)) for k, lux in enumerate(LUX)]
    found = fit_uniform(rates)
    assert found.on is None and found.photons_per_lux is None and found.misfit > 25


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.01, 30.0])
def test_rates_that_are_off_by_far_or_hardly_known_tell_no_thresholds(factor):
    rates = [
        Rates(each.lux, *((hz, error * factor) for hz, error in (each.on_hz, each.off_hz))) for each in recorded(3)
    ]
    assert fit_uniform(rates).on is None


def test_rates_are_of_the_pixels_that_are_quiet():
    """The third is hot; of the other two the error is that of their sum, 1, of which there are 4 pixel seconds."""
    counts = Counts(np.array([[1, 2, 300]]), np.array([[4, 4, 5]]), 2.0)
    found = rates_of(7.0, counts, np.array([[True, True, False]]))
    assert found.lux == 7 and found.off_hz == (2.0, 0.25) and found.on_hz == pytest.approx((0.75, 0.25))


def test_noise_that_is_alike_in_all_light_tells_nothing_but_leak(tmp_path):
    found = fit_uniform([Rates(lux, (0.018, 3e-4), (0.012, 3e-4)) for lux in LUX])
    assert found.on is found.off is found.photons_per_lux is found.dark_photons is found.look_s is None
    assert found.leak_hz[0] == pytest.approx(0.006, rel=0.3) and found.leak_hz_per_lux[0] < 1e-5
    (tmp_path / "a.toml").write_text(sensor_file("a", (4, 4), list(uniform_rows(found)), "still.npz", "davis346"))
    assert load_sensor(str(tmp_path / "a.toml")).threshold == load_sensor("davis346").threshold


def test_a_file_is_a_sensors_also_where_leak_explains_more_events_than_there_were(tmp_path):
    """Fits err, and bright light fires little else: no rate of noise falls below 0 for that."""
    leak, per_lux = 0.2, 0.01
    found = UniformFit(None, None, None, None, None, (leak, 0.1), (per_lux, 0.001), 1.0)
    rates = [Rates(lux, (0.3 + 0.008 * lux, 0.01), (0.1, 0.01)) for lux in LUX]
    (tmp_path / "mine.toml").write_text(noise_table(rates, found))
    noise = load_sensor(str(tmp_path / "mine.toml")).noise
    expected = [max(0.0, each.on_hz[0] - leak - per_lux * each.lux) for each in rates]
    assert 0 in expected and noise.on_hz == pytest.approx(tuple(expected), rel=1e-4)
    assert noise.off_hz == (0.1,) * len(LUX) and noise.lux == LUX


@pytest.mark.parametrize(("errors", "told"), [(1 / 1.9, False), (1 / 2.1, True)])
def test_leaks_are_told_from_two_standard_errors_on(errors, told):
    found = UniformFit(None, None, None, None, None, (0.2, 0.2 * errors), (0.01, 0.01 * errors), 1.0)
    rows = {name: number for name, number, _ in uniform_rows(found)}
    assert rows["leak.hz"] == (found.leak_hz if told else None)
    assert rows["leak.parasitic_hz_per_lux"] == (found.leak_hz_per_lux if told else None)


def test_few_lights_are_refused():
    with pytest.raises(InputError, match="take 5 illuminances at least, got 2"):
        fit_uniform([Rates(1.0, (1.0, 0.1), (1.0, 0.1)), Rates(2.0, (1.0, 0.1), (1.0, 0.1))] * 3)
    with pytest.raises(InputError, match="at 3 lux has no two events"):
        rates_of(3.0, Counts.of_size(2, 2), np.ones((2, 2), bool))


def run(monkeypatch, *words):
    monkeypatch.setattr(sys, "argv", ["clsim", *map(str, words)])
    with pytest.raises(SystemExit) as end:
        main()
    return end.value.code


@pytest.mark.slow
def test_the_command_makes_a_sensor_of_them(tmp_path, monkeypatch, capsys):
    names = []
    for light, fired in zip(LUX, looks(np.random.default_rng(3), LUX, 400, **TRUE), strict=True):
        parts = []
        for which, on in zip(fired, (True, False, True), strict=True):
            look, y, x = np.nonzero(which)
            part = empty_batch(len(look))
            part["t"], part["x"], part["y"], part["on"] = (look + 1) * 5000, x, y, on
            parts.append(part)
        events = np.sort(np.concatenate(parts), order=("t", "y", "x"))
        names.append(tmp_path / f"{light:g}.npz")
        with clsim.write(names[-1], *SHAPE[::-1]) as out:
            out.write(events, int(events["t"][-1]) + 1)
    file = tmp_path / "mine.toml"
    words = "sensor", "fit", *names, "--out", file, "--base", "davis346", "--lux"
    assert run(monkeypatch, *words, ",".join(map(str, LUX)), "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["threshold.off"][0] == pytest.approx(0.25, abs=4 * told["threshold.off"][1])
    assert told["look.photons_per_lux"][0] == pytest.approx(5, rel=0.1)
    mine = load_sensor(str(file))
    assert mine.threshold.on == pytest.approx(0.2, rel=0.05) and mine.noise.lux == LUX
    assert mine.noise.off_hz[0] == pytest.approx(65, rel=0.1) and mine.refractory == load_sensor("davis346").refractory
    assert mine.leak.parasitic_hz_per_lux == pytest.approx(0.01, rel=0.3)
    assert run(monkeypatch, *words, "1,2") == 2
    assert "--lux has 2 numbers, expected 6" in capsys.readouterr().err
    assert run(monkeypatch, *words, "1,-2") == 2
    assert "--lux must be positive numbers such as 0.5,2,10" in capsys.readouterr().err
    assert run(monkeypatch, *words, "1", "--check") == 2
    assert "give it without --lamp and --check" in capsys.readouterr().err


def test_a_threshold_squared_times_the_photons_is_sought():
    """And the ratio of the thresholds: on .2, off 1.5 times that, on² · photons 3."""
    assert uniform._numbers(np.log([0.2, 1.5, 3.0, 0.7, 0.01])) == pytest.approx((0.2, 0.3, 75.0, 0.7, 0.01))
