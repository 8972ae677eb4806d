"""Sidecars tell enough to do a run again, and what the user was told of it."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from clsim.events.files import open_source
from tests.footage.clips import encode, grating

SMALL = ("--resolution", "32x24", "--fps", "60", "--frame-count", "4", "--quality", "draft", "--view", "none")
DARK = """
[camera]
position = [0.0, 1.2, 3.0]
look_at = [0.0, 0.4, 0.0]
[environment]
radiance = [{0}, {0}, {0}]
[[objects]]
shape = "box"
keyframes = [
  {{ time_s = 0.0, position = [0.0, 0.4, 0.0] }},
  {{ time_s = 1.0, position = [0.0, 0.4, 0.0], rotation_deg = [0.0, 90.0, 0.0] }},
]
"""


@pytest.fixture
def pictures(tmp_path: Path) -> Path:
    """Pictures of a grating that moves, with a file of their times beside."""
    folder = tmp_path / "pictures"
    folder.mkdir()
    for k in range(4):
        Image.fromarray(np.round(encode(grating(k / 100), "srgb") * 255).astype(np.uint8)).save(folder / f"{k}.png")
    (tmp_path / "times.txt").write_text("0\n0.01\n0.02\n0.03\n")
    return folder


def test_detection_in_pictures_is_repeated_from_its_sidecar(
    clsim: Callable[..., object], pictures: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From another folder, too, with all that was chosen: thresholds, sensor, times and how light is decoded."""
    monkeypatch.chdir(tmp_path)
    chosen = ("--threshold", "0.1,0.3", "--sensor", "davis346", "--seed", "5", "--transfer", "linear")
    first = clsim("detect", "pictures", "--times", "times.txt", *chosen, "--out", "a.csv")
    assert first.status == 0, first.stderr
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    again = clsim("detect", "--config", "../a.csv.json", "--out", "b.csv")
    assert again.status == 0, again.stderr
    assert Path("../a.csv").stat().st_size > 100 and Path("b.csv").read_bytes() == Path("../a.csv").read_bytes()
    # What is given beside it wins.
    assert clsim("detect", "--config", "../a.csv.json", "--threshold", "0.6", "--out", "c.csv").status == 0
    assert 0 < len(Path("c.csv").read_text().splitlines()) < len(Path("b.csv").read_text().splitlines())
    assert clsim("detect", "--config", "../a.csv.json", "--text-time", "s", "--out", "d.csv").status == 0
    with open_source("b.csv") as whole_us, open_source("d.csv") as seconds:
        np.testing.assert_array_equal(seconds.read(), whole_us.read())
    assert Path("d.csv").read_text() != Path("b.csv").read_text()


@pytest.mark.parametrize(
    ("first", "beside", "alone"),
    [
        (("--times", "times.txt"), ("--fps", "50"), ("--fps", "50")),
        (("--fps", "50"), ("--times", "times.txt"), ("--times", "times.txt")),
        (("--fps", "50", "--transfer", "srgb"), ("--like", "v2e"), ("--fps", "50", "--like", "v2e")),
    ],
)
def test_what_is_given_beside_a_sidecar_takes_the_place_of_what_says_the_same(
    clsim: Callable[..., object], pictures: Path, monkeypatch: pytest.MonkeyPatch,
    first: tuple[str, ...], beside: tuple[str, ...], alone: tuple[str, ...],
) -> None:  # fmt: skip
    """When pictures are is told by a rate or by times; how light is decoded, by itself or by whom results are like."""
    monkeypatch.chdir(pictures.parent)
    runs = {"a": ("pictures", *first), "b": ("--config", "a.csv.json", *beside), "c": ("pictures", *alone)}
    for name, options in runs.items():
        outcome = clsim("detect", *options, "--threshold", "0.02", "--out", f"{name}.csv")
        assert outcome.status == 0, outcome.stderr
    assert Path("c.csv").stat().st_size > 100
    assert Path("a.csv").read_bytes() != Path("b.csv").read_bytes() == Path("c.csv").read_bytes()


