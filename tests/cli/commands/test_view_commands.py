"""``clsim view``, ``clsim convert`` and ``--view`` as they are typed."""

import os
import pty
import re
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image

import clsim as library
from clsim.cli.commands import view
from clsim.cli.output import watch
from clsim.errors import InputError
from clsim.events import CAUSES
from clsim.events.files import open_sink
from clsim.live.view.colormaps import CAUSE, FILTER, lut
from tests.events.event_data import end_of
from tests.live.view.view_events import random_events

EVENTS = random_events(2000, 20, 10)


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "events.aedat4"
    sink = open_sink(path, 20, 10)
    sink.write(EVENTS, end_of(EVENTS))
    sink.close()
    return path


def test_convert(clsim: Callable[..., object], recording: Path, tmp_path: Path) -> None:
    outcome = clsim("convert", recording, tmp_path / "events.txt")
    assert outcome.status == 0 and outcome.stdout == ""
    assert f"2,000 events up to {EVENTS['t'][-1] / 1e6:.6f} s" in outcome.stderr
    assert np.array_equal(np.concatenate(list(library.open(tmp_path / "events.txt"))), EVENTS)


def test_convert_a_broken_file(clsim: Callable[..., object], tmp_path: Path) -> None:
    (tmp_path / "a.aedat4").write_bytes(b"no such thing")
    outcome = clsim("convert", tmp_path / "a.aedat4", tmp_path / "b.txt")
    assert outcome.status == 2 and "a.aedat4" in outcome.stderr and len(outcome.stderr.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["a.aedat4"]


def test_view_to_a_picture(clsim: Callable[..., object], recording: Path, tmp_path: Path) -> None:
    arguments = ("--colors", "grey", "--theme", "light", "--zoom", "3", "--at", "500ms", "--decay")
    outcome = clsim("view", recording, "--to", tmp_path / "still.png", *arguments)
    assert outcome.status == 0
    with Image.open(tmp_path / "still.png") as picture:
        assert picture.size == (60, 30)


def test_a_resolution_must_hold_the_events_of_files_that_do_not_tell(
    clsim: Callable[..., object], tmp_path: Path
) -> None:
    (tmp_path / "a.txt").write_text("1 7 5 1\n")
    picture = "--to", tmp_path / "a.png", "--zoom", 1
    outcome = clsim("view", tmp_path / "a.txt", *picture, "--resolution", "7x6")
    assert outcome.status == 2 and "a.txt, which needs 8x6" in outcome.stderr and not (tmp_path / "a.png").exists()
    assert clsim("view", tmp_path / "a.txt", *picture, "--resolution", "9x6").status == 0
    with Image.open(tmp_path / "a.png") as image:
        assert image.size == (9, 6)
    (tmp_path / "none.txt").write_text("")
    assert "no events to show" in clsim("view", tmp_path / "none.txt", *picture, "--resolution", "9x6").stderr


def test_a_picture_after_the_end_is_refused_with_the_length(
    clsim: Callable[..., object], recording: Path, tmp_path: Path
) -> None:
    end_s = int(EVENTS["t"][-1]) * 1e-6
    outcome = clsim("view", recording, "--to", tmp_path / "a.png", "--at", "500")
    assert outcome.status == 2 and not (tmp_path / "a.png").exists()
    assert outcome.stderr == f"clsim: --at 500 s is after the end of the recording, which is {end_s:g} s long\n"
    assert clsim("view", recording, "--to", tmp_path / "a.png", "--at", f"{end_s + 0.02}").status == 0


def test_pictures_longer_than_the_recording_are_told(
    clsim: Callable[..., object], recording: Path, tmp_path: Path
) -> None:
    for accumulate, longer in (("500", True), ("33ms", False)):
        outcome = clsim("view", recording, "--to", tmp_path / "a.png", "--accumulate", accumulate)
        said = f"--accumulate {accumulate} is longer than the recording"
        assert outcome.status == 0 and (said in outcome.stderr) == longer


def test_a_recording_is_as_long_as_all_of_its_batches() -> None:
    times = view._Times()
    assert sum(map(len, times.of(np.array_split(EVENTS, 3)))) == 2000 and times.span_us == np.ptp(EVENTS["t"])


@pytest.mark.parametrize("command", ["live", "render", "view", "score"])
def test_help_tells_the_unit_of_bare_numbers(
    clsim: Callable[..., object], monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    monkeypatch.setenv("COLUMNS", "400")
    said = clsim(command, "--help").stdout
    assert "a bare number is seconds" in said or "bare numbers are seconds" in said


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--to", "film.avi"], ".mp4"),
        (["--to", "film.gif", "--video-fps", "0"], "--video-fps"),
        (["--to", "film.gif", "--accumulate", "soon"], "--accumulate"),
        (["--to", "film.gif", "--zoom", "0"], "--zoom"),
        (["--to", "film.gif", "--resolution", "5"], "--resolution"),
        (["--to", "film.gif", "--resolution", "20x9"], "--resolution 20x9 is too small for"),
        (["--to", "film.gif", "--video-fps", "1e9"], "--video-fps must be at most 1000"),
        (["--to", "film.gif", "--at", "0.1"], "--at is the time of a picture, so it needs --to NAME.png"),
        (["--port", "http"], "--port"),
        (["--port", "99999"], "--port"),
        (["--view", "hologram"], "hologram"),
        (["--view", "terminal"], "terminal"),
        (["--to", "film.gif", "--colours", "cause"], "have no cause; expected HDF5 or Parquet written with --labels"),
    ],
)
def test_wrong_options(clsim: Callable[..., object], recording: Path, arguments: list[str], sentence: str) -> None:
    outcome = clsim("view", recording, *arguments)
    assert outcome.status == 2 and sentence in outcome.stderr and len(outcome.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("tcp://127.0.0.1:9", "--to", "a.png"), "tcp://127.0.0.1:9: events of a stream have no cause"),
        (("a.h5", "--view", "terminal"), "--colours cause is for the page and for --to, got --view terminal"),
    ],
)
def test_what_cannot_show_causes_says_so(
    clsim: Callable[..., object], monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], sentence: str
) -> None:
    monkeypatch.setattr("clsim.cli.commands.view.check", lambda where: None)  # here is no terminal
    outcome = clsim("view", *arguments, "--colours", "cause")
    assert outcome.status == 2 and sentence in outcome.stderr


