"""What ``clsim live`` says of the settings that hold and of what a governor gave up."""

import json
from collections.abc import Callable

import pytest
from rich.console import Console

from clsim.cli.status import _print_summary, _print_warnings, _status_line
from clsim.live.options import LiveOptions
from clsim.live.quality import QUALITIES
from clsim.live.session import open_live

SMALL = ("--resolution", "16x12", "--frame-count", "6", "--fps", "20")


def words(text: str) -> str:
    return " ".join(text.split())


def test_the_settings_of_a_quality_are_printed(clsim: Callable[..., object]) -> None:
    outcome = clsim("live", "still", *SMALL, "--quality", "draft", "--spp", "2", "--view", "none")
    assert outcome.status == 0
    settings = "irradiance 7x7, 2 spp, pixels probed each 2 frames, 4 first-hit rays, sobol"
    assert f"clsim: draft: {settings}" in words(outcome.stderr)


def test_options_that_the_method_has_no_use_for_are_named(clsim: Callable[..., object]) -> None:
    command = ("live", "still", *SMALL, "--first-hit-rays", "4", "--method", "irradiance", "--view", "none")
    assert "has no use for" not in clsim(*command).stderr
    outcome = clsim(*command, "--history", "2", "--gate", "delta-r")
    assert "clsim: --method irradiance has no use for --history, --gate" in words(outcome.stderr)


def test_a_governor_without_a_clock_is_refused(clsim: Callable[..., object]) -> None:
    outcome = clsim("live", "still", *SMALL, "--governor")
    assert (outcome.status, outcome.stderr) == (
        2,
        "clsim: --governor needs --pace real: without a clock to keep, no frame can be late\n",
    )
    assert clsim("live", "still", *SMALL, "--no-governor", "--view", "none").status == 0


@pytest.mark.parametrize("cause", ["--noise independent", "--first-hit-rays 0", "--quality exact"])
def test_a_run_that_no_governor_can_help_names_the_cause(clsim: Callable[..., object], cause: str) -> None:
    outcome = clsim("live", "still", *SMALL, "--pace", "real", *cause.split(), "--view", "none")
    assert f"no governor, because of {cause}: frames may be late" in words(outcome.stderr)


def test_nobody_misses_a_governor_that_was_declined(clsim: Callable[..., object]) -> None:
    outcome = clsim("live", "still", *SMALL, "--pace", "real", "--no-governor", "--view", "none")
    assert "governor" not in outcome.stderr


def test_json_tells_paths_effort_and_governor(clsim: Callable[..., object]) -> None:
    outcome = clsim("live", "still", *SMALL, "--pace", "real", "--json")
    summary = json.loads(outcome.stdout)
    assert summary["paths"] > 0 and summary["first_hit_rays"] > 0
    assert set(summary["effort"]) == {"spp", "probe_spp", "first_hit_rays", "every"}
    assert summary["governor"]["levels"] > 5


def test_what_was_given_up_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    session = open_live(LiveOptions("still", resolution=(16, 12), pace="real"))
    assert session.governed is not None
    session.pipeline.progress.first_frame_s = 0.1
    assert "gave up" not in _status_line(session).plain
    session.governed.governor.level = 3
    given_up = f"samples {QUALITIES['balanced'].spp} -> 1"
    assert f"gave up: {given_up}" in _status_line(session).plain
    _print_summary(Console(stderr=True), session.summary() | {"interrupted": False})
    assert f"governor: gave up {given_up} (0 changes), 0 frames late" in words(capsys.readouterr().err)


@pytest.mark.parametrize(("method", "solves"), [("esim", False), ("irradiance", False), ("esim-ad", True)])
def test_only_methods_that_solve_regressions_tell_how_many(
    capsys: pytest.CaptureFixture[str], method: str, solves: bool
) -> None:
    session = open_live(LiveOptions("still", resolution=(16, 12), method=method))  # type: ignore[arg-type]
    session.pipeline.progress.first_frame_s = 0.1
    assert ("solved" in _status_line(session).plain) == solves
    _print_summary(Console(stderr=True), session.summary() | {"interrupted": False})
    assert ("solved" in capsys.readouterr().err) == solves


@pytest.mark.parametrize("late", [True, False])
def test_a_rate_that_cannot_be_had_is_told(capsys: pytest.CaptureFixture[str], late: bool) -> None:
    session = open_live(LiveOptions("still", resolution=(16, 12), pace="real", fps=25.0))
    assert session.governed is not None
    session.governed.governor.begin(2.0 if late else 1e-6, len(session.governed.levels) - 1)
    session.pipeline.progress.late_frames = 3
    _print_warnings(Console(stderr=True), session, session.summary())
    sentence = "too slow for 25 fps even at the lowest level: try a smaller --resolution or a lower --fps"
    assert (sentence in words(capsys.readouterr().err)) == late


def test_help_tells_what_the_qualities_are(clsim: Callable[..., object], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "1200")
    text = words(clsim("live", "--help").stdout)
    for name, point in QUALITIES.items():
        assert f"{name}: {point.text()}" in text
    assert "Light paths that every pixel gets, with adaptive sampling. [1]" in text
    assert QUALITIES["balanced"].probe_spp == 1
