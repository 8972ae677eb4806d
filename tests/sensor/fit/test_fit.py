"""Recordings of clsim's own sensors are fitted back to what made them."""

import json
import math
import sys

import numpy as np
import pytest

import clsim
from clsim.cli import main
from clsim.errors import InputError
from clsim.events import empty_batch
from clsim.sensor import SensorSettings, load_sensor
from clsim.sensor.fit.fitted import fitted_rows, sensor_file
from clsim.sensor.fit.flicker import FlickerFit, fit_flicker
from clsim.sensor.fit.still import Counts, StillFit, fit_still
from clsim.sensor.lab import Lab
from clsim.sensor.pixel_stages import Defects, FrontEnd, Leak, Noise, Refractory, Threshold

WIDTH, HEIGHT = 80, 60
CONTRAST, LAMP_HZ = 0.6, 5.0
TRUE = SensorSettings(
    threshold=Threshold(0.2, 0.25, mismatch=0.03),
    noise=Noise(0.05, 0.05, spread_decades=0.25),
    leak=Leak(0.2, 0.25),
    defects=Defects(hot_share=0.004, hot_hz=80.0, hot_spread_decades=0.3, dead_share=0.01),
    refractory=Refractory(300.0),
)


def still_scene(settings, seconds, steps):
    lab = Lab(settings, WIDTH, HEIGHT)
    return [lab.to(round(1e6 * seconds * step / steps), 0.0).events for step in range(steps + 1)]


def lamp(settings, seconds, parts=160):
    """Return what fires under a lamp whose sine is made of so many lines a period."""
    lab = Lab(settings, WIDTH, HEIGHT, lux=1000.0)
    times_us = [round(1e6 * step / (LAMP_HZ * parts)) for step in range(round(seconds * LAMP_HZ * parts) + 1)]
    levels = [math.log1p(CONTRAST * math.sin(2 * math.pi * LAMP_HZ * t * 1e-6 + 1.0)) for t in times_us]
    return [lab.to(time, level).events for time, level in zip(times_us, levels, strict=True)]


def counted(batches):
    counts = Counts.of_size(WIDTH, HEIGHT)
    counts.add(batches)
    return counts


@pytest.fixture(scope="module")
def recorded():
    return still_scene(TRUE, 100.0, 20), lamp(TRUE, 1.2)


@pytest.fixture(scope="module")
def still(recorded):
    return fit_still(counted(recorded[0]))


@pytest.fixture(scope="module")
def flicker(recorded, still):
    return fit_flicker(recorded[1], WIDTH, HEIGHT, CONTRAST, ~still.hot)


def near(found, true, *, rel=0.0):
    """Whether a number is the true one, within 4 of its standard errors, and the error no excuse."""
    value, error = found
    return abs(value - true) <= 4 * error + rel * true and 0 < error < 0.2 * true


@pytest.mark.slow
def test_rates_and_their_spread_are_found(still):
    assert near(still.noise_hz, 0.05, rel=0.02) and near(still.noise_decades, 0.25, rel=0.03)
    assert near(still.leak_hz, 0.2, rel=0.03)
    # Thresholds that differ by 0.03 of 0.2 add to the spread of leaks.
    assert near(still.leak_decades, math.hypot(0.25, 0.15 / math.log(10)), rel=0.03)


def test_hot_pixels_are_found(still):
    share, error = still.hot_share
    assert error == pytest.approx(math.sqrt(share * (1 - share) / (WIDTH * HEIGHT)))
    assert share == pytest.approx(0.004 * 0.99, abs=4 * math.sqrt(0.004 / (WIDTH * HEIGHT)))
    # Some twenty pixels tell.
    assert abs(still.hot_hz[0] - 80) < 4 * still.hot_hz[1] < 80
    assert abs(still.hot_decades[0] - 0.3) < 4 * still.hot_decades[1] < 0.3


def test_hot_pixels_are_found_in_half_a_second():
    # Pixels fire once in ten seconds, and 20 of them 200 times a second: most never fire.
    generator, shape = np.random.default_rng(2), (100, 200)
    rates = 0.1 * 10 ** generator.normal(0, 0.25, shape)
    rates[::5, ::200] = 200.0
    found = fit_still(Counts(*generator.poisson(0.3 * rates, (2, *shape)), 0.6))
    np.testing.assert_array_equal(found.hot, rates == 200)
    assert found.noise_hz[0] == pytest.approx(0.05, rel=0.3) and found.hot_hz[0] == pytest.approx(200, rel=0.1)