def test_causes_are_drawn(clsim: Callable[..., object], tmp_path: Path) -> None:
    sink = open_sink(tmp_path / "a.h5", 20, 10, labels=("cause",))
    sink.write(EVENTS, end_of(EVENTS), np.full(len(EVENTS), CAUSES.index("leak"), np.uint8))
    sink.close()
    how = ("--colours", "cause", "--zoom", "1", "--accumulate", "1s", "--contrast", "1")
    assert clsim("view", tmp_path / "a.h5", "--to", tmp_path / "a.png", *how).status == 0
    with Image.open(tmp_path / "a.png") as picture:
        assert (np.asarray(picture.convert("RGB")) == lut(CAUSE)[191]).all()


def test_events_behind_filters_have_their_colours(clsim: Callable[..., Any], recording: Path, tmp_path: Path) -> None:
    Path(f"{recording}.json").write_text('{"color_filter": "GRBG"}')
    assert clsim("convert", recording, tmp_path / "b.csv").status == 0  # the pattern comes along
    for name, how in ((recording, ()), (tmp_path / "b.csv", ("--colours", "filter"))):
        how = (*how, "--zoom", "1", "--accumulate", "1s", "--contrast", "1")
        assert clsim("view", name, "--to", tmp_path / "a.png", *how).status == 0
        with Image.open(tmp_path / "a.png") as picture:
            seen = np.asarray(picture.convert("RGB"))
        red, green, blue = lut(FILTER)[[63, 127, 191]]
        assert (seen[0::2, 0::2] == green).all() and (seen[1::2, 1::2] == green).all()
        assert (seen[0::2, 1::2] == red).all() and (seen[1::2, 0::2] == blue).all()


