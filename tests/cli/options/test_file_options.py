"""``--format``, ``--text-time`` and what ``--help`` promises of files."""

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from clsim.events import EVENT_DTYPE
from clsim.events.files import FORMATS, open_sink, open_source
from clsim.frames import BASE_PLANES, Frame
from clsim.frames.exr import ExrWriter

RUN = ("live", "cornell", "--resolution", "32x24", "--frame-count", "4", "--fps", "30")


def read(path: Path, **options: str) -> np.ndarray:
    return np.concatenate(list(open_source(path, **options)))


def test_text_in_seconds_and_in_microseconds_tells_the_same(clsim: Callable[..., object], tmp_path: Path) -> None:
    for unit in ("us", "s"):
        outcome = clsim(*RUN, "--text-time", unit, "--out", tmp_path / f"{unit}.txt", "--out", tmp_path / f"{unit}.csv")
        assert outcome.status == 0, outcome.stderr
    found = {name: read(tmp_path / name) for name in ("us.txt", "s.txt", "us.csv", "s.csv")}
    assert len(found["us.txt"]) > 0 and all((each == found["us.txt"]).all() for each in found.values())
    times = [line.split()[0] for line in (tmp_path / "s.txt").read_text().splitlines()]
    assert all(re.fullmatch(r"\d+\.\d{6}", time) for time in times)
    assert (tmp_path / "us.txt").read_text().split()[0] == str(found["us.txt"]["t"][0])


@pytest.mark.slow
def test_text_in_seconds_on_standard_output() -> None:
    command = [sys.executable, "-m", "clsim", *RUN, "--text-time", "s", "--out", "-"]
    lines = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120).stdout.splitlines()
    assert lines and all(re.fullmatch(r"\d+\.\d{6} \d+ \d+ [01]", line) for line in lines)


def test_aedat4_on_standard_output(tmp_path: Path) -> None:
    with (tmp_path / "piped.aedat4").open("wb") as pipe:
        command = [sys.executable, "-m", "clsim", *RUN, "--out", "-?format=aedat4", "--out", str(tmp_path / "a.txt")]
        subprocess.run(command, stdout=pipe, check=True, timeout=120)
    assert len(read(tmp_path / "a.txt")) > 0
    assert (read(tmp_path / "piped.aedat4") == read(tmp_path / "a.txt")).all()


def test_the_format_may_be_named(clsim: Callable[..., object], tmp_path: Path) -> None:
    outcome = clsim(*RUN, "--out", tmp_path / "a.txt", "--out", tmp_path / "b.es")
    assert outcome.status == 0, outcome.stderr
    assert clsim(*RUN, "--format", "evt2", "--out", tmp_path / "plain", "--out", tmp_path / "c.bin").status == 0
    for name in ("plain", "c.bin"):
        assert (tmp_path / name).read_bytes().startswith(b"%")
        assert (read(tmp_path / name, format="evt2") == read(tmp_path / "a.txt")).all()
    assert clsim("convert", tmp_path / "a.txt", tmp_path / "d", "--format", "text", "--text-time", "s").status == 0
    assert "." in (tmp_path / "d").read_text().split()[0]
    assert (read(tmp_path / "d", format="text") == read(tmp_path / "a.txt")).all()


def test_a_conversion_to_seconds(clsim: Callable[..., object], tmp_path: Path) -> None:
    sink = open_sink(tmp_path / "a.aedat4", 4, 3)
    sink.write(
        np.array([(1_000_000_000_123_456, 3, 2, True)], EVENT_DTYPE),
        1_000_000_000_123_456,
    )
    sink.close()
    assert clsim("convert", tmp_path / "a.aedat4", tmp_path / "a.txt", "--text-time", "s").status == 0
    assert (tmp_path / "a.txt").read_text() == "1000000000.123456 3 2 1\n"


def test_detection_to_seconds(clsim: Callable[..., object], tmp_path: Path) -> None:
    writer = ExrWriter(tmp_path / "frames")
    for k, radiance in enumerate((0.2, 0.8)):
        planes = np.ones((len(BASE_PLANES), 12, 16), np.float32)
        planes[:3] = radiance
        writer.write(Frame(planes, BASE_PLANES, 100_000 * k, k))
    outcome = clsim("detect", tmp_path / "frames", "--fps", "10", "--out", tmp_path / "a.txt", "--text-time", "s")
    assert outcome.status == 0, outcome.stderr
    assert re.fullmatch(r"0\.\d{6}", (tmp_path / "a.txt").read_text().split()[0])


@pytest.mark.parametrize("command", ["live", "detect", "convert"])
def test_help_tells_what_a_kill_costs(clsim: Callable[..., object], command: str) -> None:
    outcome = clsim(command, "--help")
    said = re.sub(r"[\s│]+", " ", outcome.stdout)
    for each in FORMATS:
        assert each.promise in said
        assert all(ending in said for ending in each.endings)
