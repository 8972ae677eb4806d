"""How a run ends when nothing takes its events any longer."""

import contextlib
import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from clsim.events import EVENT_DTYPE
from clsim.events.files import open_sink
from clsim.frames import BASE_PLANES, Frame
from clsim.frames.exr import ExrWriter
from tests.events.event_data import end_of

LIVE = ("live", "cornell", "--resolution", "32x24", "--fps", "30", "--loop", "--duration", "100s")


@pytest.fixture
def flickering(tmp_path: Path) -> Path:
    """Frames in which every pixel fires in every step."""
    writer = ExrWriter(tmp_path / "frames")
    for k in range(40):
        planes = np.ones((len(BASE_PLANES), 48, 64), np.float32)
        planes[:3] = 0.2 if k % 2 else 0.8
        writer.write(Frame(planes, BASE_PLANES, 100_000 * k, k))
    return tmp_path / "frames"


def without_start(said: str) -> str:
    """Leave out that kernels are compiled, which is said where that takes long."""
    return said.replace(
        "clsim: cornell: starting (new kernels are compiled once, and the first frame takes the most paths) …\n", "", 1
    )


def read_a_line(*arguments: object) -> tuple[int, str]:
    """Return the exit status and what was said on standard error, after one line of standard output was read."""
    command = [sys.executable, "-m", "clsim", *map(str, arguments)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as run:
        assert run.stdout is not None and run.stderr is not None
        assert run.stdout.readline()
        run.stdout.close()
        said = run.stderr.read().decode()
        return run.wait(120), without_start(said)


def test_a_live_run_whose_reader_leaves_ends_quietly() -> None:
    assert read_a_line(*LIVE, "--out", "-") == (141, "")


def test_detection_whose_reader_leaves_ends_quietly(flickering: Path) -> None:
    assert read_a_line("detect", flickering, "--fps", "10", "--method", "esim", "--out", "-") == (141, "")


def test_conversion_whose_reader_leaves_ends_quietly(tmp_path: Path) -> None:
    events = np.zeros(100_000, EVENT_DTYPE)
    events["t"] = np.arange(len(events))
    with contextlib.closing(open_sink(tmp_path / "many.csv", 4, 4)) as sink:
        sink.write(events, end_of(events))
    assert read_a_line("convert", tmp_path / "many.csv", "-") == (141, "")


def test_the_last_events_may_be_those_that_nobody_reads(tmp_path: Path) -> None:
    """Here only the close of the output meets the closed pipe, at the end of the run."""
    from clsim.cli.output.status import run_session
    from clsim.events import SinkError
    from clsim.live.options import LiveOptions
    from clsim.live.session import open_live

    class Unread:
        def write(self, batch: object, end_us: int) -> None:
            pass

        def close(self) -> None:
            raise SinkError("standard output: writing failed (Broken pipe)") from BrokenPipeError()

    options = LiveOptions("still", resolution=(16, 12), frame_count=2)
    assert run_session(open_live(options, extra_sinks=(Unread(),)), as_json=False) == 141


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_full_disk_ends_the_run_with_a_sentence(clsim: Callable[..., object], tmp_path: Path) -> None:
    (tmp_path / "events").symlink_to("/dev/full")
    outcome = clsim(*LIVE, "--format", "text", "--out", tmp_path / "events")
    expected = f"clsim: every output has failed: {tmp_path}/events: writing failed (No space left on device)\n"
    assert (outcome.status, without_start(outcome.stderr)) == (1, expected)
    about = json.loads((tmp_path / "events.json").read_text())
    assert about["complete"] is False and about["summary"]["outputs"][0]["error"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_one_of_two_outputs_that_broke_is_told_and_the_other_is_whole(
    clsim: Callable[..., object], flickering: Path, tmp_path: Path
) -> None:
    (tmp_path / "full").symlink_to("/dev/full")
    whole, full = tmp_path / "whole.txt", tmp_path / "full"
    command = ("detect", flickering, "--fps", "10", "--method", "esim", "--format", "text", "--out", whole)
    assert clsim(*command).status == 0
    alone = whole.read_bytes()
    outcome = clsim(*command, "--out", full)
    assert outcome.status == 1 and "No space left on device" in outcome.stderr
    assert len(alone) > 0 and whole.read_bytes() == alone
    summary = json.loads(clsim(*command, "--out", full, "--json").stdout)
    assert ["error" in output for output in summary["outputs"]] == [False, True]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_conversion_that_fills_the_disk_says_so(clsim: Callable[..., object], tmp_path: Path) -> None:
    events = np.zeros(100_000, EVENT_DTYPE)
    events["t"] = np.arange(len(events))
    with contextlib.closing(open_sink(tmp_path / "many.csv", 4, 4)) as sink:
        sink.write(events, len(events))
    (tmp_path / "full.txt").symlink_to("/dev/full")
    outcome = clsim("convert", tmp_path / "many.csv", tmp_path / "full.txt")
    sentence = f"clsim: {tmp_path}/full.txt: writing failed (No space left on device)"
    assert (outcome.status, outcome.stderr.strip()) == (1, sentence)
    assert (tmp_path / "full.txt").readlink() == Path("/dev/full")  # what the user had made stays


def test_servers_tell_their_address_without_a_terminal_too(clsim: Callable[..., object], flickering: Path) -> None:
    outcome = clsim(
        "detect", flickering, "--fps", "10", "--method", "esim", "--out", "tcp://127.0.0.1:0?compression=none"
    )
    assert outcome.status == 0
    # Options are the server's own: a reader refuses them.
    told = re.search(r"^clsim: events at tcp://127\.0\.0\.1:(\d+)$", outcome.stderr, re.MULTILINE)
    assert told is not None and int(told[1]) > 1023


def test_ctrl_c_while_a_run_starts_is_told_and_leaves_a_readable_file(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    from clsim.cli.output.status import run_session
    from clsim.live.options import LiveOptions
    from clsim.live.pipeline import Pipeline
    from clsim.live.session import open_live

    def interrupted(pipeline: Pipeline) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Pipeline, "start", interrupted)
    out = tmp_path / "events.npz"
    options = LiveOptions("still", resolution=(16, 12), frame_count=3, outputs=(str(out),))
    assert run_session(open_live(options), as_json=False) == 130
    assert "stopped: 0 events" in capfd.readouterr().err
    assert json.loads(out.with_name("events.npz.json").read_text())["complete"] is False
