"""Real recordings, which lie beside the checkout where there are any."""

from pathlib import Path

import pytest

import clsim
from clsim.events import EventBatch

REAL = Path(__file__).resolve().parents[4] / "shared" / "real"
WALL = (78, 240)
"""Width and height of the part of the DVXplorer's picture that shows a still wall."""


def still_wall() -> EventBatch:
    """Return the events of that part; the test is skipped where the recording is not there."""
    recording = REAL / "sample-320x240.aedat4"
    if not recording.exists():
        pytest.skip(f"{recording} is not there")
    events = clsim.open(recording).read()
    return events[events["x"] < WALL[0]]
