"""Whatever write of a flush is the last before a kill, the file is whole."""

import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from clsim.events import EVENT_DTYPE
from clsim.events.formats.filesink import FlushPolicy
from clsim.events.formats.tables import hdf5, hdf5_growing
from tests.events.event_data import end_of


@pytest.mark.parametrize("flushes", [3, pytest.param(10, marks=pytest.mark.slow)])
def test_every_prefix_of_the_writes_is_a_file_of_whole_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, flushes: int
) -> None:
    whole = hdf5_growing._Medium._put
    path, copy = tmp_path / "a.h5", tmp_path / "copy.h5"
    flushed, rows = 0, []

    def put(medium: hdf5_growing._Medium, offset: int, data: bytes) -> None:
        whole(medium, offset, data)
        if medium._waiting is None:
            return
        shutil.copy(path, copy)
        with h5py.File(copy, "r") as file:
            t = np.minimum.reduce([len(file["events"][name]) for name in "txyp"])
            assert (file["events/t"][:t] == np.arange(t)).all()
            assert (file["events/x"][:t] == np.arange(t) % 640).all()
            assert t >= flushed
            rows.append(int(t))

    monkeypatch.setattr(hdf5_growing._Medium, "_put", put)
    sink = hdf5.open_sink(path, 640, 480, FlushPolicy(20_000, 0.0))
    for k in range(0, 20_000 * flushes, 20_000):
        batch = np.zeros(20_000, EVENT_DTYPE)
        batch["t"] = np.arange(k, k + 20_000)
        batch["x"] = batch["t"] % 640
        sink.write(batch, end_of(batch))
        flushed = k + 20_000
    sink.close()
    assert rows[-1] == 20_000 * flushes and len(set(rows)) >= flushes


def test_later_writes_cover_earlier_ones() -> None:
    pieces = [(10, b"aaaa"), (12, b"bb"), (30, b"c"), (8, b"ddd"), (30, b"e")]
    assert hdf5_growing._merged(pieces) == [(8, b"dddabb"), (30, b"e")]