def test_errors_of_hot_pixels_are_what_other_pixels_of_their_kind_would_make_of_it():
    """Drawn again and again from the same hot pixels, median and spread differ by as much as they are said to."""
    generator = np.random.default_rng(4)
    on, off = generator.poisson(0.5, (2, 60, 60))
    hot = generator.choice(on.size, 200, replace=False)
    on.ravel()[hot] += generator.poisson(2000 * 10 ** generator.normal(0, 0.2, len(hot)))
    found = fit_still(Counts(on, off, 10.0))
    assert found.hot.sum() == len(hot)
    rates = (on + off)[found.hot] / 10.0
    drawn = generator.choice(rates, (1000, len(hot)))
    assert found.hot_hz == pytest.approx((np.median(rates), np.median(drawn, axis=1).std()), rel=0.3)
    spreads = np.log10(drawn).std(axis=1, ddof=1)
    assert found.hot_decades == pytest.approx((np.log10(rates).std(ddof=1), spreads.std()), rel=0.3)


@pytest.mark.parametrize("hot", [2, 3])
def test_a_rate_of_hot_pixels_takes_three_of_them(hot):
    on, off = np.random.default_rng(4).poisson(0.5, (2, 40, 40))
    on[0, :hot] += (1000, 2000, 3000)[:hot]
    found = fit_still(Counts(on, off, 10.0))
    assert found.hot.sum() == hot
    assert found.hot_hz is None if hot < 3 else found.hot_hz[0] == pytest.approx(200, rel=0.01)


def test_a_leak_is_found_in_less_than_its_period():
    # 0.1 Hz over 0.6 s: one pixel in seventeen fires once.
    settings = SensorSettings(noise=Noise(0.005, 0.005), leak=Leak(0.1, 0.25))
    counts = Counts.of_size(240, 180)
    lab = Lab(settings, 240, 180)
    counts.add([lab.to(t, 0.0).events for t in (0, 600_000)])
    found = fit_still(counts)
    assert found.leak_hz[0] == pytest.approx(0.1, rel=0.08) and near(found.noise_hz, 0.005, rel=0.05)
    # Every pixel fires once or not at all: how rates spread is taken to be as usual, and its error is as large.
    assert found.leak_decades == pytest.approx((0.25, 0.25))


@pytest.mark.slow
def test_a_leak_is_found_under_noise_that_takes_it_back():
    """Noise of either polarity, twice a second, sets pixels back that leak in one: few get as far."""
    draw, seconds = np.random.default_rng(5), 60
    waits = draw.exponential(0.5, (1000, 240))
    ends = waits.cumsum(axis=1)
    noise, ups = ends < seconds, draw.random(waits.shape) < 0.5
    rests = seconds - np.where(noise, ends, 0.0).max(axis=1)
    leaks = (np.floor(waits) * noise).sum(axis=1) + np.floor(rests)
    on, off = leaks + (noise & ups).sum(axis=1), (noise & ~ups).sum(axis=1)
    found = fit_still(Counts(on.astype(int)[:, None], off[:, None], float(seconds)))
    assert found.leak_hz[0] == pytest.approx(1.0, rel=0.03) and found.noise_hz[0] == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize("periods", [1.05, 2.0])
def test_a_spread_of_leaks_is_found_in_periods_of_any_number(periods):
    generator, shape = np.random.default_rng(3), (150, 200)
    ended = periods * 10 ** generator.normal(0, 0.05, shape) + generator.uniform(size=shape)
    found = fit_still(Counts(np.floor(ended).astype(int), np.zeros(shape, int), 10.0))
    assert near(found.leak_hz, periods / 10, rel=0.005) and near(found.leak_decades, 0.05, rel=0.01)


