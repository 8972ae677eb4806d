"""`clsim score` knows the grid of a recording from its sidecar."""

import json
from pathlib import Path

import numpy as np
import pytest

from clsim.events import EVENT_DTYPE
from clsim.events.files import open_sink
from clsim.frames import BASE_PLANES, Frame
from clsim.frames.exr import ExrWriter
from tests.events.event_data import end_of


def record(path: Path, times_us: list[int], **about: object) -> Path:
    """Write one ON event per time to a text file, which does not tell the sensor's size, and a sidecar."""
    events = np.zeros(len(times_us), EVENT_DTYPE)
    events["t"], events["on"] = times_us, True
    events["x"] = 1
    sink = open_sink(path, 8, 4)
    if len(events):
        sink.write(events, end_of(events))
    sink.close()
    if about:
        Path(f"{path}.json").write_text(json.dumps(about))
    return path


def size(width: int, height: int) -> dict[str, object]:
    return {"camera": {"width": width, "height": height}}


def test_size_and_rate_come_from_the_sidecars(clsim, tmp_path: Path) -> None:
    """5 ms apart: the same frame at 50 fps, and one frame apart at 200; given options win."""
    found = record(tmp_path / "found.txt", [11_000], **size(8, 4), fps=50.0)
    truth = record(tmp_path / "truth.txt", [16_000], **size(8, 4), fps=50.0)
    f1 = []
    for options in ([], ["--resolution", "8x4", "--fps", 50], ["--fps", 200]):
        outcome = clsim("score", found, truth, "--json", *options)
        assert outcome.status == 0, outcome.stderr
        f1.append(json.loads(outcome.stdout)["f1"])
    assert f1 == [1, 1, 0]


def test_one_sidecar_is_enough(clsim, tmp_path: Path) -> None:
    found = record(tmp_path / "found.txt", [11_000])
    truth = record(tmp_path / "truth.txt", [11_000], **size(8, 4), fps=50.0)
    for pair in ((found, truth), (truth, found)):
        assert json.loads(clsim("score", *pair, "--json").stdout)["f1"] == 1


@pytest.mark.parametrize(
    ("found", "truth", "options", "expected"),
    [
        (
            {**size(8, 4), "fps": 50},
            {**size(8, 4), "fps": 60},
            [],
            "--fps: {}/a.txt has 50, but {}/b.txt has 60; expected recordings that agree, or the option",
        ),
        (
            {**size(8, 4), "fps": 50},
            {**size(8, 5), "fps": 60},
            ["--fps", "50"],
            "--resolution: {}/a.txt has 8x4, but {}/b.txt has 8x5; expected recordings that agree, or the option",
        ),
        ({"fps": 50}, {}, ["--resolution", "8x4"], None),
        (size(8, 4), {}, [], "--fps is needed, for neither {}/a.txt nor {}/b.txt tells it"),
        ({**size(8, 4), "fps": -1}, {}, [], "--fps is needed, for neither {}/a.txt nor {}/b.txt tells it"),
        ({"camera": 3, "fps": 50}, {}, [], "--resolution is needed, for neither {}/a.txt nor {}/b.txt tells it"),
    ],
)
def test_what_cannot_be_known_is_asked_for(clsim, tmp_path: Path, found, truth, options, expected) -> None:
    paths = [record(tmp_path / f"{name}.txt", [11_000], **about) for name, about in (("a", found), ("b", truth))]
    outcome = clsim("score", *paths, *options)
    if expected is None:
        assert outcome.status == 0, outcome.stderr
    else:
        assert (outcome.status, outcome.stderr) == (2, f"clsim: {expected.replace('{}', str(tmp_path))}\n")


@pytest.mark.parametrize("text", ["[1", "[1]", "3", '"fps"'])
def test_a_file_beside_it_that_is_no_sidecar_tells_nothing(clsim, tmp_path: Path, text: str) -> None:
    paths = [record(tmp_path / f"{name}.txt", [11_000]) for name in "ab"]
    (tmp_path / "b.txt.json").write_text(text)
    outcome = clsim("score", *paths)
    assert outcome.status == 2 and "--resolution is needed" in outcome.stderr


def test_detected_frames_tell_all_that_is_needed(clsim, tmp_path: Path) -> None:
    writer = ExrWriter(tmp_path / "frames")
    for k in range(3):
        planes = np.ones((len(BASE_PLANES), 3, 5), np.float32)
        planes[:3] = 0.2 if k % 2 else 0.8
        writer.write(Frame(planes, BASE_PLANES, 100_000 * k, k))
    for name in ("a", "b"):
        detected = clsim("detect", tmp_path / "frames", "--method", "esim", "--out", tmp_path / f"{name}.txt")
        assert detected.status == 0, detected.stderr
    outcome = clsim("score", tmp_path / "a.txt", tmp_path / "b.txt", "--json")
    assert json.loads(outcome.stdout)["f1"] == 1


@pytest.mark.parametrize(("told", "expected"), [(120.0, 120.0), (60.0, 1e6 / 8333)])
def test_the_rate_is_that_of_the_rendering_unless_the_times_say_otherwise(
    clsim, tmp_path: Path, told: float, expected: float
) -> None:
    """Times are whole µs: 8333 of them are 1/120.0048 s."""
    writer = ExrWriter(tmp_path / "frames")
    for k in range(2):
        planes = np.full((len(BASE_PLANES), 3, 5), 0.2 + k, np.float32)
        writer.write(Frame(planes, BASE_PLANES, 8333 * k, k))
    (tmp_path / "frames" / "frames.json").write_text(json.dumps({"fps": told}))
    found = tmp_path / "found.txt"
    assert clsim("detect", tmp_path / "frames", "--method", "esim", "--out", found).status == 0
    assert json.loads(Path(f"{found}.json").read_text())["fps"] == pytest.approx(expected, rel=1e-12)
    assert max(int(line.split()[0]) for line in found.read_text().splitlines()) <= 8333


