"""SIGKILL at random moments costs at most the last flush."""

import os
import random
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import dv_processing as dv
import h5py
import numpy as np
import pytest

from clsim.events.files import FORMATS, open_sink
from clsim.events.formats.filesink import FlushPolicy
from tests.events.event_data import ALL_OR_NOTHING, ENDINGS, KILL_SAFE, end_of, read
from tests.events.event_writer import numbered


def kill_a_writer(folder: Path, ending: str, batch: int, interval_us: float, delay_s: float) -> tuple[Path, int]:
    """Return the file a killed process left and how many events it had written, counted without the last write."""
    path, counter = folder / f"a{ending}", folder / f"counter{ending}"
    counter.write_bytes(bytes(8))
    arguments = [sys.executable, "-m", "tests.events.event_writer", path, counter, str(batch), str(interval_us)]
    root = Path(__file__).parents[2]
    with subprocess.Popen(arguments, cwd=root, stderr=subprocess.PIPE, text=True) as process:
        while not int.from_bytes(counter.read_bytes(), "little"):
            assert process.poll() is None, process.stderr and process.stderr.read()
            time.sleep(0.002)
        time.sleep(delay_s)
        process.kill()
        assert process.wait() == -signal.SIGKILL
    return path, int.from_bytes(counter.read_bytes(), "little")


def check(path: Path, written: int, may_lose: int) -> None:
    found = read(path)
    assert len(found) >= written - may_lose
    assert np.array_equal(found, numbered(0, len(found)))


def kill_many(folder: Path, ending: str, kills: int) -> None:
    """Kill writers in parallel: half with the default flush, half that flush at every write."""
    dice = random.Random(ending)

    def once(attempt: int, delay_s: float) -> None:
        place = folder / str(attempt)
        place.mkdir()
        batch, interval_us = ((2000, FlushPolicy().interval_us), (500, 0.0))[attempt % 2]
        path, written = kill_a_writer(place, ending, batch, interval_us, delay_s)
        check(path, written, may_lose=FlushPolicy().events if attempt % 2 == 0 else 0)
        path.unlink()

    with ThreadPoolExecutor(4) as pool:
        delays = [dice.uniform(0, 0.4) for _ in range(kills)]
        list(pool.map(once, range(kills), delays))


@pytest.mark.parametrize("ending", KILL_SAFE)
def test_a_kill_costs_at_most_the_last_flush(tmp_path, ending):
    kill_many(tmp_path, ending, kills=2)


@pytest.mark.slow
@pytest.mark.parametrize("ending", KILL_SAFE)
def test_twenty_kills_cost_at_most_the_last_flush(tmp_path, ending):
    kill_many(tmp_path, ending, kills=20)


def test_the_promise_names_exactly_the_formats_tested_here():
    keeps = {ending for each in FORMATS if "at most the last flush" in each.promise for ending in each.endings}
    assert keeps - {".csv", ".hdf5"} == set(KILL_SAFE)


def test_the_fields_own_readers_open_what_a_kill_left(tmp_path):
    path, written = kill_a_writer(tmp_path, ".aedat4", 500, 0.0, 0.1)
    recording = dv.io.MonoCameraRecording(str(path))
    found = 0
    while (batch := recording.getNextEventBatch()) is not None:
        found += batch.size()
    assert found >= written
    path, written = kill_a_writer(tmp_path, ".h5", 500, 0.0, 0.1)
    with h5py.File(path) as file:
        assert np.array_equal(file["events/t"][:written], numbered(0, written)["t"])


@pytest.mark.parametrize("ending", [each for each in ALL_OR_NOTHING if each in ENDINGS])
def test_what_is_all_or_nothing_leaves_no_file_under_its_name(tmp_path, ending):
    path, _ = kill_a_writer(tmp_path, ending, 2000, 0.05, 0.1)
    assert not path.exists()


@pytest.mark.parametrize("ending", [each for each in ALL_OR_NOTHING if each in ENDINGS])
def test_the_next_writer_of_a_name_removes_what_killed_ones_left(tmp_path, ending):
    path, _ = kill_a_writer(tmp_path, ending, 2000, 0.05, 0.1)
    left = {entry for entry in tmp_path.iterdir() if entry.name.startswith(f".a{ending}.")}
    assert left
    (some,) = {entry for entry in left if entry.suffix == ".part"}
    dead, host = (
        some.name.split(".")[-2],
        some.name.removeprefix(f".a{ending}.").rpartition(f".{some.name.split('.')[-2]}.")[0],
    )
    alive = tmp_path / f".a{ending}.{host}.{os.getppid()}.part"
    others = [
        tmp_path / name
        for name in (
            f".b{ending}.{host}.{dead}.part",
            f".a{ending}.elsewhere.{dead}.part",
            f".a{ending}.{host}.part",
            f".a{ending}",
        )
    ]
    for file in (alive, *others):
        file.write_text("not ours to remove")
    folder = tmp_path / f".a{ending}.{host}.99999999.part"
    folder.mkdir()
    sink = open_sink(path, 346, 260)
    sink.write(numbered(0, 10), end_of(numbered(0, 10)))
    sink.close()
    assert np.array_equal(read(path), numbered(0, 10))
    assert not any(entry.exists() for entry in left)
    assert all(entry.exists() for entry in (alive, folder, *others))
