"""What is told of a run while it goes on and at its end."""

import io
import re
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from clsim.cli.output import status
from clsim.cli.output.status import status_line
from clsim.cli.output.summary import print_losses, print_summary
from clsim.live.options import LiveOptions
from clsim.live.outputs.silence import Silence
from clsim.live.sensors import LightMeter
from clsim.live.session import Session, open_live
from clsim.sensor import load_sensor


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
    text = told_at_the_end(session, motion={"largest_px": 2.46, "fast_pairs": 1234, "lost_pairs": 0, "pairs": 5678})
    assert "moves by up to 2.5 pixels from one frame to the next, and by more than 1 in 1,234 of 5,678 pairs" in text
    assert "nothing is found again" not in text


def test_each_loss_is_told_alone(session: Session) -> None:
    busy, dark = "1,234 events were lost in the sensor's readout", "clsim: here is no light"
    still = "clsim: nothing changed; --threshold is one"
    losses = {"events": 0, "lost_events": 0, "capped_events": 0, "too_dark": None}
    cases = [
        ({}, []), ({"lost_events": 1234}, [busy]), ({"events": 9, "too_dark": dark[7:]}, [dark]),
        ({"no_events": "nothing changed; `threshold` is one"}, [still]),
    ]  # fmt: skip
    for changes, said in cases:
        text = told_at_the_end(session, terminal=False, **(losses | changes))
        assert [sentence for sentence in (busy, dark, still) if sentence in text] == said
        assert text.count("clsim:") == len(said)


def test_a_run_looks_for_why_it_has_no_events_and_says_so_unless_it_is_too_dark(session: Session) -> None:
    progress = session.pipeline.progress
    assert session.silence in session.pipeline.watchers and session.summary().no_events is None
    progress.frames = 9
    assert told_at_the_end(session, frames=9).splitlines()[-1].startswith("nothing moves here, and no light changes")
    assert "nothing moves" not in told_at_the_end(session, frames=9, events=1)
    session.silence = Silence(progress, session.about, None)
    assert "brightness changed by the threshold" in str(session.summary().no_events)
    session.meter = LightMeter(load_sensor("davis346"), 100.0)
    session.meter.told = "it is dark"
    assert session.summary().no_events is None


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
