"""Events out of order: one rule for all formats."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from clsim.errors import InputError
from clsim.events import EVENT_DTYPE, EventBatch
from clsim.events.files import open_source
from clsim.events.formats.dv_stream import AEDAT4_MAGIC, DvEncoder
from clsim.events.formats.order import WINDOW_US, Order
from tests.events.event_data import HEIGHT, WIDTH, events

CASES = Path(__file__).parents[4] / "shared" / "cases"


def batch(*times_us: int) -> EventBatch:
    found = np.zeros(len(times_us), EVENT_DTYPE)
    found["t"], found["x"] = times_us, np.arange(len(times_us))
    return found


def ordered(*batches: EventBatch) -> tuple[list[int], int, int]:
    order = Order(Path("a"))
    times = [t for part in order.of(batches) for t in part["t"].tolist()]
    return times, order.moved_events, order.late_events


def test_overlapping_packets_are_merged_and_what_moved_is_counted() -> None:
    assert ordered(batch(10, 20, 30), batch(15, 25, 40)) == ([10, 15, 20, 25, 30, 40], 2, 0)


def test_packets_in_the_wrong_order_are_put_right() -> None:
    first, second = np.arange(0, 10_000), np.arange(10_000, 20_000)
    times, moved, late = ordered(batch(*second), batch(*first))
    assert times == list(range(20_000)) and (moved, late) == (10_000, 0)


@pytest.mark.parametrize("wrong_us", [3, 10**9, 10**15])
@pytest.mark.parametrize("at", [10, 25_000, 49_000])
def test_one_wrong_time_goes_whether_behind_or_ahead(wrong_us: int, at: int) -> None:
    """A wrong time ahead must not take all that follows with it."""
    times = np.arange(1_000_000, 1_000_000 + 50_000 * 20, 20)
    times[at] = wrong_us
    found, moved, late = ordered(*np.split(batch(*times), 50))
    assert found == np.delete(times, at).tolist() and (moved, late) == (0, 1)


def test_what_is_as_late_as_may_be_is_kept_beside_what_is_later() -> None:
    late = 300_000
    assert ordered(batch(late, late + 10_000, late + 10_000 - WINDOW_US, 0, late + 20_000)) == (
        [late + 10_000 - WINDOW_US, late, late + 10_000, late + 20_000], 1, 1
    )  # fmt: skip


@pytest.mark.parametrize("at", [1, 7_000, 10_000, 12_345, 29_999])
def test_a_strict_reader_names_the_event_that_comes_too_early_by_its_number_in_the_file(at: int) -> None:
    times = np.arange(1000, 31_000)
    times[at] = times[at - 1] - 1
    with pytest.raises(InputError, match=f"^a: event {at} has time {times[at]} µs, before {times[at - 1]} µs;"):
        list(Order(Path("a"), strict=True).of(np.split(batch(*times), 3)))


def test_equal_times_stay_as_they_came() -> None:
    order = Order(Path("a"))
    (found,) = order.of([batch(5, 7, 7, 6, 7)])
    assert found["x"].tolist() == [0, 3, 1, 2, 4]


@settings(deadline=None)
@given(st.lists(st.lists(st.integers(0, 4 * WINDOW_US), max_size=30), max_size=20), st.integers(1, 40))
def test_any_times_come_out_in_order_and_none_is_lost_without_a_count(times: list[list[int]], hold: int) -> None:
    found, moved, late = ordered(*(batch(*part) for part in times))
    came = [t for part in times for t in part]
    assert found == sorted(found) and len(found) + late == len(came) and moved <= len(came)
    left = list(came)
    for t in found:
        left.remove(t)
    if max(came, default=0) - min(came, default=0) <= WINDOW_US:
        assert late == 0 and found == sorted(came)


def test_a_long_recording_is_sorted_within_its_window_in_bounded_memory() -> None:
    rng = np.random.default_rng(0)
    whole = events(200_000)
    jittered = whole[np.argsort(whole["t"] + rng.integers(0, WINDOW_US // 2, len(whole)), kind="stable")]
    order = Order(Path("a"))
    parts: Iterator[EventBatch] = order.of(np.array_split(jittered, 100))
    first = next(parts)
    assert len(first) < 20_000  # it does not wait for the end
    assert np.array_equal(np.concatenate([first, *parts])["t"], whole["t"]) and order.late_events == 0


def test_events_before_damage_are_delivered() -> None:
    def source() -> Iterator[EventBatch]:
        yield batch(1, 2)
        yield batch(3)
        raise ValueError("torn")

    parts = Order(Path("a")).of(source())
    assert next(parts)["t"].tolist() == [1, 2, 3]
    with pytest.raises(ValueError, match="torn"):
        next(parts)


SHUFFLED = events(3000, span_us=50_000)
SHUFFLED[[100, 101, 2000]] = SHUFFLED[[2000, 100, 101]]


def unsorted(path: Path) -> None:
    """Write events out of order, which our own sinks refuse."""
    t, x, y, on = (SHUFFLED[name].astype(np.int64) for name in ("t", "x", "y", "on"))
    if path.suffix == ".dat":
        words = np.stack([t, x | y << 14 | on << 28], axis=1).astype("<u4")
        path.write_bytes(
            f"% Version 2\n% Height {HEIGHT}\n% Width {WIDTH}\n".encode() + bytes([12, 8]) + words.tobytes()
        )
    elif path.suffix == ".npy":
        np.save(path, SHUFFLED)
    elif path.suffix == ".npz":
        np.savez(path, t=t, x=x, y=y, p=on)
    elif path.suffix == ".csv":
        path.write_text("t,x,y,p\n" + "\n".join(f"{a},{b},{c},{d}" for a, b, c, d in zip(t, x, y, on, strict=True)))
    elif path.suffix == ".raw":
        words = np.stack([0x80000000 | t >> 6, on << 28 | (t & 63) << 22 | x << 11 | y], axis=1).astype("<u4")
        path.write_bytes(f"% evt 2.0\n% geometry {WIDTH}x{HEIGHT}\n% end\n".encode() + words.tobytes())
    elif path.suffix == ".h5":
        import h5py

        with h5py.File(path, "w") as file:
            for name, column in zip("txyp", (t, x, y, on), strict=True):
                file[f"events/{name}"] = column
    else:
        encoder = DvEncoder(WIDTH, HEIGHT)
        packets = b"".join(packet for part in np.split(SHUFFLED, 3) for packet, _ in encoder.packets(part))
        path.write_bytes(AEDAT4_MAGIC + encoder.header + packets)


@pytest.mark.parametrize("ending", [".aedat4", ".dat", ".raw", ".npy", ".npz", ".csv", ".h5"])
def test_every_format_follows_the_rule(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"a{ending}"
    unsorted(path)
    source = open_source(path)
    found = source.read()
    assert np.array_equal(found["t"], np.sort(SHUFFLED["t"])) and source.moved_events > 0
    assert source.dropped_events == 0
    assert sorted(found.tolist()) == sorted(SHUFFLED.tolist())
    with pytest.raises(InputError, match=r"event \d+ has time \d+ µs, before \d+ µs; expected rising times"):
        open_source(path, strict=True).read()


@pytest.mark.skipif(not CASES.is_dir(), reason="the shared cases are not beside the checkout")
def test_a_bag_with_one_wrong_time_loses_that_alone() -> None:
    pytest.importorskip("rosbags")
    source = open_source(CASES / "nonmono.bag")
    assert len(source.read()) == 4999 and source.dropped_events == 1
    with pytest.raises(InputError, match="event 2500 has time"):
        open_source(CASES / "nonmono.bag", strict=True).read()
