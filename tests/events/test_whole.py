"""A conversion that ends early leaves the file that stood under its target's name, and nothing else."""

import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from clsim.errors import InputError
from clsim.events import SinkError
from clsim.events.copy import Copied, convert_events
from clsim.events.files import open_sink
from clsim.events.outputs import FileOptions, open_outputs
from clsim.events.socket_sinks import open_socket_sink
from tests.events.event_data import ENDINGS, HEIGHT, WIDTH, end_of, events, read

OLD = b"of great value"
EVENTS = events(100_000)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("source") / "a.dat"
    sink = open_sink(path, WIDTH, HEIGHT)
    sink.write(EVENTS, end_of(EVENTS))
    sink.close()
    return str(path)


def interrupt(_: Copied) -> None:
    raise KeyboardInterrupt


@pytest.mark.parametrize("old", [False, True])
@pytest.mark.parametrize("ending", ENDINGS)
def test_an_interrupt_leaves_what_was_there(tmp_path: Path, source: str, ending: str, old: bool) -> None:
    target = tmp_path / f"b{ending}"
    if old:
        target.write_bytes(OLD)
    with pytest.raises(KeyboardInterrupt):
        convert_events(source, str(target), progress=interrupt)
    assert os.listdir(tmp_path) == ([target.name] if old else []) and (not old or target.read_bytes() == OLD)


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_link_stays_and_what_it_points_at_is_replaced_at_the_end(tmp_path: Path, source: str, ending: str) -> None:
    (tmp_path / "far").mkdir()
    real, link = tmp_path / "far" / f"real{ending}", tmp_path / f"b{ending}"
    link.symlink_to(real)
    for before in (None, OLD):
        if before is not None:
            real.write_bytes(before)
        with pytest.raises(KeyboardInterrupt):
            convert_events(source, str(link), progress=interrupt)
        assert link.readlink() == real and (real.read_bytes() if real.exists() else None) == before
        convert_events(source, str(link))
        assert link.readlink() == real and np.array_equal(read(real), EVENTS)
        assert os.listdir(tmp_path / "far") == [real.name]


# In a process of its own, because the limit on the size of files stays.
FULL = textwrap.dedent(
    """
    import resource, sys
    from clsim.events import SinkError
    from clsim.events.copy import convert_events

    resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
    try:
        convert_events(*sys.argv[1:])
    except SinkError as error:
        print(error)
    """
)


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_full_disk_leaves_what_was_there(tmp_path: Path, source: str, ending: str) -> None:
    target = tmp_path / f"b{ending}"
    target.write_bytes(OLD)
    done = subprocess.run([sys.executable, "-c", FULL, source, target], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(f"{target}: writing failed (") and ".part" not in done.stdout
    assert os.listdir(tmp_path) == [target.name] and target.read_bytes() == OLD


def test_events_that_the_target_cannot_hold_leave_what_was_there(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("1 2 3 1\n5000000000 2 3 1\n")
    target = tmp_path / "b.dat"
    target.write_bytes(OLD)
    with pytest.raises(InputError, match=rf"^{target}: event time 5000000000 µs is too late for DAT"):
        convert_events(str(tmp_path / "a.txt"), str(target))
    assert sorted(os.listdir(tmp_path)) == ["a.txt", "b.dat"] and target.read_bytes() == OLD


# A sink that waits after its first events, for the kill.
SLOW = textwrap.dedent(
    """
    import sys, time
    from clsim.events.copy import convert_events

    def wait(copied):
        print("now", flush=True)
        time.sleep(60)

    convert_events(*sys.argv[1:], progress=wait)
    """
)


def test_a_kill_leaves_what_was_there_and_the_next_attempt_cleans_up(tmp_path: Path, source: str) -> None:
    target = tmp_path / "b.csv"
    target.write_bytes(OLD)
    with subprocess.Popen([sys.executable, "-c", SLOW, source, target], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stdout.readline() == b"now\n"
        process.kill()
        assert process.wait() == -signal.SIGKILL
    assert target.read_bytes() == OLD and len(os.listdir(tmp_path)) == 2
    convert_events(source, str(target))
    assert target.read_bytes().startswith(b"t,x,y,p\n") and np.array_equal(read(target), EVENTS)
    assert sorted(os.listdir(tmp_path)) == ["b.csv", "b.csv.json"]


@pytest.mark.parametrize(("format", "error"), [("text", SinkError), ("dat", InputError), ("npz", InputError)])
def test_what_is_no_file_is_written_in_place_and_never_removed(
    tmp_path: Path, source: str, format: str, error: type[Exception]
) -> None:
    link = tmp_path / "full"
    link.symlink_to("/dev/full")
    with pytest.raises(error, match=f"{link}: .*(No space left|only one can be)"):
        convert_events(source, str(link), files=FileOptions(format))
    assert link.readlink() == Path("/dev/full") and not Path("/dev/full").is_file()


def test_an_output_that_cannot_be_opened_leaves_a_link_to_no_file(tmp_path: Path) -> None:
    link = tmp_path / "a.txt"
    link.symlink_to(tmp_path / "later.txt")
    (tmp_path / "full.dat").symlink_to("/dev/full")
    with pytest.raises(InputError, match="No space left"):
        open_outputs([str(link), str(tmp_path / "full.dat")], 4, 4, FileOptions())
    assert link.is_symlink() and not link.exists()


def test_what_was_recorded_of_a_stream_stays_when_the_disk_is_full(tmp_path: Path) -> None:
    server = open_socket_sink(f"unix://{tmp_path}/events.sock", WIDTH, HEIGHT)
    target = tmp_path / "b.dat"
    command = [sys.executable, "-c", FULL, f"unix://{tmp_path}/events.sock", target]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as recorder:
        stop = threading.Event()

        def serve() -> None:
            server.wait_for_clients(1, 60)
            for start in range(0, len(EVENTS), 5000):
                if stop.is_set():
                    return
                part = EVENTS[start : start + 5000]
                server.write(part, end_of(part))
                time.sleep(0.005)

        thread = threading.Thread(target=serve)
        thread.start()
        told, _ = recorder.communicate(timeout=60)
        stop.set()
        thread.join(20)
    server.close()
    assert told.startswith(f"{target}: writing failed (")
    found = read(target)
    assert len(found) > 5000 and np.array_equal(found, EVENTS[: len(found)])
