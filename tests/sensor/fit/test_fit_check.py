"""One half of a recording predicts the other: rates and flips, within errors of its own."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

import clsim
from clsim.sensor import SensorSettings
from clsim.sensor.fit.check import predicted
from clsim.sensor.fit.still import Counts
from clsim.sensor.lab import Lab
from clsim.sensor.pixel_stages import Defects, FrontEnd, Leak, Noise, Refractory, Threshold
from tests.sensor.fit.real import WALL, still_wall
from tests.sensor.fit.test_fit import events, run

WIDTH, HEIGHT = 60, 40
RATES = SensorSettings(
    threshold=Threshold(0.2, 0.2, mismatch=0.03),
    noise=Noise(0.3, 0.3, spread_decades=0.25),
    leak=Leak(0.4, 0.25),
    defects=Defects(hot_share=0.004, hot_hz=80.0, hot_spread_decades=0.3),
    refractory=Refractory(300.0),
)
SHOT = SensorSettings(front_end=FrontEnd(follower_hz=20.0), noise=Noise(shot=0.06), leak=Leak(0.2))


def quarters(settings, seconds, seed=0):
    lab = Lab(settings, WIDTH, HEIGHT, seed=seed)
    lab.to(0, 0.0), lab.to(1_000_000, 0.0)
    parts = []
    for number in range(4):
        part = Counts.of_size(WIDTH, HEIGHT)
        part.add([lab.to(1_000_000 + round(seconds * 1e6 * (number + 1) / 4), 0.0).events])
        part.seconds = seconds / 4
        parts.append(part)
    return parts


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settings", "seconds"), [(RATES, 20.0), pytest.param(SHOT, 4.0, marks=pytest.mark.slow)], ids=["rates", "shot"]
)
def test_a_half_predicts_the_other(settings, seconds):
    off = []
    for seed in range(6):
        _, rows = predicted(quarters(settings, seconds, seed))
        assert [row.name for row in rows] == ["ON [1/s]", "OFF [1/s]", "flips"]
        assert all(0 < row.expected[1] < 0.1 * row.expected[0] for row in rows)
        off += [row.errors_off for row in rows]
    assert np.mean(np.array(off) < 2) >= 0.8 and max(off) < 4
    flips = rows[2].found
    # Noise at random times flips half of the time at most, and leak never; what shot noise has crossed it crosses back.
    assert flips < 0.5 if settings is RATES else flips > 0.6


def test_a_half_that_is_another_is_noticed():
    parts = quarters(RATES, 20.0)[:2] + quarters(replace(RATES, noise=Noise(0.4, 0.4, spread_decades=0.25)), 20.0)[2:]
    for way in (1, -1):  # more of it as well as less
        fit, (_, off, _) = predicted(parts[::way])
        assert off.name == "OFF [1/s]" and off.errors_off > 4
        second = np.mean([part.off[~fit.hot] for part in parts[::way][2:]]) / 5.0
        assert fit.hot.any() and off.found == pytest.approx(second), "of pixels that are not hot"


@pytest.mark.parametrize("seconds", [(20.0, 5.0), (20.0, 80.0)])
def test_errors_are_those_of_counting_in_both_halves(seconds):
    """Events at random times, half of them flips: of n events the error is √n, and both halves have one."""
    draw, shape, rate = np.random.default_rng(0), (HEIGHT, WIDTH), 0.5
    parts = []
    for quarter_s in (seconds[0] / 2,) * 2 + (seconds[1] / 2,) * 2:
        on, off, alike, opposite = draw.poisson(rate * quarter_s, (4, *shape))
        parts.append(Counts(on, off, quarter_s, alike, opposite))
    fit, rows = predicted(parts)
    pixels = np.count_nonzero(~fit.hot)
    inverse_s = 1 / seconds[0] + 1 / seconds[1]
    for row in rows[:2]:
        assert row.expected[1] == pytest.approx(math.sqrt(rate / pixels * inverse_s), rel=0.05)
    assert rows[2].expected[1] == pytest.approx(math.sqrt(0.25 / (2 * rate * pixels) * inverse_s), rel=0.15)
    assert max(row.errors_off for row in rows) < 3.5


def test_pairs_are_of_a_pixel_and_go_on_from_batch_to_batch():
    counts = Counts.of_size(3, 1)
    first = np.concatenate([events([1, 4], 0, [True, False]), events([2], 1, True)])
    counts.add([np.sort(first, order="t"), events([5, 6, 7], 0, [False, True, True]), events([9], 1, True)])
    # Pixel 0: + − − + +, pixel 1: + +.
    np.testing.assert_array_equal(counts.next_opposite, [[2, 0, 0]])
    np.testing.assert_array_equal(counts.next_alike, [[2, 1, 0]])
    counts.add([events([1], 2, True), events([1], 0, False)])  # another recording
    assert counts.next_alike.sum() + counts.next_opposite.sum() == 5


def test_a_real_wall_predicts_its_other_half(tmp_path, monkeypatch, capsys):
    wall = still_wall()
    with clsim.write(tmp_path / "wall.npz", *WALL) as out:
        out.write(wall, int(wall["t"][-1]) + 1)
    words = "sensor", "fit", tmp_path / "wall.npz", "--out", tmp_path / "a.toml", "--check"
    assert run(monkeypatch, *words, "--json") == 0
    told = json.loads(capsys.readouterr().out)["check"]
    assert set(told) == {"ON [1/s]", "OFF [1/s]", "flips"}
    assert all(row["errors_off"] < 2 for row in told.values()), told
    assert told["flips"]["found"] > 0.6
    assert run(monkeypatch, *words[:3], *words[2:], "--json") == 0  # twice as long, it fires as often
    twice = json.loads(capsys.readouterr().out)["check"]
    assert twice["ON [1/s]"]["found"] == pytest.approx(told["ON [1/s]"]["found"], rel=0.3)
    assert run(monkeypatch, *words) == 0
    assert "second half, flips" in capsys.readouterr().out
