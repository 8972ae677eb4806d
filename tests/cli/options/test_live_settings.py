"""What ``clsim live`` says of the settings that hold."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from clsim.live.quality import QUALITIES

SMALL = ("--resolution", "16x12", "--frame-count", "6", "--fps", "20")


def words(text: str) -> str:
    return " ".join(text.split())


def test_the_settings_of_a_quality_are_printed(clsim: Callable[..., object]) -> None:
    outcome = clsim("live", "still", *SMALL, "--quality", "draft", "--spp", "2", "--view", "none")
    assert outcome.status == 0
    settings = "esim, 1 to 2 spp, pixels probed each 64 frames, 8 first-hit rays, sobol, cached light"
    assert f"clsim: draft: {settings}" in words(outcome.stderr)


@pytest.mark.slow
def test_options_that_the_method_has_no_use_for_are_named(clsim: Callable[..., object], tmp_path: Path) -> None:
    (tmp_path / "run.toml").write_text('sampler = "sobol"\nfirst_hit_rays = 4\n')
    command = ("live", "still", *SMALL, "--config", tmp_path / "run.toml", "--method", "irradiance", "--view", "none")
    assert "has no use for" not in clsim(*command).stderr
    outcome = clsim(*command, "--history", "2", "--gate", "delta-r")
    assert "clsim: --method irradiance has no use for --gate, --history" in words(outcome.stderr)


@pytest.mark.parametrize(
    "cause",
    [pytest.param(each, marks=pytest.mark.slow) for each in ("--noise independent", "`first_hit_rays` 0")]
    + ["--quality exact"],
)
def test_a_run_that_no_governor_can_help_names_the_cause(
    clsim: Callable[..., object], tmp_path: Path, cause: str
) -> None:
    (tmp_path / "run.toml").write_text("first_hit_rays = 0\n")
    given = cause.split() if cause.startswith("--") else ("--config", tmp_path / "run.toml")
    outcome = clsim("live", "still", *SMALL, "--pace", "real", *given, "--view", "none")
    assert f"no governor, because of {cause}: frames may be late" in words(outcome.stderr)


def test_nobody_misses_a_governor_that_was_declined(clsim: Callable[..., object], tmp_path: Path) -> None:
    (tmp_path / "run.toml").write_text("governor = false\n")
    without = ("--config", tmp_path / "run.toml", "--view", "none")
    assert clsim("live", "still", *SMALL, *without).status == 0
    outcome = clsim("live", "still", *SMALL, "--pace", "real", *without)
    assert outcome.status == 0 and "governor" not in outcome.stderr


def test_json_tells_paths_effort_and_governor(clsim: Callable[..., object]) -> None:
    outcome = clsim("live", "still", *SMALL, "--pace", "real", "--json")
    summary = json.loads(outcome.stdout)
    assert summary["paths"] > 0 and summary["first_hit_rays"] > 0
    assert set(summary["effort"]) == {"spp", "probe_spp", "first_hit_rays", "every"}
    assert summary["governor"]["levels"] > 5


def test_a_repeated_run_without_outputs_says_that_nothing_is_written(
    clsim: Callable[..., object], tmp_path: Path
) -> None:
    (tmp_path / "run.json").write_text('{"scene": "still", "resolution": [16, 12], "frame_count": 2}')
    said = "clsim: no events are written: --config repeats a run, but not its outputs; give --out\n"
    for arguments, expected in ((), True), (("--out", tmp_path / "a.txt"), False):
        outcome = clsim("live", "--config", tmp_path / "run.json", *arguments, "--view", "none")
        assert outcome.status == 0 and (said in outcome.stderr) == expected


def test_a_run_whose_events_go_nowhere_says_so(clsim: Callable[..., object], tmp_path: Path) -> None:
    for arguments, expected in ((), True), (("--out", tmp_path / "a.txt"), False), (("--json",), False):
        outcome = clsim("live", "still", *SMALL, *arguments)
        assert outcome.status == 0 and ("no events are written: give --out" in outcome.stderr) == expected


def test_help_tells_what_the_qualities_are(clsim: Callable[..., object], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "400")
    (said,) = (line for line in clsim("live", "--help").stdout.splitlines() if "How much is spent" in line)
    assert all(name in said.partition("How much")[2] for name in QUALITIES)
