"""What ``clsim live`` says of the settings that hold and of what a governor gave up."""

import io
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from clsim.cli.output import status
from clsim.cli.output.status import status_line
from clsim.cli.output.summary import print_losses, print_summary
from clsim.cli.output.words import count_text, dropped_text, events_text, percent_text, real_time_share, size_text
from clsim.live.options import LiveOptions
from clsim.live.quality import QUALITIES
from clsim.live.session import Session, open_live

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
    "cause", ["--noise independent", pytest.param("`first_hit_rays` 0", marks=pytest.mark.slow), "--quality exact"]
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


def told_at_the_end(session: Session, *, terminal: bool = True, **changes: object) -> str:
    """Return what is printed of a run whose summary is the session's with some values changed."""
    console = Console(file=io.StringIO(), force_terminal=terminal, width=500, no_color=True)
    with console.capture() as capture:
        summary = session.summary().as_dict() | {"interrupted": False} | changes
        print_losses(console, summary)
        print_summary(console, session, summary)
    return re.sub(r"\x1b\[[0-9;]*m", "", capture.get())


@pytest.fixture
def session() -> Session:
    """A run that has shown its first frame."""
    opened = open_live(LiveOptions("still", resolution=(16, 12), fps=25.0))
    opened.pipeline.progress.first_frame_s = 0.1
    return opened


