"""Recordings in which nothing happened."""

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from clsim.events import EVENT_DTYPE
from clsim.events.files import open_sink, open_source
from tests.events.event_data import ENDINGS, events, write


@pytest.mark.parametrize("ending", [*ENDINGS, ".db3", ".bag"])
def test_a_file_without_events_tells_the_sensor_as_one_with_events_does(tmp_path: Path, ending: str) -> None:
    full, empty = write(tmp_path / f"full{ending}", [events(5)]), write(tmp_path / f"empty{ending}", [])
    with open_source(full) as some, open_source(empty) as none:
        assert len(some.read()) == 5 and len(none.read()) == 0
        assert (none.width, none.height) == (some.width, some.height)
        assert none.dropped_events == none.moved_events == 0


@pytest.mark.parametrize("ending", [".evt3.raw", ".raw"])
@pytest.mark.parametrize("end_us", [1_000_000, 16_777_216, 40_000_000])
def test_raw_files_tell_how_long_nothing_happened_after_the_last_event(
    tmp_path: Path, ending: str, end_us: int
) -> None:
    """By words of the upper bits of time, as Prophesee's pages have them: 12 bits of 4096 µs, or 28 of 64 µs."""
    with closing(open_sink(tmp_path / f"a{ending}", 346, 260)) as sink:
        few = np.zeros(3, EVENT_DTYPE)
        few["t"] = 10, 20, 900_000
        sink.write(few, end_us)
    body = (tmp_path / f"a{ending}").read_bytes()
    while body.startswith(b"%"):
        body = body[body.index(b"\n") + 1 :]
    if ending == ".raw":
        words = np.frombuffer(body, "<u4")
        assert int(words[words >> 28 == 8][-1] & 0xFFFFFFF) == end_us // 64
        return
    high = np.frombuffer(body, "<u2")
    high = (high[high >> 12 == 8] & 0xFFF).astype(int)
    assert np.count_nonzero(np.diff(high) < 0) * 4096 + high[-1] == end_us // 4096