def test_thresholds_and_rest_are_found_under_a_lamp(flicker, still):
    found = flicker
    assert found.frequency_hz == pytest.approx(LAMP_HZ, rel=1e-4)
    assert near(found.on, 0.2, rel=0.005) and near(found.off, 0.25, rel=0.005)
    assert near(found.mismatch, 0.03, rel=0.02)
    assert found.rest_us[0] == pytest.approx(300, rel=0.02)
    assert found.silent_share[0] == pytest.approx(0.01, abs=4 * math.sqrt(0.01 / (WIDTH * HEIGHT)))
    # So many pixels tell, each once of either threshold; a median errs by √(π/2) times as much as a mean.
    asked, silent = np.count_nonzero(~still.hot), found.silent_share[0]
    errors = (*np.divide((found.on[1], found.off[1]), math.sqrt(math.pi / 2)), 2 * found.mismatch[1])
    assert errors == pytest.approx((0.03 / math.sqrt((1 - silent) * asked),) * 3, rel=0.05)
    assert found.silent_share[1] == pytest.approx(math.sqrt(silent * (1 - silent) / asked))


def test_a_fit_does_not_hang_on_how_a_recording_is_cut(recorded, flicker, still):
    """Nor on when it begins: a camera may have been on for an hour."""
    whole = np.concatenate(recorded[1])
    later = whole.copy()
    later["t"] += 3_600_000_000
    for pieces in ([whole], np.array_split(whole, 7), [later]):
        found = fit_flicker(pieces, WIDTH, HEIGHT, CONTRAST, ~still.hot)
        for name in ("on", "off", "rest_us", "mismatch"):
            assert getattr(found, name) == pytest.approx(getattr(flicker, name), rel=1e-6)


