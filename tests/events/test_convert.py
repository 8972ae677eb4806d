"""Batches to and from other libraries."""

import sys

import dv_processing as dv
import numpy as np
import pytest

from clsim.errors import InputError
from clsim.events import EVENT_DTYPE
from clsim.events.convert import (
    from_event_store,
    from_numpy,
    from_pandas,
    from_torch,
    to_event_store,
    to_pandas,
    to_tonic,
    to_torch,
)
from tests.events.event_data import events

EVENTS = events(3000)


def test_numpy_arrays_of_other_libraries_become_batches():
    assert from_numpy(EVENTS) is EVENTS
    for names in (("t", "x", "y", "p"), ("ts", "x", "y", "p"), ("timestamp", "x", "y", "polarity")):
        other = np.empty(len(EVENTS), [(name, np.int64) for name in names])
        for name, ours in zip(names, ("t", "x", "y", "on"), strict=True):
            other[name] = EVENTS[ours]
        assert np.array_equal(from_numpy(other), EVENTS)
    rows = np.stack([EVENTS[name].astype(np.int64) for name in ("t", "x", "y", "on")], axis=1)
    assert np.array_equal(from_numpy(rows), EVENTS)
    rows[:, 3] = 2 * rows[:, 3] - 1
    assert np.array_equal(from_numpy(rows), EVENTS)


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros((3, 5)), r"shape \(3, 5\)"),
        (np.full((3, 4), 0.5), r"column t has 0\.5 in row 0 \(seconds\?\); expected whole"),
        (np.zeros(3, [("t", int), ("x", int), ("y", int)]), "columns are t, x, y; expected t, x, y and p"),
        (np.full((3, 4), 70000), "column x has 70000 in row 0; expected 0 to 65535"),
        (np.full((3, 4), -1), "column t has -1 in row 0"),
    ],
)
def test_arrays_that_hold_no_events_are_refused(array, message):
    with pytest.raises(InputError, match=message):
        from_numpy(array)


def test_tonic_shares_memory():
    view = to_tonic(EVENTS)
    assert np.shares_memory(view, EVENTS)
    assert view.dtype.names == ("x", "y", "t", "p")
    for theirs, ours in {"x": "x", "y": "y", "t": "t", "p": "on"}.items():
        assert np.array_equal(view[theirs], EVENTS[ours])
    assert np.array_equal(from_numpy(view), EVENTS)


def test_events_of_another_layout_are_converted_and_not_taken_for_ours():
    """Both have 13 bytes an event, so that numpy would take one for the other."""
    theirs = np.empty(len(EVENTS), [("x", "u2"), ("y", "u2"), ("t", "i8"), ("p", "?")])
    for name, ours in {"x": "x", "y": "y", "t": "t", "p": "on"}.items():
        theirs[name] = EVENTS[ours]
    for view in (to_tonic(theirs), to_tonic(to_tonic(EVENTS))):
        assert all(np.array_equal(view[name], theirs[name]) for name in theirs.dtype.names)
    assert np.array_equal(from_event_store(to_event_store(theirs)), EVENTS)


def test_lists_of_rows_are_events():
    assert from_numpy([[5, 2, 3, 1], [7, 0, 1, -1]]).tolist() == [(5, 2, 3, True), (7, 0, 1, False)]


def test_an_event_store_needs_events_in_order_of_time():
    with pytest.raises(InputError, match="events are not sorted by time"):
        to_event_store(EVENTS[::-1])


def test_pandas_there_and_back():
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    frame = to_pandas(EVENTS)
    assert isinstance(frame, pandas.DataFrame)
    assert list(frame.columns) == ["t", "x", "y", "p"]
    assert frame["t"].iloc[-1] == EVENTS["t"][-1]
    assert np.array_equal(from_pandas(frame), EVENTS)


def test_torch_there_and_back():
    torch = pytest.importorskip("torch", reason="PyTorch is not installed")
    tensors = to_torch(EVENTS)
    assert tensors["t"].dtype == torch.int64
    assert tensors["p"].dtype == torch.bool
    assert int(tensors["x"].sum()) == int(EVENTS["x"].sum())
    assert np.array_equal(from_torch(tensors), EVENTS)


@pytest.mark.parametrize("batch", [EVENTS, EVENTS[:1], EVENTS[:0]], ids=["many", "one", "none"])
def test_event_store_there_and_back(batch):
    store = to_event_store(batch)
    assert isinstance(store, dv.EventStore)
    assert store.size() == len(batch)
    assert np.array_equal(store.timestamps(), batch["t"]) or not len(batch)
    assert np.array_equal(from_event_store(store), batch)


def test_event_store_refuses_what_it_would_wrap():
    with pytest.raises(InputError, match="40000, 0 does not fit dv-processing"):
        to_event_store(np.array([(0, 40_000, 0, True)], EVENT_DTYPE))


@pytest.mark.parametrize(("convert", "module"), [(to_pandas, "pandas"), (to_torch, "torch")])
def test_a_missing_library_is_named(monkeypatch, convert, module):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InputError, match=f"needs {module}; install it with: pip install {module}"):
        convert(EVENTS)


@pytest.mark.parametrize("axis", ["x", "y"])
def test_event_store_holds_pixels_up_to_its_last(axis):
    batch = EVENTS[:2].copy()
    batch[axis] = 32766
    assert np.array_equal(from_event_store(to_event_store(batch)), batch)
    batch[axis] = 32767
    with pytest.raises(InputError, match="32767"):
        to_event_store(batch)
