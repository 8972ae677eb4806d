"""The UNIX socket server: DV's own client, and what may lie at its path."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

from clsim.errors import InputError
from clsim.events.socket_sinks import open_socket_sink
from clsim.events.sockets.unix import UnixSink
from tests.events.sockets.dv_reader import assert_same, read_with_dv
from tests.events.sockets.socket_help import HEIGHT, WIDTH, make_events


def test_network_reader_gets_every_event(tmp_path: Path) -> None:
    batch, path = make_events(100_000), tmp_path / "events.sock"
    sink = open_socket_sink(f"unix://{path}", WIDTH, HEIGHT)
    assert isinstance(sink, UnixSink)
    got = read_with_dv(sink, path, [batch], tmp_path)
    sink.close()
    assert_same(got["events"], batch)
    assert not path.exists()


def test_stale_socket_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "events.sock"
    with socket.socket(socket.AF_UNIX) as gone:  # a killed server leaves its file behind
        gone.bind(str(path))
    sink = UnixSink(f"unix://{path}", WIDTH, HEIGHT)
    with socket.socket(socket.AF_UNIX) as client:
        client.connect(str(path))
        assert sink.wait_for_clients(timeout_s=10)
    sink.close()


def test_live_socket_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "events.sock"
    sink = UnixSink(f"unix://{path}", WIDTH, HEIGHT)
    with pytest.raises(InputError, match="a server listens there already"):
        UnixSink(f"unix://{path}", WIDTH, HEIGHT)
    assert path.exists()
    sink.close()
    sink.close()


def test_other_files_are_refused_and_kept(tmp_path: Path) -> None:
    path = tmp_path / "thesis.tex"
    path.write_text("years of work")
    link = tmp_path / "link"
    link.symlink_to(path)
    for target in (path, link, tmp_path):
        with pytest.raises(InputError, match="is no socket"):
            UnixSink(f"unix://{target}", WIDTH, HEIGHT)
    assert path.read_text() == "years of work"


def test_close_spares_a_file_that_took_the_place(tmp_path: Path) -> None:
    path = tmp_path / "events.sock"
    sink = UnixSink(f"unix://{path}", WIDTH, HEIGHT)
    (tmp_path / "new").write_text("another's")
    os.replace(tmp_path / "new", path)
    sink.close()
    assert path.read_text() == "another's"