def test_what_is_fitted_makes_the_file_of_a_sensor(still, flicker, tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(sensor_file("mine", (WIDTH, HEIGHT), list(fitted_rows(still, flicker)), 'a "b".raw', "davis346"))
    mine = load_sensor(str(file))
    assert mine.name == "mine" and mine.optics.width == WIDTH and mine.front_end == load_sensor("davis346").front_end
    assert mine.threshold.off == pytest.approx(0.25, rel=0.01) and mine.leak.hz == pytest.approx(0.2, rel=0.05)
    assert mine.defects.dead_share == pytest.approx(flicker.silent_share[0], rel=1e-4)
    # The spread that thresholds add, of 0.03 in 0.2, is taken away again.
    own = math.sqrt(still.leak_decades[0] ** 2 - (0.15 / math.log(10)) ** 2)
    assert mine.leak.spread_decades == pytest.approx(own, rel=0.005) == pytest.approx(0.25, abs=0.015)
    assert mine.sources["leak.hz"].startswith("± ") and mine.sources["leak.hz"].endswith('still scene; a "b".raw')


@pytest.mark.parametrize(("errors", "rest_us"), [(1 / 2.9, 300.0), (1 / 3.1, 300.0), (1 / 3.1, 19.0)])
def test_a_leak_and_a_rest_are_told_from_three_standard_errors_on(errors, rest_us):
    """And a rest of less than 20 µs may be a lamp's that is no exact sine."""
    noise, none = (0.05, 0.001), np.zeros((4, 4), bool)
    still = StillFit(noise, (0.2, 0.01), (0.2, 0.2 * errors), (0.3, 0.01), none, None, None)
    lamp = FlickerFit((0.2, 0.01), (0.25, 0.01), (0.03, 0.001), (rest_us, rest_us * errors), (0.0, 0.0), 5.0)
    rows = {name: number for name, number, _ in fitted_rows(still, lamp)}
    assert rows["noise.on_hz"] == rows["noise.off_hz"] == noise
    assert rows["leak.hz"] == (still.leak_hz if errors < 1 / 3 else None)
    assert rows["refractory.us"] == (lamp.rest_us if errors < 1 / 3 and rest_us > 20 else None)
    assert rows["defects.hot_share"] is None and rows["defects.dead_share"] is None


def test_a_sensor_without_leak_and_defects_has_none():
    quiet = SensorSettings(noise=Noise(0.5, 0.5, spread_decades=0.1), threshold=TRUE.threshold)
    found = fit_still(counted(still_scene(quiet, 20.0, 2)))
    rows = {name: number for name, number, _ in fitted_rows(found, None)}
    assert rows["leak.hz"] is None and rows["defects.hot_share"] is None and rows["defects.hot_hz"] is None
    assert near(rows["noise.on_hz"], 0.5, rel=0.02)


def test_recordings_add_up(recorded):
    batches = recorded[0]
    twice = counted(batches)
    twice.add(batches)
    once = counted(batches)
    assert twice.seconds == pytest.approx(2 * once.seconds)
    np.testing.assert_array_equal(twice.on, 2 * once.on)
    assert once.on.sum() + once.off.sum() == sum(map(len, batches))


def events(times_us, x=0, on=True):
    batch = empty_batch(len(times_us))
    batch["t"], batch["x"], batch["y"], batch["on"] = times_us, x, 0, on
    return batch


def test_what_cannot_be_fitted_is_told():
    with pytest.raises(InputError, match="needs 100 events of a still scene at least, got 3; record longer"):
        fit_still(counted([events([1, 2, 3])]))
    with pytest.raises(InputError, match="`resolution` is 80x60, but there is an event at x 80, y 0"):
        counted([events([1], x=80)])
    with pytest.raises(InputError, match=r"`contrast` must lie between 0 and 1, got 1\.5"):
        fit_flicker([], 2, 2, 1.5)
    with pytest.raises(InputError, match="there is none in this one: it is too short"):
        fit_flicker([], 2, 2, 0.5)
    with pytest.raises(InputError, match=r"expected 1000: record longer"):
        fit_flicker([events(np.arange(0, 10**6, 5000))], 1, 1, 0.5)
    # Pixels that fire once in each period, for the lamp's contrast is small, tell nothing of a threshold.
    x, period = np.divmod(np.arange(40 * 60), 60)
    once = events(2e5 * (period + np.random.default_rng(0).normal(1, 0.1, len(x))), x)
    with pytest.raises(InputError, match="found 0 pairs of events at 5 Hz, expected 1000"):
        fit_flicker([np.sort(once, order="t")], 40, 1, 0.5)


def run(monkeypatch, *words):
    monkeypatch.setattr(sys, "argv", ["clsim", *map(str, words)])
    with pytest.raises(SystemExit) as end:
        main()
    return end.value.code


def test_the_command_fits_files(recorded, tmp_path, monkeypatch, capsys):
    names = tmp_path / "still.npz", tmp_path / "lamp.npz"
    for name, batches in zip(names, recorded, strict=True):
        with clsim.write(name, WIDTH, HEIGHT) as out:
            for batch in batches:
                if len(batch):
                    out.write(batch, int(batch["t"][-1]) + 1)
    file = tmp_path / "mine.toml"
    words = "sensor", "fit", names[0], "--out", file
    assert run(monkeypatch, *words, "--lamp", names[1], "--contrast", CONTRAST, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["threshold.on"][0] == pytest.approx(0.2, rel=0.01)
    assert load_sensor(str(file)).threshold.mismatch == pytest.approx(told["threshold.mismatch"][0], rel=1e-3)
    before = file.read_text()
    assert run(monkeypatch, *words, "--lamp", names[1]) == 2
    assert "--lamp and --contrast belong together" in capsys.readouterr().err
    assert run(monkeypatch, *words, "--resolution", "4x4") == 2
    assert "--resolution is 4x4, but there is an event" in capsys.readouterr().err
    assert file.read_text() == before and [each.name for each in tmp_path.glob(".*")] == []


def test_a_base_that_is_not_there_is_told(recorded, tmp_path, monkeypatch, capsys):
    words = "sensor", "fit", "no.npz", "--out", tmp_path / "a.toml", "--base", "davis3"
    assert run(monkeypatch, *words) == 2
    assert capsys.readouterr().err == "clsim: --base: there is no sensor 'davis3'; did you mean davis346?\n"


def test_a_fit_is_called_as_its_file_and_finds_its_base_from_anywhere(recorded, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fits").mkdir()
    (tmp_path / "base.toml").write_text("[refractory]\nus = 123.0\n")
    with clsim.write("still.npz", WIDTH, HEIGHT) as out:
        for batch in recorded[0]:
            out.write(batch, int(batch["t"][-1]) + 1 if len(batch) else 0)
    assert run(monkeypatch, "sensor", "fit", "still.npz", "--out", "fits/own.toml", "--base", "base.toml") == 0
    monkeypatch.chdir("/")
    found = load_sensor(str(tmp_path / "fits" / "own.toml"))
    assert (found.name, found.refractory.us) == ("own", 123.0)


def test_what_several_recordings_tell_counts_together(recorded, tmp_path, monkeypatch, capsys):
    """Numbers and their errors are those of one recording as long as both."""
    batches, told = [batch for batch in recorded[0] if len(batch)], []
    for names, cuts in ((["whole"], [0, len(batches)]), (["first", "second"], [0, len(batches) // 2, len(batches)])):
        files = [tmp_path / f"{name}.npz" for name in names]
        for file, begin, end in zip(files, cuts, cuts[1:], strict=False):
            with clsim.write(file, WIDTH, HEIGHT) as out:
                for batch in batches[begin:end]:
                    out.write(batch, int(batch["t"][-1]) + 1)
        assert run(monkeypatch, "sensor", "fit", *files, "--out", tmp_path / "a.toml", "--json") == 0
        told.append(json.loads(capsys.readouterr().out))
    whole, parts = told
    assert whole.keys() == parts.keys() and len(whole) >= 5
    for name, number in whole.items():
        assert parts[name] == pytest.approx(number, rel=0.05), name


def test_files_that_would_be_lost_are_not_written_over(tmp_path, monkeypatch, capsys):
    still, mine = tmp_path / "still.txt", tmp_path / "mine.toml"
    still.write_text("1 2 3 1\n")
    mine.write_text("[threshold]\non = 0.3\n")
    for words, said in (
        (("fit", still, "--out", still), "the ending is wrong; expected NAME.toml"),
        (("fit", still, "--out", mine, "--base", mine), "is the file that --base names; choose another name"),
        (("plot", mine, "--out", still), "the ending is wrong; expected NAME.png"),
    ):
        assert run(monkeypatch, "sensor", *words) == 2 and said in capsys.readouterr().err
    assert still.read_text() == "1 2 3 1\n" and mine.read_text() == "[threshold]\non = 0.3\n"


def test_a_lamp_that_does_not_flicker_is_told(recorded, tmp_path, monkeypatch, capsys):
    name = tmp_path / "still.npz"
    with clsim.write(name, WIDTH, HEIGHT) as out:
        for batch in recorded[0][:5]:
            out.write(batch, int(batch["t"][-1]) + 1 if len(batch) else 0)
    words = "sensor", "fit", name, "--out", tmp_path / "a.toml", "--lamp", name, "--contrast", CONTRAST
    assert run(monkeypatch, *words) == 2
    assert "still.npz: is no recording of a lamp whose light is a sine" in capsys.readouterr().err
    assert not (tmp_path / "a.toml").exists()


@pytest.mark.slow
def test_fits_do_not_hang_on_a_front_end(still):
    davis = SensorSettings(
        threshold=Threshold(0.2, 0.2, mismatch=0.03),
        front_end=FrontEnd(dark_lux=0.1, receptor_hz_per_lux=300.0, follower_hz=3000.0),
        noise=Noise(0.01, 0.01, spread_decades=0.25),
        leak=Leak(0.08, 0.25),
        defects=TRUE.defects,
        refractory=Refractory(250.0),
    )
    found = fit_flicker(lamp(davis, 1.0, 400), WIDTH, HEIGHT, CONTRAST, ~still.hot)
    assert found.on[0] == pytest.approx(0.2, rel=0.01) and found.off[0] == pytest.approx(0.2, rel=0.01)
    # Of a float64 pixel the fit finds 252.0 under these 400 lines a period, 251.4 under a true sine, and 250.0 where
    # there is no dark current either. Of 100 lines it finds 260.8: chords of a sine lie inside it.
    assert found.rest_us[0] == pytest.approx(252, rel=0.01)


def test_what_was_looked_for_and_not_seen_is_not_the_bases(tmp_path):
    clean = SensorSettings(noise=Noise(0.5, 0.5, spread_decades=0.25))
    rows = list(fitted_rows(fit_still(counted(still_scene(clean, 40.0, 8))), None))
    assert {name for name, number, _ in rows if number is None} >= {"leak.hz", "defects.hot_share"}
    file = tmp_path / "mine.toml"
    file.write_text(sensor_file("mine", (WIDTH, HEIGHT), rows, "still.npz", "davis346"))
    found, base = load_sensor(str(file)), load_sensor("davis346")
    assert found.leak.hz == 0 < base.leak.hz and found.defects.hot_share == 0
    assert found.threshold == base.threshold and found.refractory == base.refractory
    assert found.sources["leak.hz"] == "none seen; still scene; still.npz"
    file.write_text(sensor_file("mine", (WIDTH, HEIGHT), rows, "still.npz"))
    assert "leak" not in file.read_text()