def test_filters_that_nobody_tells_of_are_not_shown(clsim: Callable[..., Any], recording: Path) -> None:
    outcome = clsim("view", recording, "--to", "a.png", "--colours", "filter")
    assert outcome.status == 2 and "no sidecar tells of a color_filter" in outcome.stderr


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        (["still", "--view"], ["still", "--view", "web"]),
        (["--view", "still"], ["--view", "web", "still"]),
        (["--view", "terminal", "still"], ["--view", "terminal", "still"]),
        (["--view", "--loop", "still"], ["--view", "web", "--loop", "still"]),
        (["--view=none", "still"], ["--view=none", "still"]),
        (["still", "--", "--view"], ["still", "--", "--view"]),
    ],
)
def test_a_bare_view_means_the_page(typed: list[str], meant: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    heard: list[list[str]] = []
    monkeypatch.setattr(watch.TyperCommand, "parse_args", lambda self, ctx, args: heard.append(list(args)) or [])
    watch.BareViewCommand("live").parse_args(None, typed)
    assert heard == [meant]


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        (None, {}),
        ("8080", {"host": "127.0.0.1", "port": 8080}),
        ("0.0.0.0:80", {"host": "0.0.0.0", "port": 80}),
        ("[::1]:0", {"host": "::1", "port": 0}),
        ("65535", {"host": "127.0.0.1", "port": 65535}),
    ],
)
def test_ports(text: str | None, meant: dict[str, object]) -> None:
    assert watch.host_and_port(text) == meant


@pytest.mark.parametrize("text", ["", ":", "x", "1.5", "host:", "65536", "-1"])
def test_wrong_ports(text: str) -> None:
    with pytest.raises(InputError, match="--port"):
        watch.host_and_port(text)


def test_the_page_of_a_recording_is_served_until_ctrl_c(recording: Path) -> None:
    pytest.importorskip("aiohttp", reason="the page is an extra")
    process = subprocess.Popen(
        [sys.executable, "-m", "clsim", "view", str(recording), "--port", "0"], stderr=subprocess.PIPE, text=True
    )
    try:
        assert process.stderr is not None
        url = re.search(r"http://127\.0\.0\.1:\d+/", process.stderr.readline())
        assert url is not None
        with urllib.request.urlopen(url[0], timeout=10) as answer:
            assert b"clsim" in answer.read()
        process.send_signal(2)
        assert process.wait(10) == 130
    finally:
        process.kill()
        process.wait()


def in_terminal(*arguments: object) -> tuple[int, str]:
    """Run a command in a terminal of its own; return its exit status and all it printed."""
    pid, terminal = pty.fork()
    if pid == 0:
        os.environ.update(TERM="xterm-256color", COLORTERM="truecolor", COLUMNS="60", LINES="20")
        os.environ.pop("NO_COLOR", None)
        os.execv(sys.executable, [sys.executable, "-m", "clsim", *map(str, arguments)])
    killer = threading.Timer(60, os.kill, (pid, 9))
    killer.start()
    printed = b""
    try:
        while data := os.read(terminal, 1 << 16):
            printed += data
    except OSError:  # the other end is closed
        pass
    _, status = os.waitpid(pid, 0)
    killer.cancel()
    os.close(terminal)
    return os.waitstatus_to_exitcode(status), printed.decode()


def test_a_recording_plays_in_a_terminal(recording: Path) -> None:
    status, printed = in_terminal("view", recording, "--view", "terminal", "--speed", "4")
    assert status == 0
    assert "▀" in printed and "38;2;" in printed and "events.aedat4" in printed
    assert printed.count("\x1b[?2026h") > 1 and printed.rstrip().endswith("\x1b[?25h")


