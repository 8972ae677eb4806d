"""Recordings in which nothing happened."""

from pathlib import Path

import pytest

from clsim.events.files import open_source
from tests.events.event_data import ENDINGS, events, write


@pytest.mark.parametrize("ending", [*ENDINGS, ".db3", ".bag"])
def test_a_file_without_events_tells_the_sensor_as_one_with_events_does(tmp_path: Path, ending: str) -> None:
    full, empty = write(tmp_path / f"full{ending}", [events(5)]), write(tmp_path / f"empty{ending}", [])
    with open_source(full) as some, open_source(empty) as none:
        assert len(some.read()) == 5 and len(none.read()) == 0
        assert (none.width, none.height) == (some.width, some.height)
        assert none.dropped_events == none.moved_events == 0
