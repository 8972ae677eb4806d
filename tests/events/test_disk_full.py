"""A medium that fails: one clear error, other sinks go on, what was flushed stays readable."""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import textwrap
from pathlib import Path

import numpy as np
import pytest

from clsim.errors import InputError
from clsim.events.batch import SinkError
from clsim.events.files import open_sink
from clsim.events.formats.filesink import FlushPolicy
from tests.events.event_data import ALL_OR_NOTHING, ENDINGS, HEIGHT, WIDTH, end_of, events, read
from tests.events.event_writer import numbered

ROOT = str(Path(__file__).parents[2])
# In a process of its own, because the limit on the size of files stays. HDF5 alone would crash here.
WRITER = textwrap.dedent(
    """
    import resource, sys
    from tests.events.event_writer import numbered
    from clsim.events.batch import SinkError
    from clsim.events.files import open_sink
    from clsim.events.formats.filesink import FlushPolicy

    first, second = (open_sink(path, 346, 260, flush=FlushPolicy(interval_us=0)) for path in sys.argv[1:3])
    resource.setrlimit(resource.RLIMIT_FSIZE, (1_500_000, 1_500_000))
    failed = False
    for start in range(0, 1_200_000, 4000):
        second.write(numbered(start // 1000, start // 1000 + 4), 2 * (start // 1000) + 8)
        if not failed:
            try:
                first.write(numbered(start, start + 4000), 2 * start + 8000)
            except SinkError as error:
                failed = True
                print(error)
    try:
        first.close()
    except SinkError as error:
        print(error)
    second.close()
    """
)


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_full_disk_is_one_error_and_other_sinks_go_on(tmp_path, ending):
    path, other = tmp_path / f"a{ending}", tmp_path / "other.dat"
    done = subprocess.run(
        [sys.executable, "-c", WRITER, path, other],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": ROOT},
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert re.fullmatch(re.escape(f"{path}: writing failed (") + ".*(File too large|disk I/O error)\\)\n", done.stdout)
    assert np.array_equal(read(other), numbered(0, 1200))
    if ending in ALL_OR_NOTHING:
        assert list(tmp_path.iterdir()) == [other]
        return
    found = read(path)
    assert len(found) >= 50_000
    assert len(found) % 4000 == 0
    assert np.array_equal(found, numbered(0, len(found)))


@pytest.mark.parametrize("format", ["aedat4", "evt2", "evt3", "dat", "es"])
def test_a_disk_full_from_the_start_is_refused_at_open(format):
    with pytest.raises(InputError, match=r"/dev/full: cannot be written \(No space left on device\)"):
        open_sink("/dev/full", WIDTH, HEIGHT, format=format)


def test_a_disk_that_fills_later_names_the_file_and_the_cause():
    sink = open_sink("/dev/full", WIDTH, HEIGHT, format="text")
    with pytest.raises(SinkError, match=r"^/dev/full: writing failed \(No space left on device\)$"):
        sink.write(events(10), end_of(events(10)))
    with pytest.raises(SinkError, match="writing failed before"):
        sink.write(events(10), end_of(events(10)))
    sink.close()


def test_a_closed_pipe_is_a_sink_error():
    reader, writer = os.pipe()
    sink = open_sink(f"/dev/fd/{writer}", WIDTH, HEIGHT, format="aedat4")
    os.close(reader)
    with pytest.raises(SinkError, match="Broken pipe"):
        sink.write(events(10), end_of(events(10)))
    sink.close()
    os.close(writer)


def test_a_pipe_carries_aedat4(tmp_path):
    reader, writer = os.pipe()
    sink = open_sink(f"/dev/fd/{writer}", WIDTH, HEIGHT, format="aedat4")
    os.close(writer)
    batch = events(500)
    sink.write(batch, end_of(batch))
    sink.close()
    with os.fdopen(reader, "rb") as pipe:
        (tmp_path / "a.aedat4").write_bytes(pipe.read())
    assert np.array_equal(read(tmp_path / "a.aedat4"), batch)


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_folder_that_vanishes_is_a_sink_error(tmp_path, ending):
    folder = tmp_path / "folder"
    folder.mkdir()
    sink = open_sink(folder / f"a{ending}", WIDTH, HEIGHT, flush=FlushPolicy(interval_us=0))
    shutil.rmtree(folder)
    with pytest.raises(SinkError, match=r"a\..*: writing failed \(.*(deleted|No such file|disk I/O)"):
        sink.write(events(10), end_of(events(10)))
        sink.close()
    sink.close()


def test_standard_output_may_be_a_file_without_a_name():
    code = (
        "from clsim.events.files import open_sink; from tests.events.event_writer import numbered\n"
        "sink = open_sink('-', 346, 260); sink.write(numbered(0, 2), 10); sink.close()"
    )
    with tempfile.TemporaryFile() as file:
        subprocess.run([sys.executable, "-c", code], stdout=file, check=True, env={**os.environ, "PYTHONPATH": ROOT})
        file.seek(0)
        assert file.read() == b"0 0 0 1\n3 1 1 0\n"


def test_no_descriptor_is_left_open(tmp_path):
    def opened() -> int:
        return len(os.listdir("/proc/self/fd"))

    for ending in ENDINGS:  # the first time loads libraries
        open_sink(tmp_path / f"a{ending}", WIDTH, HEIGHT).close()
    before = opened()
    for ending in ENDINGS:
        open_sink(tmp_path / f"a{ending}", WIDTH, HEIGHT).close()
        read(tmp_path / f"a{ending}")
    assert opened() == before
