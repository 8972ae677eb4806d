"""Labels of events: those of the nearer frame, at the event's pixel."""

import numpy as np

from clsim.events import EVENT_DTYPE
from clsim.frames import Frame, page_aligned, rendered_planes
from clsim.truth.labels import Labeller

NAMES = rendered_planes(truth=("labels",)).names


def frame(time_us: int, number: float, flow: tuple[float, float], valid: float = 1.0) -> Frame:
    made = Frame(page_aligned((len(NAMES), 4, 6)), NAMES, time_us)
    made.plane("Label.object")[:] = number
    made.plane("Label.object")[1, 5] = number + 10
    made.plane("Label.flow.X")[:], made.plane("Label.flow.Y")[:] = flow
    made.plane("Label.flow.valid")[:] = valid
    return made


def test_the_nearer_frame_tells() -> None:
    events = np.zeros(4, EVENT_DTYPE)
    events["t"], events["x"], events["y"] = (1_010, 1_040, 1_060, 1_100), (0, 5, 5, 2), (0, 1, 1, 3)
    labeller = Labeller()
    assert len(labeller.label(frame(1_000, 1, (2.0, 3.0)), events[:0])) == 0
    labels = labeller.label(frame(1_100, 2, (-5.0, 7.0)), events, np.array([3, 0, 1, 2], np.uint8))
    assert labels["cause"].tolist() == [3, 0, 1, 2]
    assert labels["object"].tolist() == [1, 11, 12, 2]
    assert labels["flow"].tolist() == [[2, 3], [2, 3], [-5, 7], [-5, 7]]
    events["t"] += 100
    labels = labeller.label(frame(1_200, 3, (9.0, 9.0), valid=0.0), events)
    assert labels["object"].tolist() == [2, 12, 13, 3]
    assert np.isnan(labels["flow"][2:]).all() and labels["flow"][:2].tolist() == [[-5, 7], [-5, 7]]


def test_a_frame_may_be_reused() -> None:
    labeller, shown = Labeller(), frame(0, 1, (1.0, 1.0))
    labeller.label(shown, np.zeros(0, EVENT_DTYPE))
    shown.planes[:], shown.time_us = 7.0, 100
    early = np.zeros(1, EVENT_DTYPE)
    assert labeller.label(shown, early)["object"].tolist() == [1]