def test_slow_motion_in_a_terminal_takes_its_time(
    clsim: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """About 20 ms of events, twenty times slower."""
    monkeypatch.setattr("clsim.cli.commands.view.check", lambda where: None)  # here is no terminal
    events = random_events(200, 20, 10, end_us=20_000)
    sink = open_sink(tmp_path / "a.aedat4", 20, 10)
    sink.write(events, end_of(events))
    sink.close()
    view = ("view", tmp_path / "a.aedat4", "--view", "terminal", "--speed")
    clsim(*view, "1")  # loads what is needed
    start_s = time.monotonic()
    assert clsim(*view, "0.05").status == 0
    assert time.monotonic() - start_s > 0.9 * 20 * int(np.ptp(events["t"])) / 1e6


def test_a_live_run_shows_itself_in_a_terminal() -> None:
    run = ("live", "cornell", "--resolution", "32x24", "--duration", "60ms")
    status, printed = in_terminal(*run)
    assert status == 0 and "\x1b[?2026h" in printed and "of real time" in printed and "\x1b[?25h" in printed


@pytest.mark.parametrize(
    ("tty", "outputs", "as_json", "view"),
    [
        (True, (), False, "terminal"),
        (False, (), False, "none"),
        (True, ("events.txt",), False, "none"),
        (True, (), True, "none"),
    ],
)
def test_what_is_shown_unless_told(
    monkeypatch: pytest.MonkeyPatch, tty: bool, outputs: tuple[str, ...], as_json: bool, view: str
) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setattr("sys.stdout.isatty", lambda: tty)
    assert watch.default_view(outputs, as_json=as_json) == view


@pytest.mark.parametrize(("truth_every", "labelled"), [(0, False), (1, True), (5, False)])
def test_the_page_is_told_which_frames_have_truth_and_whether_events_have_causes(
    monkeypatch: pytest.MonkeyPatch, truth_every: int, labelled: bool
) -> None:
    told: dict[str, Any] = {}

    def page(*given: Any, **named: Any) -> Any:
        told.update(named, given=given)
        return SimpleNamespace(url="http://127.0.0.1:7/")

    monkeypatch.setattr("clsim.live.view.sink.ViewSink", page)
    pipeline = SimpleNamespace(outputs=[], watchers=[])
    session: Any = SimpleNamespace(
        name="still", width=20, height=10, truth_every=truth_every, labelled=labelled, pipeline=pipeline
    )
    watch.attach(session, "web", "7", None, as_json=True)
    assert told["given"] == ("still", 20, 10) and told["port"] == 7
    assert (told["truth_every"], told["causes"]) == (truth_every, labelled)
    assert len(pipeline.outputs) == len(pipeline.watchers) == 1


def test_the_terminal_and_events_on_standard_output_exclude_each_other(clsim: Callable[..., object]) -> None:
    outcome = clsim("live", "still", "--view", "terminal", "--out", "-")
    assert outcome.status == 2 and "--view terminal and --out -" in outcome.stderr


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--view", "terminal"], "needs a terminal"),
        (["--view", "--port", "{taken}"], "{taken}"),
        (["--view", "web"], "clsim[view]"),
        (["--view", "rerun"], "clsim[rerun]"),
    ],
)
def test_a_view_that_cannot_be_had_costs_no_file(
    clsim: Callable[..., object],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    arguments: list[str],
    sentence: str,
) -> None:
    if sentence.startswith("clsim["):
        for library_name in ("aiohttp", "aiohttp.web", "rerun"):
            monkeypatch.setitem(sys.modules, library_name, None)
    (tmp_path / "events.txt").write_text("precious")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        words = [word.replace("{taken}", port) for word in arguments]
        outcome = clsim("live", "still", "--frame-count", "2", "--out", tmp_path / "events.txt", *words)
    assert outcome.status == 2 and sentence.replace("{taken}", port) in outcome.stderr
    assert (tmp_path / "events.txt").read_text() == "precious"


def test_a_port_lost_while_outputs_are_opened_cannot_be(
    clsim: Callable[..., object], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The page's port is held before any output is opened, and given back if one of them cannot be."""
    from clsim.live import session

    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    seen = []

    def open_sinks(*arguments: object) -> None:
        with pytest.raises(OSError, match="in use"):
            socket.create_server(("127.0.0.1", port), reuse_port=False)
        seen.append(port)
        raise InputError("an output that cannot be opened")

    monkeypatch.setattr(session, "open_sinks", open_sinks)
    words = ("live", "still", "--frame-count", "2", "--out", tmp_path / "events.txt", "--view", "--port", port)
    outcome = clsim(*words)
    assert outcome.status == 2 and "an output that cannot be opened" in outcome.stderr and seen == [port]
    assert list(tmp_path.iterdir()) == []
    socket.create_server(("127.0.0.1", port)).close()


def test_a_topic_of_a_bag_is_shown(
    clsim: Callable[..., object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sink = open_sink(tmp_path / "a.bag", 20, 10)
    sink.write(EVENTS, end_of(EVENTS))
    sink.close()
    seen = []

    class Page:
        url, warning = "here", None

        def __init__(self, open_source: Callable[[], Any], title: str, *size: int, **more: object):
            seen.append((len(open_source().read()), size, more["read_frames"]))

        def wait(self, timeout_s: float) -> None:
            raise KeyboardInterrupt

        def close(self) -> None: ...

    monkeypatch.setattr("clsim.live.view.player.Player", Page)
    assert clsim("view", f"{tmp_path / 'a.bag'}#/cam0/events").status == 130
    assert seen == [(len(EVENTS), (20, 10), None)]
