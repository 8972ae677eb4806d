"""What ``clsim live`` says of the settings that hold and of what a governor gave up."""

import json
from collections.abc import Callable

import pytest
from rich.console import Console

from clsim.cli.status import _print_summary, _status_line
from clsim.live.options import LiveOptions
from clsim.live.quality import QUALITIES
from clsim.live.session import open_live

SMALL = ("--resolution", "16x12", "--frame-count", "6", "--fps", "20")


def words(text: str) -> str:
    return " ".join(text.split())


def test_the_settings_of_a_quality_are_printed(clsim: Callable[..., object]) -> None:
    outcome = clsim("live", "still", *SMALL, "--quality", "draft", "--spp", "2", "--view", "none")
    assert outcome.status == 0
    assert "clsim: draft: irradiance 7x7, 2 spp, 4 first-hit rays, sobol" in words(outcome.stderr)


def test_a_run_that_no_governor_can_help_says_so(clsim: Callable[..., object]) -> None:
    outcome = clsim("live", "still", *SMALL, "--pace", "real", "--noise", "independent", "--view", "none")
    assert "no governor: it needs --noise common and first-hit rays" in words(outcome.stderr)
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


def test_help_tells_what_the_qualities_are(clsim: Callable[..., object], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "400")
    text = words(clsim("live", "--help").stdout)
    for name, point in QUALITIES.items():
        assert f"{name}: {point.text()}" in text
