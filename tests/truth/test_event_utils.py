"""event_utils' layout: what its readers find, and what a full disk leaves."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from clsim.events import SinkError
from clsim.truth.formats.event_utils import EventUtilsLayout
from clsim.truth.layouts import open_layout
from clsim.truth.recording import read_recording
from clsim.truth.writing.growing_npy import GrowingNpy
from tests.truth import recordings


def test_it_holds_what_its_readers_ask_for(tmp_path: Path) -> None:
    """By h5py and numpy alone: its loaders want torch, and are no package."""
    layout = open_layout(str(tmp_path / "run.event_utils"), recordings.about())
    expected = recordings.feed(layout, close=False)
    kept = {file.stem: np.load(file, mmap_mode="r") for file in (tmp_path / "run.event_utils/memmap").glob("*.npy")}
    layout.close()
    e, shots = expected.events, expected.shots
    with h5py.File(tmp_path / "run.event_utils/run.h5") as file:
        columns = {name: file[f"events/{name}"][:] for name in ("xs", "ys", "ts", "ps")}
        assert columns["ts"].dtype == np.float64 and columns["ps"].dtype == np.bool_
        assert np.array_equal(np.rint(columns["ts"] * 1e6), e["t"]) and np.array_equal(columns["ps"], e["on"])
        assert np.array_equal(columns["xs"], e["x"]) and np.array_equal(columns["ys"], e["y"])
        told = dict(file.attrs)
        counts = [told[name] for name in ("num_events", "num_pos", "num_neg", "num_imgs", "num_flow")]
        assert counts == [len(e), e["on"].sum(), (~e["on"]).sum(), len(shots), len(shots)]
        assert list(told["sensor_resolution"]) == [recordings.HEIGHT, recordings.WIDTH]
        assert [told["t0"], told["tk"]] == [columns["ts"][0], columns["ts"][-1]]
        assert told["duration"] == told["tk"] - told["t0"]
        for k, shot in enumerate(shots):
            image, flow = file[f"images/image{k:09d}"], file[f"flow/flow{k:09d}"]
            assert image.dtype == np.uint8 and np.array_equal(image[:], shot.planes["image"])
            assert image.attrs["timestamp"] == flow.attrs["timestamp"] == shot.time_us * 1e-6
            # As its own packager has it: the last event before the image, by a search in the file's times.
            before = np.searchsorted(columns["ts"], image.attrs["timestamp"]) - 1
            assert image.attrs["event_idx"] == max(before, 0) and list(image.attrs["size"]) == list(image.shape)
            known = shot.planes["flow"][..., 2] > 0
            speed = np.where(known[..., None], shot.planes["flow"][..., :2], 0) / (recordings.STEP_US * 1e-6)
            assert flow.shape == (2, recordings.HEIGHT, recordings.WIDTH) and flow.dtype == np.float32
            np.testing.assert_allclose(flow[:], np.moveaxis(speed, 2, 0), rtol=1e-6)
            assert np.array_equal(kept["images"][k, :, :, 0], image) and np.array_equal(kept["optic_flow"][k], flow)
    for name in ("timestamps", "optic_flow_timestamps", "optic_flow_stamps"):
        assert np.array_equal(kept[name][:, 0], [shot.time_us * 1e-6 for shot in shots]), name
    assert np.array_equal(kept["t"][:, 0], columns["ts"]) and np.array_equal(kept["p"][:, 0], columns["ps"])
    assert np.array_equal(kept["xy"], np.stack([columns["xs"], columns["ys"]], axis=1))
    assert kept["timestamps"].shape == (len(shots), 1) and "metadata.json" in os.listdir(
        tmp_path / "run.event_utils/memmap"
    )


def test_the_memmap_alone_is_kept_where_the_disk_is_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(layout: object, file: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(EventUtilsLayout, "_write_frames", full)
    layout = open_layout(str(tmp_path / "run.event_utils"), recordings.about())
    expected = recordings.feed(layout, close=False)
    with pytest.raises(SinkError, match=r"run\.event_utils: writing failed \(No space left on device\)"):
        layout.close()
    assert os.listdir(tmp_path / "run.event_utils") == ["memmap"]
    assert len(np.load(tmp_path / "run.event_utils/memmap/t.npy")) == len(expected.events)


def test_events_at_a_frames_time_come_after_it_however_seconds_are_rounded(tmp_path: Path) -> None:
    expected = recordings.feed(open_layout(str(tmp_path / "run.event_utils"), recordings.about()))
    times_us = expected.events["t"].copy()
    times_us[expected.shots[1].event_index] = expected.shots[1].time_us  # one at a frame's very time
    with h5py.File(tmp_path / "run.event_utils/run.h5", "r+") as file:
        file["events/ts"][...] = times_us * 1e-6 - 4e-7
    found = read_recording(str(tmp_path / "run.event_utils"))
    assert np.array_equal(np.concatenate(list(found.events()))["t"], times_us)
    for shot in found.shots():
        assert shot.event_index == np.count_nonzero(times_us < shot.time_us)


def test_rows_that_the_system_takes_in_portions_are_whole(tmp_path: Path) -> None:
    """A write may end early, for one where a disk is nearly full or a file is over the net."""

    class Hesitant:
        def __init__(self, file: Any) -> None:
            self._file = file

        def write(self, data: memoryview) -> int:
            written: int = self._file.write(data[:7])
            return written

        def __getattr__(self, name: str) -> Any:
            return getattr(self._file, name)

    array = GrowingNpy(tmp_path / "a.npy", (3,), "<f8")
    array._file = Hesitant(array._file)  # type: ignore[assignment]
    rows = np.arange(15.0).reshape(5, 3)
    array.append(rows[:2])
    array.append(rows[2:])
    array.close()
    assert np.array_equal(np.load(tmp_path / "a.npy"), rows)
