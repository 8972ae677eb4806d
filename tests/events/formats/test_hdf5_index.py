"""The index of milliseconds in DSEC's HDF5: where events of a time begin."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from clsim.datasets.load import Sequence
from clsim.errors import InputError
from clsim.events import EVENT_DTYPE
from clsim.events.formats.tables.hdf5 import index_at
from tests.events.event_data import write


@pytest.mark.parametrize("start_us", [0, 700, 1_000, 5_000_000_000])
@pytest.mark.parametrize("seed", range(3))
def test_the_first_event_of_any_time_is_found_before_in_and_behind_a_recording(
    tmp_path: Path, seed: int, start_us: int
) -> None:
    """As a search over all times finds it: at each edge of a millisecond too, and where the index ends."""
    rng = np.random.default_rng(seed)
    batch = np.zeros(40, EVENT_DTYPE)
    batch["t"] = start_us + np.sort(rng.choice([0, 1, 999, 1000, 1001, 2500, 4000, 4999, 7000 + 13 * seed], 40))
    path = write(tmp_path / "a.h5", [batch])
    last_us = int(batch["t"][-1])
    times = {start_us + k for k in range(0, 9000, 250)} | {start_us + 1000 * k + 1 for k in range(9)}
    times |= {each + step for each in batch["t"].tolist() for step in (-1, 0, 1)} | {0, last_us + 1, last_us + 10**6}
    with h5py.File(path, "r") as file, Sequence(path) as sequence:
        for time_us in sorted(each for each in times if each >= 0):
            expected = int(np.searchsorted(batch["t"], time_us))
            assert index_at(file, time_us) == expected, time_us
            assert len(sequence.events(time_us)) == len(batch) - expected, time_us


@pytest.mark.parametrize("wrong", ["zero", "late", "short", "beyond"])
def test_an_index_that_is_not_of_its_events_is_told(tmp_path: Path, wrong: str) -> None:
    """Of files that others made, cut or joined: truth and slices would begin at other events."""
    batch = np.zeros(400, EVENT_DTYPE)
    batch["t"] = np.arange(400) * 100
    path = write(tmp_path / "a.h5", [batch])
    with h5py.File(path, "r+") as file:
        marks = file["ms_to_idx"]
        if wrong == "short":
            marks[20:] = 399
        else:
            marks[...] = {"zero": 0, "late": marks[:] + 30, "beyond": marks[:] + 900}[wrong]
    with h5py.File(path, "r") as file, Sequence(path) as sequence:
        for find in (lambda: index_at(file, 25_000), lambda: sequence.events(25_000)):
            with pytest.raises(InputError, match=r"a\.h5: its ms_to_idx is not of its events"):
                find()
