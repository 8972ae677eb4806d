"""Standard output: text by default, a raw AEDAT4 stream on request, and a reader that leaves."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
from pathlib import Path

import dv_processing as dv
import numpy as np

from tests.events.sockets.socket_help import make_events

WRITER = f"""
import sys
sys.path.insert(0, {str(Path(__file__).parents[2])!r})
from tests.events.sockets.socket_help import WIDTH, HEIGHT, make_events
from clsim.errors import InputError
from clsim.events import SinkError
from clsim.events.socket_sinks import open_socket_sink

try:
    sink = open_socket_sink(sys.argv[1], WIDTH, HEIGHT)
    for _ in range(int(sys.argv[3])):
        batch = make_events(int(sys.argv[2]))
        sink.write(batch, int(batch["t"][-1]))
    sink.close()
except (InputError, SinkError) as error:
    sys.stderr.write(f"{{type(error).__name__}}: {{error}}")
    sys.exit(3)
"""


def run_writer(url: str, count: int) -> bytes:
    command = [sys.executable, "-c", WRITER, url, str(count), "1"]
    return subprocess.run(command, stdout=subprocess.PIPE, check=True, timeout=60).stdout


def test_text() -> None:
    lines = run_writer("-", 1000).decode().splitlines()
    assert lines == [f"{t} {x} {y} {on:d}" for t, x, y, on in make_events(1000).tolist()]


def test_aedat4_in_a_pipe_is_an_aedat4_file(tmp_path: Path) -> None:
    path = tmp_path / "piped.aedat4"
    path.write_bytes(run_writer("-?format=aedat4", 100_000))
    recording, parts = dv.io.MonoCameraRecording(str(path)), []
    while (store := recording.getNextEventBatch()) is not None:
        parts.append(store.numpy())
    got, expected = np.concatenate(parts), make_events(100_000)
    for theirs, ours in (("timestamp", "t"), ("x", "x"), ("y", "y"), ("polarity", "on")):
        np.testing.assert_array_equal(got[theirs], expected[ours])


def test_reader_that_leaves_is_one_sentence() -> None:
    command = [sys.executable, "-c", WRITER, "-", "70000", "100"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as writer:
        assert writer.stdout is not None and writer.stderr is not None
        writer.stdout.readline()
        writer.stdout.close()
        assert writer.stderr.read() == "SinkError: standard output: writing failed (Broken pipe)"
        assert writer.wait(60) == 3


def test_binary_spares_the_terminal() -> None:
    ours, theirs = pty.openpty()
    try:
        command = [sys.executable, "-c", WRITER, "-?format=aedat4", "10", "1"]
        ended = subprocess.run(command, stdout=theirs, stderr=subprocess.PIPE, text=True, timeout=60)
    finally:
        os.close(ours)
        os.close(theirs)
    assert ended.returncode == 3
    assert ended.stderr.startswith("InputError: -?format=aedat4: standard output is a terminal")
