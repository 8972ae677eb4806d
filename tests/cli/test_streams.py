"""Standard streams that are closed or full, files that begin with a mark, what info says of files."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from rosbags.highlevel import AnyReader

from clsim.events import EVENT_DTYPE
from clsim.events.files import open_sink


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    events = np.array([(k, k % 20, k % 10, k % 2) for k in range(1000)], EVENT_DTYPE)
    sink = open_sink(tmp_path / "a.evt3.raw", 20, 10)
    sink.write(events, 1000)
    sink.close()
    return (tmp_path / "a.evt3.raw").rename(tmp_path / "a.raw")


SLOW = [pytest.param(each, marks=pytest.mark.slow) for each in ("2>&-", ">&-", "<&-")]


@pytest.mark.parametrize("where", ["2>/dev/full", ">&- 2>&-", *SLOW])
def test_streams_that_are_closed_or_full_cost_no_file(tmp_path: Path, recording: Path, where: str) -> None:
    command = f"{sys.executable} -m clsim convert {recording} {tmp_path}/b.csv {where}"
    assert subprocess.run(command, shell=True, check=False).returncode == 0
    assert (tmp_path / "b.csv").read_text().count("\n") == 1001 and (tmp_path / "b.csv.json").exists()
    wrong = f"{sys.executable} -m clsim convert {tmp_path}/none.raw {tmp_path}/c.csv {where}"
    assert subprocess.run(wrong, shell=True, check=False, stderr=None).returncode == 2


def test_messages_do_not_go_into_an_output_when_standard_error_is_closed(recording: Path) -> None:
    command = f"{sys.executable} -m clsim convert {recording} - 2>&-"
    printed = subprocess.run(command, shell=True, check=True, stdout=subprocess.PIPE, text=True).stdout
    assert printed.count("\n") == 1000 and "clsim" not in printed


def test_info_names_what_a_file_is(clsim: Callable[..., object], tmp_path: Path, recording: Path) -> None:
    def told(path: Path) -> dict[str, dict[str, object]]:
        return dict(json.loads(clsim("info", path, "--json").stdout))

    assert told(recording)["events"]["format"] == "evt3"
    np.save(tmp_path / "a.npy", np.array([(1, 2, 3, True)], EVENT_DTYPE))
    assert told(tmp_path / "a.npy")["events"]["events"] == 1
    images = [Image.new("L", (32, 24), k) for k in (10, 200)]
    images[0].save(tmp_path / "a.gif", save_all=True, append_images=images[1:], duration=100)
    footage = told(tmp_path / "a.gif")["footage"]
    assert footage["resolution"] == [32, 24] and footage["transfer"] == "srgb" and footage["fps"] == 10
    for ending in (".aedat", ".mat", ".gif"):
        (tmp_path / f"b{ending}").write_bytes(b"nothing of the kind")
        outcome = clsim("info", tmp_path / f"b{ending}")
        assert outcome.status == 2 and "scene" not in outcome.stderr and outcome.stderr.count("\n") == 1


def test_order_is_told_and_strict_refuses(clsim: Callable[..., object], tmp_path: Path) -> None:
    rows = [(k, 1, 1, 1) for k in range(100)]
    rows[50], rows[60] = (10, 1, 1, 1), (5_000_000, 1, 1, 1)
    (tmp_path / "a.csv").write_text("t,x,y,p\n" + "\n".join(",".join(map(str, row)) for row in rows))
    outcome = clsim("convert", tmp_path / "a.csv", tmp_path / "b.csv")
    assert outcome.status == 0 and "1 event came after a later one and was put in order" in outcome.stderr
    assert "1 event was left out" in outcome.stderr and (tmp_path / "b.csv").read_text().count("\n") == 100
    outcome = clsim("convert", tmp_path / "a.csv", tmp_path / "c.csv", "--strict")
    assert outcome.status == 2 and "event 50 has time 10 µs, before 49 µs" in outcome.stderr
    assert not (tmp_path / "c.csv").exists()
    facts = json.loads(clsim("info", tmp_path / "a.csv", "--json").stdout)["events"]
    assert (facts["moved_events"], facts["dropped_events"]) == (1, 1)


def test_a_recording_that_begins_late_is_no_faster_for_it(clsim: Callable[..., object], tmp_path: Path) -> None:
    for k in range(3):
        Image.new("L", (16, 16), 60 + 60 * k).save(tmp_path / f"{k}.png")
    (tmp_path / "times.txt").write_text("3600.0\n3600.1\n3600.2\n")
    arguments = ["--times", tmp_path / "times.txt", "--out", tmp_path / "a.csv", "--json"]
    summary = json.loads(clsim("detect", tmp_path, *arguments).stdout)
    assert summary["simulated_s"] == pytest.approx(0.2)


def test_a_byte_order_mark_does_no_harm(tmp_path: Path) -> None:
    from clsim.footage.times import read_times_us
    from clsim.scene.trajectories.trajectory import read_tum
    from clsim.values import read_text

    pose = "0 0 0 0 0 0 0 1\n1 0 0 1 0 0 0 1\n"
    (tmp_path / "a.txt").write_text("\ufeff" + pose, encoding="utf-8")
    assert read_text(tmp_path / "a.txt", 1 << 20, "text") == pose
    assert read_times_us(tmp_path / "a.txt", "s") == [0, 1_000_000]
    assert read_tum(tmp_path / "a.txt") is not None


@pytest.mark.parametrize("encoding", ["array", "evt3"])
def test_messages_of_a_bag_are_of_the_kind_asked_for(
    clsim: Callable[..., Any], tmp_path: Path, recording: Path, encoding: str
) -> None:
    bag = tmp_path / "a.mcap"
    assert clsim("convert", recording, bag, "--ros-events", encoding).status == 0
    kinds = {"array": "dvs_msgs/msg/EventArray", "evt3": "event_camera_msgs/msg/EventPacket"}
    with AnyReader([bag]) as reader:
        assert kinds[encoding] in {each.msgtype for each in reader.connections}


def test_a_film_is_as_slow_as_asked_for(clsim: Callable[..., Any], tmp_path: Path) -> None:
    """A second of events, ten times slower, lasts ten seconds."""
    sink = open_sink(tmp_path / "a.npz", 4, 3)
    sink.write(np.array([(t, 1, 1, 1) for t in range(0, 1_000_001, 100_000)], EVENT_DTYPE), 1_000_000)
    sink.close()
    for speed, pictures in ((1, 6), (0.1, 51)):
        how = "--to", tmp_path / "a.gif", "--video-fps", 5, "--speed", speed
        outcome = clsim("view", tmp_path / "a.npz", *how)
        assert outcome.status == 0 and f"{pictures} pictures" in outcome.stderr


def test_a_file_that_is_cut_is_told_of_once_and_refused_if_strict(clsim: Callable[..., Any], tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("1 2 3 1\n5 6 7 0\n9 10")
    sentence = f"clsim: {path}: ends within a line, so it may be cut"
    done = clsim("convert", path, tmp_path / "b.dat")  # which reads it twice, once for its size
    assert done.status == 0 and done.stderr.count(sentence) == 1 and "2 events" in done.stderr
    for words in (("info", path), ("convert", path, tmp_path / "c.dat"), ("score", path, path)):
        done = clsim(*words, "--strict")
        assert done.status == 2 and f"{sentence}; expected a whole recording (refused by --strict)" in done.stderr
    assert not (tmp_path / "c.dat").exists()