def test_detection_in_rendered_frames_is_repeated_from_its_sidecar(
    clsim: Callable[..., object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert clsim("render", "two-boxes", *SMALL[:-2], "--out", "frames").status == 0
    assert clsim("detect", "frames", "--threshold", "0.1", "--floor", "0.01", "--out", "a.csv").status == 0
    assert json.loads(Path("a.csv.json").read_text())["fps"] == 60, "not that of times in whole microseconds"
    monkeypatch.chdir(tmp_path.parent)
    outcome = clsim("detect", "--config", tmp_path / "a.csv.json", "--out", tmp_path / "b.csv")
    assert outcome.status == 0, outcome.stderr
    assert (tmp_path / "a.csv").stat().st_size > 100
    assert (tmp_path / "b.csv").read_bytes() == (tmp_path / "a.csv").read_bytes()


def test_a_sensor_given_beside_a_sidecar_wins(
    clsim: Callable[..., object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert clsim("render", "two-boxes", *SMALL[:-2], "--out", "frames").status == 0
    seen = ("--threshold", "0.1", "--sensor", "davis346", "--seed")
    for seed in ("1", "2"):
        assert clsim("detect", "frames", *seen, seed, "--out", f"{seed}.csv").status == 0
    assert clsim("detect", "--config", "1.csv.json", "--seed", "2", "--out", "again.csv").status == 0
    one, two, again = (Path(f"{name}.csv").read_bytes() for name in ("1", "2", "again"))
    assert again == two != one
    assert clsim("detect", "frames", *seen, "1", "--labels", "--out", "1.h5").status == 0
    with open_source("1.h5") as labelled, open_source("1.csv") as plain:
        assert labelled.labelled == ("cause",) and len(labelled.read()) == len(plain.read()) > 0


def test_each_command_names_the_one_whose_sidecar_it_is(clsim: Callable[..., object], tmp_path: Path) -> None:
    (tmp_path / "detect.json").write_text(json.dumps({"options": {"frames": "f", "config": {}}}))
    (tmp_path / "live.json").write_text(json.dumps({"options": {"scene": "still"}}))
    outcome = clsim("live", "--config", tmp_path / "detect.json")
    assert outcome.status == 2 and "use clsim detect --config" in outcome.stderr
    outcome = clsim("detect", "--config", tmp_path / "live.json", "--out", tmp_path / "x.csv")
    assert outcome.status == 2 and "is of no run of clsim detect" in outcome.stderr
    assert clsim("detect", "--out", tmp_path / "x.csv").status == 2
    assert clsim("detect", tmp_path).status == 2


def test_truth_none_leaves_truth_out_of_a_repeated_run(clsim: Callable[..., object], tmp_path: Path) -> None:
    command = ("live", "two-boxes", *SMALL, "--truth", "depth", "--frame-rate", "30")
    assert clsim(*command, "--out", tmp_path / "a.h5", "--out", tmp_path / "a.csv").status == 0
    outcome = clsim(
        "live", "--config", tmp_path / "a.h5.json", "--truth", "none", "--out", tmp_path / "b.csv", "--view", "none"
    )
    assert outcome.status == 0, outcome.stderr
    assert (tmp_path / "a.csv").stat().st_size > 100
    assert (tmp_path / "b.csv").read_bytes() == (tmp_path / "a.csv").read_bytes()
    outcome = clsim("live", "two-boxes", *SMALL, "--truth", "none,depth", "--out", tmp_path / "c.h5")
    assert outcome.status == 2 and "none is nothing else" in outcome.stderr


def test_warnings_stand_in_the_sidecar(clsim: Callable[..., object], tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(DARK.format(0.0))
    outcome = clsim("live", tmp_path / "scene.toml", *SMALL, "--out", tmp_path / "a.csv")
    assert outcome.status == 0, outcome.stderr
    (told,) = json.loads((tmp_path / "a.csv.json").read_text())["warnings"]
    assert "light" in told and told in outcome.stderr


@pytest.mark.parametrize(("radiance", "dark"), [(0.0004, True), (0.4, False)])
def test_a_scene_too_dark_for_the_sensor_is_told(
    clsim: Callable[..., object], tmp_path: Path, radiance: float, dark: bool
) -> None:
    """0.04 lux are 0.04 / 0.14 of the photocurrent of a DAVIS346, whose dark current is that of 0.1 lux."""
    (tmp_path / "scene.toml").write_text(DARK.format(radiance))
    outcome = clsim("live", tmp_path / "scene.toml", *SMALL, "--sensor", "davis346", "--out", tmp_path / "a.csv")
    assert outcome.status == 0, outcome.stderr
    told = json.loads((tmp_path / "a.csv.json").read_text())["summary"]["too_dark"]
    assert (told is not None) is dark and ("darker than" in outcome.stderr) is dark
    if dark:
        assert "darker than 0.04 lux, where davis346 has 29 % of a scene's contrast" in told