@pytest.mark.parametrize(("fps", "status"), [(50.02, 0), (50.1, 2)])
def test_rates_found_from_rounded_times_agree_and_the_reference_says_which(
    clsim, tmp_path: Path, fps: float, status: int
) -> None:
    """At 50 fps 60 ms end frame 3; at 50.02 the event is in frame 4, and the reference's at 50 ms in frame 3."""
    found = record(tmp_path / "found.txt", [60_000], **size(8, 4), fps=fps)
    truth = record(tmp_path / "truth.txt", [50_000], **size(8, 4), fps=50.0)
    outcome = clsim("score", found, truth, "--json")
    assert outcome.status == status, outcome.stderr
    assert status or json.loads(outcome.stdout)["f1"] == 1


def test_what_the_scores_mean_is_said(clsim, tmp_path: Path) -> None:
    paths = [record(tmp_path / f"{name}.txt", [11_000], **size(8, 4), fps=50.0) for name in "ab"]
    assert clsim("score", *paths).stdout.startswith("f1, precision, recall: 1 is best; chamfer: 0 is best; dt: µs")


def test_windows_of_time_are_scored_and_printed(clsim, tmp_path: Path) -> None:
    """Two events 0.4 ms apart."""
    found = record(tmp_path / "found.txt", [11_400], **size(8, 4), fps=50.0)
    truth = record(tmp_path / "truth.txt", [11_000], **size(8, 4), fps=50.0)
    told = json.loads(clsim("score", found, truth, "--within", "1ms,300us", "--json").stdout)
    assert {window: each["f1"] for window, each in told["within"].items()} == {"300": 0, "1000": 1}
    assert (told["dt_median_us"], told["dt_bias_us"]) == (400, 400)
    lines = clsim("score", found, truth).stdout.splitlines()
    assert "F1 within 0.3 ms     0" in lines and "F1 within 10 ms      1" in lines
    for wrong in ("", "1ms,", "0.4us", "x"):
        outcome = clsim("score", found, truth, "--within", wrong)
        assert outcome.status == 2 and "--within must be" in outcome.stderr


@pytest.mark.parametrize("order", [("bad.txt", "good.txt"), ("good.txt", "bad.txt")])
def test_events_out_of_order_are_told_and_strict_refuses(clsim, tmp_path: Path, order: tuple[str, str]) -> None:
    record(tmp_path / "good.txt", [11_000, 12_000, 13_000])
    good = (tmp_path / "good.txt").read_text().splitlines()
    (tmp_path / "bad.txt").write_text("\n".join([*good[:-2], good[-1], good[-2]]) + "\n")
    pair = [tmp_path / name for name in order]
    options = ("--resolution", "8x4", "--fps", 50, "--json")
    outcome = clsim("score", *pair, *options)
    assert outcome.status == 0 and json.loads(outcome.stdout)["f1"] == 1
    assert "bad.txt" in outcome.stderr and "1 event" in outcome.stderr
    refused = clsim("score", *pair, *options, "--strict")
    assert refused.status == 2 and "expected rising times" in refused.stderr and refused.stdout == ""


@pytest.mark.parametrize(("ends_s", "said"), [(0.2, True), (0.13, True), (0.11, False), (None, False), ("soon", False)])
def test_a_recording_that_goes_on_after_the_other_is_told(clsim, tmp_path: Path, ends_s: object, said: bool) -> None:
    """More than a frame is told, half a frame is none."""
    about = {**size(8, 4), "fps": 50.0}
    summary = "none" if ends_s is None else {"simulated_s": ends_s}
    found = record(tmp_path / "found.txt", [11_000, 150_000], **about, summary=summary)
    truth = record(tmp_path / "truth.txt", [11_000], **about, summary={"simulated_s": 0.1})
    outcome = clsim("score", found, truth, "--json")
    sentence = f"{truth} ends at 0.1 s, {found} at {ends_s} s: events after the earlier end match nothing"
    assert outcome.status == 0 and json.loads(outcome.stdout)["precision"] == 0.5
    assert (sentence in " ".join(outcome.stderr.split())) == said and bool(outcome.stderr) == said


def test_what_is_drawn_are_the_scores_that_are_told(clsim, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two events one has a partner, which is the only true one."""
    drawn = {}
    monkeypatch.setattr("clsim.score.plot_curves", lambda curves, file: drawn.update(curves))
    found = record(tmp_path / "found.txt", [11_000, 200_000], **size(8, 4), fps=50.0)
    truth = record(tmp_path / "truth.txt", [11_000], **size(8, 4), fps=50.0)
    told = json.loads(clsim("score", found, truth, "--plot", tmp_path / "a.png", "--json").stdout)
    assert (told["precision"], told["recall"]) == (0.5, 1.0)
    assert (set(drawn["found"].precision), set(drawn["found"].recall)) == ({0.5}, {1.0})


def test_recordings_without_a_time_in_common_are_told(clsim, tmp_path: Path) -> None:
    """Such as one of a clock since 1970 and one since its start: nothing can match, whatever was detected."""
    told = "have no time in common, so that nothing matches"
    early, late = (record(tmp_path / f"{start}.txt", [start, start + 50_000]) for start in (1_000, 900_000))
    both, none = record(tmp_path / "both.txt", [30_000, 910_000]), record(tmp_path / "none.txt", [])
    for pair, apart in (((early, late), True), ((late, early), True), ((both, late), False), ((none, late), False)):
        outcome = clsim("score", *pair, "--json", "--resolution", "8x4", "--fps", 50)
        assert (told in outcome.stderr) == apart, outcome.stderr