def test_the_status_line_tells_how_fast(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    told = {"simulated_s": 0.18, "events": 2_700_000, "wall_s": 1.1, "startup_s": 0.1, "late_frames": 0}
    monkeypatch.setattr(session, "summary", lambda: replace(session.__class__.summary(session), **told))
    assert status_line(session).plain == "0.18 of 1.00 s · 2.7 M events · 18 % of real time"
    told |= {"late_frames": 4, "dropped_frames": 3, "outputs": [{"clients": 2, "dropped_events": 5000}, {"clients": 1}]}
    assert status_line(session).plain.endswith("4 frames late · 3 frames dropped · clients: 3 (missed 5.0 k events)")
    session.pipeline.progress.first_frame_s = None
    assert status_line(session).plain.startswith("still: starting")


def test_the_end_tells_what_happened_how_fast_and_where_it_is(session: Session, tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_bytes(bytes(1500))
    outputs = [{"name": f"{tmp_path}/a.txt"}, {"name": "tcp://x:1", "error": "no space"}]
    figures = {"events": 2_700_000, "simulated_s": 2.0, "wall_s": 21.0, "startup_s": 1.0, "outputs": outputs}
    assert told_at_the_end(session, **figures).splitlines() == [
        "2,700,000 events in 2.000 s of still (16x12)",
        "20.0 s of computing, 10 % of real time, after 1.0 s to start",
        f"→ {tmp_path}/a.txt (1.5 kB)",
        "→ tcp://x:1: no space",
        f"to look at it: clsim view {tmp_path}/a.txt",
    ]
    assert "look at it" not in told_at_the_end(session, terminal=False, **figures)
    assert "stopped: 2,700,000 events in 2.000 s of" in told_at_the_end(session, interrupted=True, **figures)


@pytest.mark.parametrize(
    ("figures", "hint"),
    [
        ({}, "to keep the events: --out events.aedat4"),
        ({"events": 100, "steep_pixels": 21, "most_crossings": 7}, "--fps 75 places events in time"),
        ({"events": 100, "steep_pixels": 20, "most_crossings": 7}, "to keep the events"),
        ({"outputs": [{"name": "tcp://x:1"}]}, None),
    ],
)
def test_there_is_one_hint_at_most(session: Session, figures: dict[str, object], hint: str | None) -> None:
    *_, last = told_at_the_end(session, **figures).splitlines()
    assert len(told_at_the_end(session, **figures).splitlines()) <= 4
    if hint is not None:
        assert hint in last


def test_what_was_lost_is_always_told(session: Session) -> None:
    text = told_at_the_end(session, terminal=False, masked_pixels=1200, capped_events=7, dropped_frames=3)
    assert "clsim: 1,200 NaN or infinite pixels were masked" in text
    assert "clsim: 7 events beyond 1000 per pixel and step were not written" in text
    assert "0 frames came late, 3 were dropped" in text
    motion = {"largest_px": 0.5, "fast_pairs": 0, "lost_pairs": 2, "pairs": 9}
    text = told_at_the_end(session, motion=motion)
    assert "clsim: in 2 pairs of frames nothing is found again" in text and "what is seen moves" not in text


def test_noise_is_told_where_it_is_more_than_a_tenth(session: Session) -> None:
    assert "clsim: about 24 % of the events are likely noise" in told_at_the_end(session, noise_share=0.237)
    assert "noise" not in told_at_the_end(session, noise_share=0.1) + told_at_the_end(session, noise_share=None)
    text = told_at_the_end(session, ideal_noise_share=0.237)
    assert "clsim: about 24 % of the events that ideal pixels would fire here are likely noise" in text
    assert "noise" not in told_at_the_end(session, ideal_noise_share=0.1)


@pytest.mark.parametrize(("first_frame_s", "long_s", "told"), [(None, 0.0, 1), (None, 1e3, 0), (0.1, 0.0, 0)])
def test_a_long_start_is_explained_once_without_a_terminal(
    session: Session, monkeypatch: pytest.MonkeyPatch, first_frame_s: float | None, long_s: float, told: int
) -> None:
    waits = iter((False, False, False, True))
    monkeypatch.setattr(session.pipeline, "wait", lambda _: next(waits))
    monkeypatch.setattr(session.pipeline.progress, "first_frame_s", first_frame_s)
    monkeypatch.setattr(status, "_LONG_START_S", long_s)
    console = Console(file=io.StringIO(), width=500)
    with console.capture() as capture:
        status.wait_to_the_end(session, console)
    assert capture.get().count("kernels are compiled") == told


def test_a_repeated_run_without_outputs_says_that_nothing_is_written(
    clsim: Callable[..., object], tmp_path: Path
) -> None:
    (tmp_path / "run.json").write_text('{"scene": "still", "resolution": [16, 12], "frame_count": 2}')
    said = "clsim: no events are written: --config repeats a run, but not its outputs; give --out\n"
    for arguments, expected in ((), True), (("--out", tmp_path / "a.txt"), False):
        outcome = clsim("live", "--config", tmp_path / "run.json", *arguments, "--view", "none")
        assert outcome.status == 0 and (said in outcome.stderr) == expected


def test_what_was_given_up_is_shown() -> None:
    session = open_live(LiveOptions("still", resolution=(16, 12), pace="real"))
    assert session.governed is not None
    session.pipeline.progress.first_frame_s = 0.1
    assert "gave up" not in status_line(session).plain
    session.governed.governor.level = 3
    given_up = "1 of 2 frames, samples 8 -> 2"
    assert f"gave up: {given_up}" in status_line(session).plain
    assert f"to keep up with the clock it gave up {given_up}" in told_at_the_end(session)


@pytest.mark.parametrize("late", [True, False])
def test_a_rate_that_cannot_be_had_is_told(late: bool) -> None:
    session = open_live(LiveOptions("still", resolution=(16, 12), pace="real", fps=25.0))
    assert session.governed is not None
    session.governed.governor.begin(2.0 if late else 1e-6, len(session.governed.levels) - 1)
    session.pipeline.progress.late_frames = 3
    sentence = "it fell behind all the same: lower --resolution"
    assert (sentence in told_at_the_end(session, terminal=False)) == late


@pytest.mark.parametrize(
    ("share", "text"), [(0.18, "18 %"), (0.0012, "0.12 %"), (3.2, "320 %"), (0.0, "0 %"), (0.0099, "0.99 %")]
)
def test_percentages(share: float, text: str) -> None:
    assert percent_text(share) == text


@pytest.mark.parametrize(
    ("value", "text"), [(999, "999"), (1000, "1.0 k"), (2_700_000, "2.7 M"), (1e9, "1.0 G"), (0, "0")]
)
def test_counts(value: float, text: str) -> None:
    assert count_text(value) == text


def test_one_event_is_one() -> None:
    assert [events_text(count) for count in (0, 1, 2700)] == ["0 events", "1 event", "2,700 events"]
    assert events_text(2700, short=True) == "2.7 k events"
    assert dropped_text(1).startswith("1 event was left out, for it lies outside the sensor, or has no time")


def test_help_tells_what_the_qualities_are(clsim: Callable[..., object], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "400")
    (said,) = (line for line in clsim("live", "--help").stdout.splitlines() if "How much is spent" in line)
    assert all(name in said.partition("How much")[2] for name in QUALITIES)


@pytest.mark.parametrize(
    ("size_bytes", "text"),
    [
        (0, "0 bytes"),
        (999, "999 bytes"),
        (1_000, "1.0 kB"),
        (1_500, "1.5 kB"),
        (1_300_000, "1.3 MB"),
        (2 * 10**9, "2.0 GB"),
    ],
)
def test_sizes_of_files_are_in_powers_of_a_thousand(size_bytes: int, text: str) -> None:
    assert size_text(size_bytes) == text


@pytest.mark.parametrize(
    ("simulated_s", "wall_s", "startup_s", "share"),
    [(2.0, 5.0, 1.0, 0.5), (2.0, 4.0, None, 0.5), (0.0, 4.0, 1.0, None), (2.0, 1.0, 1.0, None), (2.0, 1.0, 1.5, None)],
)
def test_pace_is_told_once_there_is_any(
    simulated_s: float, wall_s: float, startup_s: float | None, share: float | None
) -> None:
    assert real_time_share({"simulated_s": simulated_s, "wall_s": wall_s, "startup_s": startup_s}) == share
