"""One-to-one matches, against brute force and scipy's assignment."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from clsim.errors import InputError
from clsim.events import EVENT_DTYPE
from clsim.score import Sampling, score
from clsim.score.assignment import assign
from clsim.score.matching import one_to_one

SAMPLING = Sampling(4, 3, 100.0)


def batch(*events):
    return np.array([(t, x, y, on) for t, x, y, on in events], dtype=EVENT_DTYPE)


def at_one_pixel(*times):
    return batch(*((t, 1, 2, True) for t in times))


def random_batch(rng, count, longest):
    events = np.empty(count, dtype=EVENT_DTYPE)
    events["t"] = rng.integers(1, longest, count)
    events["x"], events["y"], events["on"] = rng.integers(0, 2, count), rng.integers(1, 3, count), rng.integers(0, 2)
    return events


def by_scipy(events, others, allowed):
    """Return the number of pairs and the sum of |Δt| of the best assignment."""
    dt = np.abs(events["t"][:, None] - others["t"][None])
    for name in ("x", "y", "on"):
        allowed = allowed & (events[name][:, None] == others[name][None])
    much = float(dt.sum() + 1) if dt.size else 1.0
    rows, columns = linear_sum_assignment(np.where(allowed, dt - much, 0.0))
    taken = allowed[rows, columns]
    return int(taken.sum()), int(dt[rows, columns][taken].sum())


def by_brute_force(times, others, within):
    """Try every way to match some of the one, in order, with as many of the other."""
    for pairs in range(min(len(times), len(others)), 0, -1):
        sums = [
            sum(abs(a - b) for a, b in zip(some, theirs, strict=True))
            for some in combinations(sorted(times), pairs)
            for theirs in combinations(sorted(others), pairs)
            if all(abs(a - b) <= within for a, b in zip(some, theirs, strict=True))
        ]
        if sums:
            return pairs, min(sums)
    return 0, 0


_times = st.lists(st.integers(1, 60), max_size=6)


@settings(max_examples=40)
@given(_times, _times, st.integers(1, 30))
@example([1, 2], [1, 30], 30)  # two pairs, of which one is far apart
def test_one_pixel_against_brute_force(times, others, within):
    late = one_to_one(at_one_pixel(*times), at_one_pixel(*others), SAMPLING, within)
    assert (len(late), int(np.abs(late).sum())) == by_brute_force(times, others, within)
    assert (np.abs(late) <= within).all()


@settings(max_examples=40)
@given(st.integers(0, 10**6), st.integers(0, 40), st.integers(0, 40), st.sampled_from([1, 30, 400, 20_000]))
def test_many_pixels_against_scipys_assignment(seed, count, other_count, within):
    rng = np.random.default_rng(seed)
    events, others = (random_batch(rng, n, 20 * within) for n in (count, other_count))
    near = np.abs(events["t"][:, None] - others["t"][None]) <= within
    late = one_to_one(events, others, SAMPLING, within)
    assert (len(late), int(np.abs(late).sum())) == by_scipy(events, others, near)


@settings(max_examples=40)
@given(st.integers(0, 10**6), st.integers(0, 40), st.integers(0, 40))
def test_frames_against_scipys_assignment(seed, count, other_count):
    rng = np.random.default_rng(seed)
    events, others = (random_batch(rng, n, 200_000) for n in (count, other_count))
    frames, other_frames = SAMPLING.frames(events), SAMPLING.frames(others)
    late = one_to_one(events, others, SAMPLING, None)
    assert (len(late), int(np.abs(late).sum())) == by_scipy(
        events, others, np.abs(frames[:, None] - other_frames[None]) <= 1
    )


def test_the_nearest_first_would_match_fewer():
    """10 is nearest to 12, but then 2 and 20 have nobody: 2–10, 12–20 are two pairs."""
    late = one_to_one(at_one_pixel(2, 12), at_one_pixel(10, 20), SAMPLING, 8)
    assert sorted(late) == [-8, -8]


def test_the_first_in_time_would_not_match_the_closest():
    """One pair either way: 10–10 is closer than 10–1."""
    assert one_to_one(at_one_pixel(10), at_one_pixel(1, 10, 19), SAMPLING, 9).tolist() == [0]


@pytest.mark.parametrize("order", [1, -1])
def test_pixels_of_unequal_numbers_of_events_do_not_mix(order):
    """Three events at one pixel, four at another, whichever comes last: each has its partner, by what it is late."""
    times = ((1, (10, 20, 30)), (3, (11, 21, 31, 41))) if order > 0 else ((1, (11, 21, 31, 41)), (3, (10, 20, 30)))
    events = batch(*((t, x, 2, True) for x, some in times for t in some))
    others = batch(*((t + 3, x, 2, True) for x, some in times for t in some))
    assert one_to_one(events, others, SAMPLING, 25).tolist() == [-3] * 7


def test_windows_include_their_ends_and_never_reach_into_another_pixel():
    assert len(one_to_one(at_one_pixel(10), at_one_pixel(15), SAMPLING, 5)) == 1
    assert len(one_to_one(at_one_pixel(10), at_one_pixel(15), SAMPLING, 4)) == 0
    elsewhere = batch((10, 0, 2, True), (10, 1, 1, True), (10, 1, 2, False), (10, 2, 2, True))
    assert len(one_to_one(at_one_pixel(10), elsewhere, SAMPLING, 10**6)) == 0


@pytest.mark.slow
def test_a_long_burst_is_solved_in_parts_of_bounded_memory(monkeypatch):
    """All events hang together; a second pixel goes into a table of its own."""
    rng = np.random.default_rng(1)
    times, others = (np.sort(rng.integers(0, 40_000, 3_000)) for _ in range(2))
    events = batch(*((t, x, 0, True) for x in (0, 1) for t in times))
    reference = batch(*((t, x, 0, True) for x in (0, 1) for t in others))
    expected = np.sort(one_to_one(events, reference, SAMPLING, 200))
    monkeypatch.setattr("clsim.score.assignment._MOST_CELLS", 1)
    assert np.array_equal(np.sort(one_to_one(events, reference, SAMPLING, 200)), expected)
    alone = one_to_one(events[:3_000], reference[:3_000], SAMPLING, 200)
    assert np.array_equal(np.sort(np.concatenate([alone, alone])), expected) and 2_500 < len(alone) < 3_000


def test_nobody_is_anybodys_second_partner():
    rng = np.random.default_rng(2)
    times, others = (np.sort(rng.integers(0, 1000, 200)) for _ in range(2))
    partner = assign(
        times, others, np.searchsorted(others, times - 9), np.searchsorted(others, times + 9, side="right")
    )
    taken = partner[partner >= 0]
    assert len(np.unique(taken)) == len(taken) > 150 and (np.diff(taken) > 0).all()


def test_scores_within_windows_by_hand():
    reference = batch((1000, 0, 0, True), (5000, 0, 0, True), (9000, 2, 1, False), (9000, 3, 1, False))
    events = batch(
        (1300, 0, 0, True), (1100, 0, 0, True), (4000, 0, 0, True), (9000, 2, 1, True), (30_000, 3, 1, False)
    )
    result = score(events, reference, 4, 3, 100.0, within_us=(99, 100, 1000, 10**6))
    assert {window: each.f1 * 9 / 2 for window, each in result.within.items()} == pytest.approx(
        {99: 0, 100: 1, 1000: 2, 10**6: 3}
    )
    assert (result.within[1000].precision, result.within[1000].recall) == (2 / 5, 2 / 4)
    assert result.dt_bias_us == pytest.approx((100 - 1000) / 2) and result.dt_median_us == pytest.approx(550)
    told = result.as_dict()["within"]
    assert [*told] == ["99", "100", "1000", "1000000"]
    assert told["1000"] == {"precision": 2 / 5, "recall": 2 / 4, "f1": pytest.approx(4 / 9)}


def test_duplicates_do_not_inflate_precision():
    """A burst at one true event has one partner; it had precision 1."""
    result = score(at_one_pixel(*range(1000, 1010)), at_one_pixel(1004), 4, 3, 100.0)
    assert (result.strict_precision, result.strict_recall) == (1 / 10, 1) and result.dt_median_us == 0


def test_empty_sets_within_windows():
    none, some = batch(), at_one_pixel(5)
    assert score(none, none, 4, 3, 100.0, within_us=(7,)).within[7].f1 == 1
    for a, b in ((none, some), (some, none)):
        result = score(a, b, 4, 3, 100.0, within_us=(7,))
        assert (result.within[7].precision, result.within[7].recall, result.within[7].f1) == (0, 0, 0)
        assert result.dt_bias_us is None


@pytest.mark.parametrize("window", [0, -1])
def test_windows_must_hold_something(window):
    with pytest.raises(InputError, match=f"`within_us` must be at least 1 µs, got {window}"):
        score(batch(), batch(), 4, 3, 100.0, within_us=(5, window))
