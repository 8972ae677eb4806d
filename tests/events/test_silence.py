"""What sinks make of ``end_us``: the time until which there is nothing more to tell."""

import itertools
from pathlib import Path

import numpy as np
import pytest

import clsim
from clsim.errors import InputError
from clsim.events import EVENT_DTYPE, EventBatch
from clsim.events.files import open_sink
from clsim.events.formats.filesink import FileSink, FlushPolicy, Limits
from clsim.live.outputs.queue_sink import QueueSink
from tests.events.event_data import ENDINGS, HEIGHT, WIDTH, read

NOTHING = np.empty(0, EVENT_DTYPE)


def at(*times_us: int) -> np.ndarray:
    return np.array([(t, 1, 2, True) for t in times_us], EVENT_DTYPE)


@pytest.mark.parametrize("ending", ENDINGS)
def test_events_after_the_end_they_claim_are_refused(tmp_path: Path, ending: str) -> None:
    sink = open_sink(tmp_path / f"a{ending}", WIDTH, HEIGHT)
    with pytest.raises(InputError, match=r"`end_us` is 99, before the event at 100 µs"):
        sink.write(at(100), 99)
    sink.close()


class Toy(FileSink):
    """Holds little, so that each limit is near."""

    def __init__(self) -> None:
        limits = Limits("toys", size=4, end_us=1000, gap_us=100, span_us=300)
        super().__init__(Path("a.toy"), 4, 4, limits, FlushPolicy(interval_us=0))
        self.stored = NOTHING

    def _store(self, events: EventBatch) -> None:
        self.stored = np.concatenate([self.stored, events])

    def _finish(self) -> None:
        pass


def test_each_limit_is_met_exactly() -> None:
    toy = Toy()
    with pytest.raises(InputError, match="100 µs without an event are too long for toys, which bridges at most 99 µs"):
        toy.write(at(100), 100)
    toy.write(at(99), 99)
    with pytest.raises(InputError, match="100 µs without an event"):
        toy.write(at(199), 199)
    with pytest.raises(InputError, match="100 µs without an event"):
        toy.write(at(150, 250), 250)
    for t in (198, 297, 396, 398):  # a gap is from event to event, a span from the first to the last
        toy.write(at(t), t)
    with pytest.raises(InputError, match="399 µs is too late for toys that begins at 99 µs, which spans at most 299"):
        toy.write(at(399), 399)
    with pytest.raises(InputError, match="1000 µs is too late for toys, which ends at 999 µs"):
        toy.write(at(1000), 1000)
    toy.write(NOTHING, 5000)
    with pytest.raises(InputError, match="`end_us` goes back from 5000 to 4999"):
        toy.write(NOTHING, 4999)
    assert np.array_equal(toy.stored, at(99, 198, 297, 396, 398))


@pytest.mark.parametrize("ending", ENDINGS)
def test_silence_changes_no_event(tmp_path: Path, ending: str) -> None:
    sink = open_sink(tmp_path / f"a{ending}", WIDTH, HEIGHT)
    for events, end_us in (
        (NOTHING, 5),
        (at(5, 9_000), 20_000_000),
        (NOTHING, 40_000_000),
        (at(40_000_000), 90_000_000),
    ):
        sink.write(events, end_us)
    sink.close()
    assert np.array_equal(read(tmp_path / f"a{ending}"), at(5, 9_000, 40_000_000))


def test_a_flush_follows_the_events_time_and_not_the_clock(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    sink = open_sink(path, WIDTH, HEIGHT, flush=FlushPolicy(interval_us=1000))
    sizes = []
    for events, end_us in ((at(0), 999), (NOTHING, 1000), (at(1001), 1999), (at(1999), 2000), (at(2000), 2001)):
        sink.write(events, end_us)
        sizes.append(len(path.read_text().splitlines()))
    sink.close()
    assert sizes == [0, 1, 1, 3, 3] and len(path.read_text().splitlines()) == 4


@pytest.mark.parametrize("end_us", [3 * (1 << 24) + 12_345_678, 1_024, 4_096])
@pytest.mark.parametrize(("ending", "words"), [(".raw", "<u4"), (".evt3.raw", "<u2")])
def test_prophesee_files_last_as_long_as_their_recording(tmp_path: Path, ending: str, words: str, end_us: int) -> None:
    """Time words, read by hand: upper 28 bits of t in EVT2; bits 12 to 23 of t and the laps in EVT3."""
    path = tmp_path / f"a{ending}"
    sink = open_sink(path, WIDTH, HEIGHT)
    sink.write(at(1_000), 1_000)
    sink.write(NOTHING, end_us)
    sink.close()
    data = path.read_bytes()
    found = np.frombuffer(data[data.index(b"% end\n") + 6 :], words).astype(np.int64)
    if ending == ".raw":
        assert found[-1] >> 28 == 8 and found[-1] & 0xFFFFFFF == end_us >> 6
    else:
        highs = [int(word) & 0xFFF for word in found if word >> 12 == 8]
        laps = sum(after < before for before, after in itertools.pairwise(highs))
        assert laps << 24 | highs[-1] << 12 == end_us >> 12 << 12


@pytest.mark.parametrize(("ending", "end_us"), [(".raw", 1 << 34), (".evt3.raw", 1 << 40)])
def test_a_silence_beyond_the_clock_leaves_the_file_as_it_was(tmp_path: Path, ending: str, end_us: int) -> None:
    files = []
    for name, last_us in (("short", 1_000), ("long", end_us)):
        path = tmp_path / f"{name}{ending}"
        with clsim.write(path, WIDTH, HEIGHT) as out:
            out.write(at(1_000), 1_000)
            out.write(NOTHING, last_us)
        files.append(path.read_bytes())
    assert files[0] == files[1]


def test_a_queue_hands_silence_on() -> None:
    queue = QueueSink(4)
    queue.write(at(3), 10)
    queue.write(NOTHING, 20)
    (first, first_us), (second, second_us) = queue.get(0.0) or (at(), 0), queue.get(0.0) or (at(0), 0)
    assert np.array_equal(first, at(3)) and len(second) == 0 and (first_us, second_us) == (10, 20)
    assert queue.get(0.0) is None


@pytest.mark.parametrize("ending", ENDINGS)
def test_what_a_program_writes_is_read_as_one_array(tmp_path: Path, ending: str) -> None:
    for name, batches in (("full", [at(5, 6), NOTHING, at(7)]), ("empty", [NOTHING]), ("none", [])):
        path = tmp_path / f"{name}{ending}"
        with clsim.write(path, WIDTH, HEIGHT) as out:
            for k, batch in enumerate(batches):
                out.write(batch, 10 * (k + 1) - 4)
        found = clsim.open(path).read()
        assert found.dtype == EVENT_DTYPE and np.array_equal(found, np.concatenate([NOTHING, *batches]))


def test_a_writer_refuses_other_arrays_and_folders(tmp_path: Path) -> None:
    with clsim.write(tmp_path / "a.txt", WIDTH, HEIGHT) as out:
        with pytest.raises(InputError, match=r"a\.txt: events are float64 \[4\]; expected"):
            out.write(np.zeros(4), 10)
        with pytest.raises(InputError, match=r"a\.txt: events are .* \[1, 1\]; expected"):
            out.write(at(1)[None], 10)
        out.write(at(1), 1)
    assert np.array_equal(clsim.open(tmp_path / "a.txt").read(), at(1))
    with pytest.raises(InputError, match="is a folder"):
        clsim.write(tmp_path, WIDTH, HEIGHT, format="text")
