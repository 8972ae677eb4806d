"""Scenes by chance have the events that they had: a change that is meant to change nothing changes nothing.

Whether these events are right is what all other tests of rendering ask. These see what is wrong in a corner that no
closed form reaches.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from tests.laws.as_before import ASKED, EVENTS, OWN_KERNELS, events_of

FEW_US = 2
"""By how much a time may differ: processors round differently, and what they round decides few events."""


def found_again(events: npt.NDArray[np.void], before: npt.NDArray[np.void]) -> int:
    """Return how many of the events before have a partner: at the same pixel, of the same sign, as many-eth there."""

    def in_order(these: npt.NDArray[np.void]) -> dict[tuple[int, int, bool], list[int]]:
        times: dict[tuple[int, int, bool], list[int]] = {}
        for x, y, on, t in zip(*(these[key].tolist() for key in ("x", "y", "on", "t")), strict=True):
            times.setdefault((x, y, on), []).append(t)
        return times

    now = in_order(events)
    return sum(
        abs(first - second) <= FEW_US
        for where, times in in_order(before).items()
        for first, second in zip(times, now.get(where, []), strict=False)
    )


@pytest.mark.parametrize(
    "name",
    [pytest.param(each, marks=pytest.mark.slow if each.startswith(OWN_KERNELS) else ()) for each in sorted(ASKED)],
)
def test_a_scene_has_the_events_that_it_had(tmp_path: Path, name: str) -> None:
    """All but one in fifty at least, and no more of them."""
    before, events = np.load(EVENTS)[name], events_of(name, tmp_path)
    assert len(before) > 50
    assert len(events) == pytest.approx(len(before), rel=0.02)
    assert found_again(events, before) >= 0.98 * len(before)
