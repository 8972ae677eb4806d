"""``clsim detect`` on video and pictures."""

import json

import numpy as np
import pytest
from PIL import Image

from clsim.events.batch import gather
from clsim.events.files import open_source
from clsim.live.footage import events_from
from tests.footage.clips import HEIGHT, WIDTH, encode, grating, write_clip

_TIMES_MS = [0, 33, 50, 200, 210]


@pytest.fixture
def clip(tmp_path):
    """A clip of a variable rate, whose grating moves by up to 6 pixels a frame."""
    frames = [np.round(encode(grating(t / 1000), "bt709") * 65535).astype(np.uint16) for t in _TIMES_MS]
    return write_clip(tmp_path / "clip.mkv", frames, _TIMES_MS, pixels="gray16le")


def test_a_video_becomes_events(clsim, clip, tmp_path):
    out = tmp_path / "events.csv"
    outcome = clsim("detect", clip, "--out", out, "--json")
    assert outcome.status == 0, outcome.stderr
    assert "taken as bt709; see --transfer" in outcome.stderr
    assert "pixels from one frame to the next" in outcome.stderr
    summary = json.loads(outcome.stdout)
    assert (summary["frames"], summary["simulated_s"]) == (5, 0.21)
    assert summary["motion"]["fast_pairs"] >= 1
    with open_source(out) as events:
        np.testing.assert_array_equal(events.read(), gather(events_from(str(clip))))


def test_a_video_is_detected_by_a_file_that_is_written_by_hand(clsim, clip, tmp_path):
    """In TOML, or in JSON; there a sidecar has the detector's options beside those of the run."""
    toml, plain, wrong = tmp_path / "run.toml", tmp_path / "run.json", tmp_path / "wrong.toml"
    toml.write_text(f'frames = "{clip}"\n[detector]\nthreshold_on = 0.5\n')
    plain.write_text(json.dumps({"frames": str(clip), "detector": {"threshold_on": 0.5}}))
    wrong.write_text(f'frames = "{clip}"\ndetector = 5\n')
    expected = gather(events_from(clip, threshold_on=0.5))
    for config in (toml, plain):
        out = tmp_path / f"{config.name}.csv"
        outcome = clsim("detect", "--config", config, "--out", out)
        assert outcome.status == 0, outcome.stderr
        with open_source(out) as events:
            np.testing.assert_array_equal(events.read(), expected)
    outcome = clsim("detect", "--config", wrong, "--out", tmp_path / "x.csv")
    assert outcome.status == 2
    assert outcome.stderr == f"clsim: --config {wrong}: detector must be options by name, got 5\n"


def test_a_slow_video_is_not_warned_about(clsim, tmp_path):
    frames = [np.round(encode(grating(k / 200), "bt709") * 65535).astype(np.uint16) for k in range(5)]
    clip = write_clip(tmp_path / "clip.mkv", frames, [5 * k for k in range(5)], pixels="gray16le", trc=1)
    outcome = clsim("detect", clip, "--out", tmp_path / "events.csv", "--json")
    told = outcome.stderr.splitlines()
    assert (outcome.status, len(told)) == (0, 1) and "no pixel's brightness changed by the threshold" in told[0]
    about = json.loads(clsim("info", clip, "--json").stdout)["footage"]
    assert (about["resolution"], about["transfer"], about["steps"]) == ([WIDTH, HEIGHT], "bt709", 65535)
    assert about["fps"] == 30.0, "as its header tells"
    motion = json.loads(outcome.stdout)["motion"]
    # 40 px/s at 200 frames a second.
    assert motion["largest_px"] == pytest.approx(0.2, abs=0.03)


def test_pictures_with_a_file_of_times(clsim, tmp_path):
    frames = [np.round(encode(grating(t / 1000), "srgb") * 255).astype(np.uint8) for t in _TIMES_MS]
    for k, frame in enumerate(frames):
        Image.fromarray(frame).save(tmp_path / f"{k}.png")
    times = tmp_path / "times.txt"
    times.write_text("".join(f"{t / 1000:.6f} {k}.png\n" for k, t in enumerate(_TIMES_MS)))
    out = tmp_path / "events.csv"
    outcome = clsim("detect", tmp_path, "--times", times, "--out", out)
    assert outcome.status == 0, outcome.stderr
    with open_source(out) as events:
        found = events.read()
    np.testing.assert_array_equal(found, gather(events_from(frames, [1000 * t for t in _TIMES_MS])))
    assert found["x"].max() == WIDTH - 1
    assert found["y"].max() == HEIGHT - 1
    about = json.loads((tmp_path / "events.csv.json").read_text())
    assert (about["options"]["transfer"], about["detector"]["method"]) == ("srgb", "esim")
    assert about["detector"]["floor"] > 1e-3


def test_a_recording_that_begins_late_is_no_longer_for_that(clsim, tmp_path):
    for k, t in enumerate(_TIMES_MS):
        Image.fromarray(np.round(encode(grating(t / 1000), "srgb") * 255).astype(np.uint8)).save(tmp_path / f"{k}.png")
    (tmp_path / "times.txt").write_text("".join(f"{60 + t / 1000:.6f}\n" for t in _TIMES_MS))
    outcome = clsim("detect", tmp_path, "--times", tmp_path / "times.txt", "--out", tmp_path / "a.csv", "--json")
    assert json.loads(outcome.stdout)["simulated_s"] == 0.21


def test_an_opencl_device_that_is_not_there_is_told(clsim, clip, tmp_path):
    outcome = clsim("detect", clip, "--opencl", "no such device", "--out", tmp_path / "events.csv")
    assert outcome.status == 2 and "no such device" in outcome.stderr


@pytest.mark.slow
def test_a_sensor_looks_at_a_video(clsim, clip, tmp_path):
    """The same sensor as in front of a scene: thresholds that differ make other events; its own threshold holds."""
    sensor = tmp_path / "sensor.toml"
    sensor.write_text("[threshold]\non = 0.3\noff = 0.3\nmismatch = 0.02\n")
    counts = []
    for options in ((), ("--sensor", sensor), ("--sensor", sensor, "--seed", 3)):
        out = tmp_path / "events.csv"
        outcome = clsim("detect", clip, "--out", out, "--transfer", "bt709", *options)
        assert outcome.status == 0, outcome.stderr
        with open_source(out) as events:
            counts.append(events.read())
    ideal, seen, other = counts
    assert 0.5 < len(seen) / len(ideal) < 0.8
    assert seen.tolist() != other.tolist()
    again = gather(events_from(str(clip), transfer="bt709", sensor=str(sensor)))
    np.testing.assert_array_equal(seen, again)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("a.mp4",), "a.mp4: there is no such file"),
        (("a.mp4", "--fps", "30", "--times", "t.txt"), "give one of them"),
        (("frames", "--transfer", "srgb"), "--transfer is for video and pictures"),
        (("a.mp4", "--time-unit", "ms"), "--time-unit is that of the file in --times, which is not given"),
        (("a.png", "--fps", "30"), "no picture at a.png"),
        (("a.mp4", "--transfer", "gamma"), "--transfer"),
    ],
)
def test_what_cannot_be(clsim, tmp_path, monkeypatch, arguments, sentence):
    monkeypatch.chdir(tmp_path)
    outcome = clsim("detect", *arguments, "--out", "events.csv")
    assert outcome.status == 2
    assert sentence in outcome.stderr
    assert not (tmp_path / "events.csv").exists()
