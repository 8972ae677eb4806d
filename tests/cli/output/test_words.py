"""Figures of a run in words."""

import pytest

from clsim.cli.output.words import (
    count_text,
    dropped_text,
    events_text,
    moved_text,
    percent_text,
    real_time_share,
    size_text,
)


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
    assert dropped_text(1) == (
        "1 event was left out, for it lies outside the sensor, or has no time or one far out of order"
    )
    assert dropped_text(2) == (
        "2 events were left out, for they lie outside the sensor, or have no time or one far out of order"
    )
    assert moved_text(1) == "1 event came after a later one and was put in order"
    assert moved_text(2) == "2 events came after later ones and were put in order"


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
