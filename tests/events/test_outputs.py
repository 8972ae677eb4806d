"""Several outputs at once: what was there before is lost only to a run that can begin."""

import os
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

import clsim
from clsim.errors import InputError
from clsim.events import EVENT_DTYPE, SinkError
from clsim.events.outputs import FileOptions, open_outputs
from clsim.events.sockets.tcp import TcpSink
from clsim.events.sockets.udp import UdpSink

OLD = b"of great value"


@pytest.mark.parametrize(
    ("other", "size", "sentence"),
    [
        ("b.raw", (2049, 10), "width 2049 does not fit EVT2"),
        ("b.dat", (10, 16385), "height 16385 does not fit DAT"),
        ("missing/b.txt", (10, 10), "there is no folder"),
        ("b.xyz", (10, 10), "no known event format"),
        ("tcp://127.0.0.1:99999", (10, 10), "the port is"),
        ("./old.aedat4", (10, 10), "is the same output as"),
        ("link.aedat4", (10, 10), "is the same output as"),
    ],
)
@pytest.mark.parametrize("first", [True, False])
def test_an_old_file_outlives_an_output_that_cannot_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, other: str, size: tuple[int, int], sentence: str, first: bool
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("old.aedat4").write_bytes(OLD)
    Path("link.aedat4").symlink_to("old.aedat4")
    before = sorted(tmp_path.iterdir())
    names = [other, "old.aedat4"] if first else ["old.aedat4", other]
    with pytest.raises(InputError, match=sentence):
        open_outputs(names, *size, FileOptions())
    assert Path("old.aedat4").read_bytes() == OLD and sorted(tmp_path.iterdir()) == before


def test_a_missing_library_is_told_before_anything_is_touched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "old.txt").write_bytes(OLD)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"Parquet needs pyarrow; install it with: pip install 'clsim\[parquet\]'"):
        open_outputs([str(tmp_path / "old.txt"), str(tmp_path / "b.parquet")], 4, 4, FileOptions())
    assert (tmp_path / "old.txt").read_bytes() == OLD


def test_an_output_that_fails_while_it_opens_costs_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("old.txt").write_bytes(OLD)
    taken = TcpSink("tcp://127.0.0.1:0", 4, 4)
    with pytest.raises(InputError, match="cannot be used"):
        open_outputs(["old.txt", "new.txt", f"tcp://127.0.0.1:{taken.port}"], 4, 4, FileOptions())
    taken.close()
    assert Path("old.txt").read_bytes() == OLD and not Path("new.txt").exists()
    Path("full.dat").symlink_to("/dev/full")
    with pytest.raises(InputError, match="No space left"):
        open_outputs(["new.txt", "full.dat"], 4, 4, FileOptions())
    assert not Path("new.txt").exists()


def test_standard_output_is_taken_once() -> None:
    with pytest.raises(InputError, match=r"-\?format=aedat4: is the same output as -"):
        open_outputs(["-", "-?format=aedat4"], 4, 4, FileOptions())


def test_all_outputs_are_open_under_their_names(tmp_path: Path) -> None:
    names = [str(tmp_path / "a.txt"), f"unix://{tmp_path}/s", str(tmp_path / "b.dat")]
    sinks = open_outputs(names, 4, 4, FileOptions())
    events = np.array([(1, 2, 3, True)], EVENT_DTYPE)
    for name in names:
        sinks[name].write(events, 1)
        sinks[name].close()
    for name in (names[0], names[2]):
        assert np.array_equal(clsim.open(name).read(), events)


# In a process of its own, because the limit on the size of files stays.
APPENDER = textwrap.dedent(
    """
    import resource, sys
    import numpy as np
    from clsim.events import EVENT_DTYPE, SinkError
    from clsim.events.files import open_sink

    resource.setrlimit(resource.RLIMIT_FSIZE, (1200, 1200))
    sink = open_sink("-", 4, 4)
    events = np.zeros(100, EVENT_DTYPE)
    try:
        sink.write(events, 0)
    except SinkError as error:
        sys.stderr.write(str(error))
    """
)


@pytest.mark.parametrize("mode", ["ab", "r+b"])
def test_what_standard_output_held_before_is_never_lost(tmp_path: Path, mode: str) -> None:
    path = tmp_path / "mine.txt"
    path.write_bytes(b"#" * 1000)
    with path.open(mode) as file:
        os.lseek(file.fileno(), 0, os.SEEK_END)
        done = subprocess.run([sys.executable, "-c", APPENDER], stdout=file, stderr=subprocess.PIPE, text=True)
    assert done.stderr == "standard output: writing failed (File too large)"
    assert path.read_bytes()[:1000] == b"#" * 1000


@pytest.mark.parametrize(("kind", "url"), [(TcpSink, "tcp://127.0.0.1:0"), (UdpSink, "udp://127.0.0.1:9")])
def test_a_stream_that_was_closed_is_a_sink_error(kind: type[TcpSink] | type[UdpSink], url: str) -> None:
    sink = kind(url, 4, 4)
    sink.close()
    with pytest.raises(SinkError, match="closed before"):
        sink.write(np.zeros(1, EVENT_DTYPE), 0)


@pytest.mark.parametrize(("unit", "line"), [(None, "1500000 3 2 1"), ("us", "1500000 3 2 1"), ("s", "1.500000 3 2 1")])
def test_time_in_text_is_in_the_unit_that_is_asked_for(tmp_path: Path, unit: str | None, line: str) -> None:
    events = np.array([(1_500_000, 3, 2, True)], EVENT_DTYPE)
    names = [str(tmp_path / "a.txt"), str(tmp_path / "b.raw")]
    for output in open_outputs(names, 4, 4, FileOptions(text_time=unit)).values():
        output.write(events, 2_000_000)
        output.close()
    assert line in Path(names[0]).read_text().splitlines()
