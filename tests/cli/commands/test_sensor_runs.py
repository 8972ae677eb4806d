"""A run with a camera's sensor: live, from frames, step by step and again are the same bits; wrong files are told."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import clsim as library
from clsim.errors import InputError
from clsim.events import CAUSES
from clsim.live.options import LiveOptions
from clsim.live.sensors import RecordedSensor
from clsim.live.stages import plan_stages
from clsim.sensor import SensorSettings, load_sensor, preset_names
from clsim.sensor.pixel_stages import FrontEnd, Leak, Noise, Threshold

SENSOR = """
[threshold]
on = 0.15
off = 0.25
mismatch = 0.02
[noise]
on_hz = 5.0
off_hz = 5.0
[leak]
hz = 5.0
[refractory]
us = 200.0
[delay]
jitter_us = 20.0
[readout]
event_us = 0.5
most_wait_us = 100.0
"""
SMALL = ("two-boxes", "--resolution", "32x24", "--fps", "60", "--frame-count", "7", "--seed", "3")


def test_all_ways_to_run_a_sensor_give_the_same_bits(clsim: Callable[..., object], tmp_path: Path) -> None:
    sensor = tmp_path / "mine.toml"
    sensor.write_text(SENSOR)
    assert clsim("live", *SMALL, "--sensor", sensor, "--out", tmp_path / "live.txt").status == 0
    expected = (tmp_path / "live.txt").read_bytes()
    assert clsim("live", *SMALL, "--threshold", "0.15,0.25", "--out", tmp_path / "ideal.txt").status == 0
    ideal = (tmp_path / "ideal.txt").read_bytes()
    assert len(expected) > 3000 and expected != ideal

    # The sensor steers where light is sampled, so frames are rendered for it, and tell of it.
    assert clsim("render", *SMALL, "--sensor", sensor, "--out", tmp_path / "frames").status == 0
    assert clsim("detect", tmp_path / "frames", "--out", tmp_path / "detected.txt").status == 0
    assert (tmp_path / "detected.txt").read_bytes() == expected
    command = ("detect", tmp_path / "frames", "--threshold", "0.15,0.25", "--out", tmp_path / "other.txt")
    assert clsim(*command, "--sensor", "ideal").status == 0
    assert 0 < (tmp_path / "other.txt").stat().st_size < len(expected)

    with library.Simulator("two-boxes", resolution=(32, 24), fps=60.0, seed=3, sensor=str(sensor)) as run:
        begun = run.step(20_000)
        state = run.snapshot()
        later = np.concatenate([run.step(60_000), run.step(100_000)])
        run.restore(state)
        np.testing.assert_array_equal(run.step(100_000), later)
    events = np.concatenate([begun, later])
    lines = [f"{e['t']} {e['x']} {e['y']} {int(e['on'])}" for e in events]
    written = [line for line in expected.decode().splitlines() if line[:1].isdigit()]
    assert [line.replace(",", " ") for line in written][-len(lines) :] == lines

    # The sidecar holds the sensor itself: its file may be gone.
    sensor.unlink()
    told = json.loads((tmp_path / "live.txt.json").read_text())
    assert told["thresholds"] == {"on": 0.15, "off": 0.25} and told["options"]["sensor"]["name"] == "mine"
    assert clsim("live", "--config", tmp_path / "live.txt.json", "--out", tmp_path / "again.txt").status == 0
    assert (tmp_path / "again.txt").read_bytes() == expected


def test_causes_stand_beside_events(clsim: Callable[..., object], tmp_path: Path) -> None:
    import h5py
    import pyarrow.parquet

    sensor = tmp_path / "mine.toml"
    sensor.write_text(SENSOR)
    outs = [tmp_path / f"events.{kind}" for kind in ("h5", "parquet", "npz")]
    command = [*SMALL, "--sensor", sensor, "--labels", *(word for out in outs for word in ("--out", out))]
    outcome = clsim("live", *command)
    assert outcome.status == 0, outcome.stderr
    with library.Simulator("two-boxes", resolution=(32, 24), fps=60.0, seed=3, sensor=str(sensor)) as run:
        events = run.step(100_000)
        causes = run.causes
        assert len(causes) == len(events) and set(causes) == {0, 1, 2}
        run.step(100_000)
        assert len(run.causes) == 0
    with h5py.File(outs[0]) as file:
        np.testing.assert_array_equal(file["events/cause"][:], causes)
        assert list(file["events/cause"].attrs["causes"]) == list(CAUSES)
    table = pyarrow.parquet.read_table(outs[1])
    np.testing.assert_array_equal(table["cause"].to_numpy(), causes)
    for out in outs:
        with library.open(str(out)) as source:
            np.testing.assert_array_equal(source.read(), events)
    outcome = clsim("live", *SMALL, "--labels", "--out", tmp_path / "events.raw")
    assert outcome.status == 2 and "--labels go into HDF5 and Parquet, but no output is one" in outcome.stderr


def test_a_preset_sets_the_picture_unless_a_resolution_is_given() -> None:
    scene = plan_stages(LiveOptions("two-boxes")).world.camera
    camera = plan_stages(LiveOptions("two-boxes", sensor=load_sensor("davis240"))).world.camera
    assert (camera.width, camera.height) == (240, 180)
    camera = plan_stages(LiveOptions("two-boxes", sensor=load_sensor("davis240"), resolution=(64, 48))).world.camera
    assert (camera.width, camera.height, camera.fov_deg) == (64, 48, scene.fov_deg)


def test_what_shot_noise_costs_is_told_before_a_run() -> None:
    shot = SensorSettings("mine", front_end=FrontEnd(follower_hz=3000.0), noise=Noise(shot=0.05))
    warnings = plan_stages(LiveOptions("two-boxes", sensor=shot)).warnings
    assert any("`sensor` mine draws shot noise, which takes at least 56 s of CPU" in each for each in warnings)
    assert not any("shot noise" in each for each in plan_stages(LiveOptions("two-boxes", sensor="davis346")).warnings)


def test_a_sensor_that_follows_brightness_gets_all_of_it() -> None:
    follows = {"front_end": FrontEnd(follower_hz=100.0)}, {"noise": Noise(1.0)}
    does_not = {"leak": Leak(1.0)}, {"threshold": Threshold(0.3, 0.3)}
    for expected, cases in (("wlr-esim", follows), (None, does_not)):
        for stages in cases:
            seen_by = RecordedSensor(SensorSettings(**stages))  # type: ignore[arg-type]
            assert seen_by.detector({}, "esim-ad").get("method") == expected
            assert seen_by.detector({}, "esim").get("method") is None
            assert seen_by.detector({"method": "esim-ad"}, "esim-ad")["method"] == "esim-ad"


def test_a_threshold_wins_over_the_sensors_and_that_over_the_scenes() -> None:
    sensor = SensorSettings(threshold={"on": 0.3, "mismatch": 0.01})  # type: ignore[arg-type]
    for given, expected in ((None, (0.3, 0.2)), ((0.1, 0.1), (0.1, 0.1))):
        detector = plan_stages(LiveOptions("two-boxes", sensor=sensor, threshold=given)).detector
        assert (detector.threshold_on, detector.threshold_off) == expected


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[threshold]\nonn = 0.1", "threshold: there is no option 'onn'; did you mean 'on'"),
        ("[thresholds]", "there is no option 'thresholds'; did you mean 'threshold'"),
        ("[threshold]\nmismatch = -1", "threshold: `mismatch` must not be negative, got -1"),
        ("threshold = 3", "`threshold` must be Threshold or its fields by name, got 3"),
        ("[noise]\nlux = [1.0, 2.0]\non_hz = [1.0, 2.0, 3.0]", "noise: `on_hz` has 3 numbers, expected 2"),
        ("[noise]\nshot = 0.1", "noise: `shot` needs a bandwidth"),
        ("[readout]\nstamp_us = 0", "readout: `stamp_us` must be positive, got 0"),
        ("[optics]\nwidth = 10", "optics: `width` and `height` belong together"),
        ("x = [", "is no TOML"),
        ("base = 'me.toml'", "is its own `base`"),
        ("base = 3", "`base` must be a preset's name or a file, got 3"),
    ],
)
def test_what_is_wrong_in_a_file_is_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "me.toml"
    path.write_text(text)
    with pytest.raises(InputError) as error:
        load_sensor(str(path))
    assert sentence in str(error.value) and str(path) in str(error.value) and "\n" not in str(error.value)


def test_a_file_may_change_some_numbers_of_another(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text("base = 'davis346'\n[leak]\nhz = 7.0\n")
    (tmp_path / "b.toml").write_text("base = 'a.toml'\n[leak]\nspread_decades = 0.5\n")
    found, base = load_sensor(str(tmp_path / "b.toml")), load_sensor("davis346")
    assert (found.name, found.leak.hz, found.leak.spread_decades) == ("b", 7.0, 0.5)
    assert found.threshold == base.threshold and found.optics == base.optics


def test_a_name_that_is_none_is_told(clsim: Callable[..., object]) -> None:
    outcome = clsim("live", "two-boxes", "--sensor", "davis364")
    assert outcome.status == 2
    assert "--sensor: there is no sensor 'davis364'; did you mean davis346?" in outcome.stderr
    assert "ideal" in preset_names() and load_sensor("ideal").is_ideal


def test_a_rule_for_the_ideal_pixel_is_refused_of_another(clsim: Callable[..., object]) -> None:
    outcome = clsim("live", "two-boxes", "--sensor", "davis346", "--quality", "published")
    assert outcome.status == 2
    assert "--event-rule frame is for the ideal sensor; --sensor davis346 needs interpolated" in outcome.stderr


def test_a_plot_is_of_the_seed_that_is_asked_for(
    clsim: Callable[..., object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plots = pytest.importorskip("clsim.cli.plots.sensor_plot")
    drawn = []
    monkeypatch.setattr(plots, "plot_sensors", lambda *given: drawn.append(given))
    assert clsim("sensor", "plot", "davis346", "dvs128", "--seed", "5", "--out", tmp_path / "a.png").status == 0
    assert drawn == [([load_sensor("davis346"), load_sensor("dvs128")], tmp_path / "a.png", 5)]
