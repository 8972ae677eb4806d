"""The whole line into the field's own receivers: what ``clsim live`` sends arrives event for event."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from clsim.events.files import open_source
from tests.events.sockets.socket_help import AESTREAM, free_port, is_bound, wait_until

WIDTH, HEIGHT = 64, 48
RUN = ("live", "cornell", "--resolution", f"{WIDTH}x{HEIGHT}", "--frame-count", "8", "--fps", "10")


def run_clsim(*arguments: object) -> None:
    outcome = subprocess.run(
        [sys.executable, "-m", "clsim", *map(str, arguments)], capture_output=True, text=True, timeout=120
    )
    assert outcome.returncode == 0, outcome.stderr


def sent(path: Path) -> np.ndarray:
    """Return the same run's events as a file has them."""
    events = np.concatenate(list(open_source(path)))
    assert len(events) > 500
    return events


@pytest.mark.slow
def test_the_faery_command_receives_a_run(tmp_path: Path) -> None:
    port, path = free_port(), tmp_path / "got.csv"
    command = f"-m faery input udp --dimensions {WIDTH}x{HEIGHT} 127.0.0.1:{port} output file {path}"
    filler = tmp_path / "filler.txt"
    filler.write_text("".join(f"{t} 1 2 1\n" for t in range(10_000_000, 10_002_000)))
    with subprocess.Popen([sys.executable, *command.split()], stderr=subprocess.DEVNULL) as faery:
        try:
            wait_until(lambda: is_bound(port), 60)
            run_clsim(*RUN, "--out", f"udp://127.0.0.1:{port}", "--out", tmp_path / "same.aedat4")
            rows = "".join(f"{t},{x},{y},{on:d}\r\n" for t, x, y, on in sent(tmp_path / "same.aedat4").tolist())
            expected = f"t,x@{WIDTH},y@{HEIGHT},on\r\n{rows}".encode()
            # faery holds back up to 8 kB of text: later events push it out.
            run_clsim("convert", filler, f"udp://127.0.0.1:{port}", "--resolution", f"{WIDTH}x{HEIGHT}")
            wait_until(lambda: path.exists() and path.stat().st_size >= len(expected), 30)
        finally:
            faery.kill()
    assert path.read_bytes()[: len(expected)] == expected


def test_aestream_receives_a_run(tmp_path: Path) -> None:
    pytest.importorskip("aestream", reason="AEStream's Python package has no wheel for every Python")
    run_clsim(*RUN, "--out", tmp_path / "same.aedat4")
    events, port = sent(tmp_path / "same.aedat4"), free_port()
    arguments = [str(argument) for argument in (WIDTH, HEIGHT, port, len(events), tmp_path / "image.npy")]
    with subprocess.Popen([sys.executable, "-c", AESTREAM, *arguments]) as aestream:
        try:
            wait_until(lambda: is_bound(port), 60)
            run_clsim(*RUN, "--out", f"udp://127.0.0.1:{port}?format=spif")
            assert aestream.wait(90) == 0
        finally:
            aestream.kill()
    expected = np.zeros((WIDTH, HEIGHT))
    np.add.at(expected, (events["x"], events["y"]), 1)  # AEStream counts events of both polarities
    np.testing.assert_array_equal(np.load(tmp_path / "image.npy"), expected)


NETWORK_READER = """
import os, sys, time
import numpy as np
import dv_processing as dv

print("ready", flush=True)
reader = None
while reader is None:
    try:
        reader = dv.io.NetworkReader("127.0.0.1", int(sys.argv[1]))
    except RuntimeError:
        time.sleep(0.005)
parts, end = [], time.monotonic() + 60
while time.monotonic() < end:
    store = reader.getNextEventBatch()
    if store is not None:
        parts.append(store.numpy())
    elif not reader.isRunning():
        break
    else:
        time.sleep(0.002)
np.save(sys.argv[2], np.concatenate(parts))
os._exit(0)  # all is saved, and the reader's own thread still runs: nothing is torn down beneath it
"""


@pytest.mark.slow
def test_dv_processings_network_reader_receives_a_run(tmp_path: Path) -> None:
    """By the clock, the first events come half a second after the port opens: time for the reader to connect."""
    port = free_port()
    with subprocess.Popen(
        [sys.executable, "-c", NETWORK_READER, str(port), str(tmp_path / "got.npy")], stdout=subprocess.PIPE
    ) as reader:
        try:
            assert reader.stdout is not None and reader.stdout.readline() == b"ready\n"
            run_clsim(
                *RUN[:-1], "2", "--pace", "real", "--out", f"tcp://127.0.0.1:{port}", "--out", tmp_path / "same.aedat4"
            )
            assert reader.wait(60) == 0
        finally:
            reader.kill()
    got, events = np.load(tmp_path / "got.npy"), sent(tmp_path / "same.aedat4")
    for theirs, ours in (("timestamp", "t"), ("x", "x"), ("y", "y"), ("polarity", "on")):
        np.testing.assert_array_equal(got[theirs], events[ours])
