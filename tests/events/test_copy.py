import json
import socket
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import clsim
from clsim.errors import InputError
from clsim.events import EventBatch, SinkError, whole
from clsim.events.batch import Labelling
from clsim.events.copy import Copied, convert_events
from clsim.events.files import open_sink
from clsim.events.formats.dv_stream import DvEncoder
from clsim.events.formats.tables import text
from clsim.events.open import sensor_size
from clsim.events.sidecar import read_sidecar, sidecar_size
from clsim.events.socket_sinks import open_socket_sink
from tests.events.event_data import end_of
from tests.live.view.view_events import random_events

WIDTH, HEIGHT = 40, 30
EVENTS = random_events(20_000, WIDTH, HEIGHT)
EVENTS.sort(order=["t", "y", "x"])


def record(path: Path) -> Path:
    sink = open_sink(path, WIDTH, HEIGHT)
    sink.write(EVENTS, end_of(EVENTS))
    sink.close()
    return path


def read(path: Path) -> EventBatch:
    with clsim.open(path) as source:
        return np.concatenate(list(source))


@pytest.mark.parametrize("target", ["b.txt", "b.csv", "b.aedat4", "b.raw", "b.npz", "b.h5"])
@pytest.mark.parametrize("source", ["a.aedat4", "a.txt"])
def test_every_event_arrives(tmp_path: Path, source: str, target: str) -> None:
    heard: list[Copied] = []
    name = record(tmp_path / source)
    done = convert_events(str(name), str(tmp_path / target), (WIDTH, HEIGHT), heard.append)
    assert done == heard[-1] == Copied(len(EVENTS), EVENTS["t"][-1])
    assert np.array_equal(read(tmp_path / target), EVENTS)
    assert sidecar_size(read_sidecar(tmp_path / target)) == (WIDTH, HEIGHT)


@pytest.mark.parametrize("labels", [("cause",), ("cause", "object")])
@pytest.mark.parametrize(("source", "target"), [("a.h5", "b.parquet"), ("a.parquet", "b.h5"), ("a.h5", "b.h5")])
def test_labels_come_along_where_both_formats_hold_them(
    tmp_path: Path, source: str, target: str, labels: tuple[str, ...]
) -> None:
    given = {"cause": np.arange(len(EVENTS)) % 4, "object": np.arange(len(EVENTS)) * 7}
    sink = open_sink(tmp_path / source, WIDTH, HEIGHT, labels=labels)
    assert isinstance(sink, Labelling)
    sink.write(EVENTS, end_of(EVENTS), *(given[name] for name in labels))
    sink.close()
    assert convert_events(str(tmp_path / source), str(tmp_path / target)).lost_labels == ()
    one = labels[0] if len(labels) == 1 else labels  # a single one needs no brackets
    with clsim.open(tmp_path / target, labels=one) as found:
        assert found.labelled == labels
        events = found.read()
    for name, column in [*((name, EVENTS[name]) for name in "txy"), *((name, given[name]) for name in labels)]:
        np.testing.assert_array_equal(events[name], column)
    # Where they have no place, that is told.
    assert convert_events(str(tmp_path / source), str(tmp_path / "b.txt")).lost_labels == labels
    assert np.array_equal(read(tmp_path / "b.txt"), EVENTS)


def test_the_sidecar_comes_along_and_tells_the_size(tmp_path: Path) -> None:
    record(tmp_path / "a.txt")
    about = {"camera": {"width": 99, "height": 77, "fov_deg": 60}, "options": {"spp": 4}, "clsim_version": "old"}
    (tmp_path / "a.txt.json").write_text(json.dumps(about))
    convert_events(str(tmp_path / "a.txt"), str(tmp_path / "b.aedat4"))
    told = json.loads((tmp_path / "b.aedat4.json").read_text())
    assert told == about | {"converted_from": str(tmp_path / "a.txt"), "events": len(EVENTS)}
    with clsim.open(tmp_path / "b.aedat4") as source:
        assert (source.width, source.height) == (99, 77)


@pytest.mark.parametrize(
    ("key", "place", "expected"),
    [
        ("poses", "a.txt.poses.txt", "../../in/a.txt.poses.txt"),
        ("scene_from_here", "../room.toml", "../../room.toml"),
        ("scene_from_here", None, None),
    ],
)
def test_paths_in_the_sidecar_lead_to_the_same_files_from_another_folder(
    tmp_path: Path, key: str, place: str | None, expected: str | None
) -> None:
    for folder in ("in", "out/later"):
        (tmp_path / folder).mkdir(parents=True)
    source = record(tmp_path / "in" / "a.txt")
    Path(f"{source}.json").write_text(json.dumps({key: place}))
    convert_events(str(source), str(tmp_path / "out/later/b.txt"))
    assert json.loads((tmp_path / "out/later/b.txt.json").read_text())[key] == expected


def test_the_size_is_found_out_where_nothing_tells_it(tmp_path: Path) -> None:
    name = str(record(tmp_path / "a.txt"))
    with clsim.open(name) as source:
        assert sensor_size(name, source, None) == (EVENTS["x"].max() + 1, EVENTS["y"].max() + 1)
        assert sensor_size(name, source, (640, 480)) == (640, 480)
    Path(f"{name}.json").write_text('{"camera": {"width": -3, "height": "many"}}')
    with clsim.open(name) as source:
        assert sensor_size(name, source, None) == (EVENTS["x"].max() + 1, EVENTS["y"].max() + 1)


@pytest.mark.parametrize("at", [0, 20_000, -1])
def test_the_farthest_pixels_count_wherever_in_the_file_they_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, at: int
) -> None:
    monkeypatch.setattr("clsim.events.formats.tables.npy.CHUNK_EVENTS", 10_000)
    events = np.concatenate([EVENTS] * 3)
    events["t"].sort()
    events["x"][at], events["y"][at] = 345, 259
    np.save(tmp_path / "a.npy", events)
    with clsim.open(tmp_path / "a.npy") as source:
        assert sensor_size(str(tmp_path / "a.npy"), source, None) == (346, 260)


@pytest.mark.parametrize(("width", "height"), [(1, 1), (1, 65_536), (65_536, 1), (346, 260)])
def test_a_sidecar_tells_the_size_of_any_sensor_that_events_have_room_for(width: int, height: int) -> None:
    assert sidecar_size({"camera": {"width": width, "height": height}}) == (width, height)
    for wrong in ((0, height), (width, 0), (65_537, height), (width, 65_537)):
        assert sidecar_size({"camera": dict(zip(("width", "height"), wrong, strict=True))}) is None


def test_a_folder_may_have_the_mark_of_topics_in_its_name(tmp_path: Path) -> None:
    (tmp_path / "left#").mkdir()
    name = f"{record(tmp_path / 'left#' / 'a.h5')}"
    assert np.array_equal(read(Path(name)), EVENTS)
    assert convert_events(name, str(tmp_path / "b.txt")).events == len(EVENTS)


@pytest.mark.parametrize(
    ("text", "target", "sentence"),
    [
        (None, "b.txt", "a.txt"),
        ("no events\n", "b.txt", "a.txt"),
        ("1 2 3 1\n", "b.what", "b.what.*ending"),
        ("1 2 3 1\n", "no/b.txt", "no/b.txt.*there is no folder"),
        ("1 2 3 1\n", "a.txt", "another name"),
        ("", "b.txt", "no events"),
    ],
)
def test_what_fails_at_open_leaves_nothing_behind(tmp_path: Path, text: str | None, target: str, sentence: str) -> None:
    if text is not None:
        (tmp_path / "a.txt").write_text(text)
    before = sorted(tmp_path.iterdir())
    with pytest.raises(InputError, match=sentence):
        convert_events(str(tmp_path / "a.txt"), str(tmp_path / target))
    assert sorted(tmp_path.iterdir()) == before
    if text is not None:
        assert (tmp_path / "a.txt").read_text() == text


def test_a_source_that_is_damaged_later_leaves_nothing_behind(tmp_path: Path) -> None:
    name = record(tmp_path / "a.txt")
    with name.open("a") as file:
        file.write("9999999 1 zwei 1\n" + "9999999 1 2 1\n" * 3)
    # The size is given: without it, the search for it would already find the damage.
    with pytest.raises(InputError, match=r"a\.txt"):
        convert_events(str(name), str(tmp_path / "b.txt"), (WIDTH, HEIGHT))
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def test_a_target_that_fails_later_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class FullDisk:
        def write(self, batch: EventBatch, end_us: int) -> None:
            raise SinkError("b.txt: no space left")

        def close(self) -> None:
            raise SinkError("b.txt: still none")

    def open_full(name: str, width: int, height: int, options: object) -> FullDisk:
        Path(name).touch()
        return FullDisk()

    monkeypatch.setattr(whole, "open_output", open_full)
    name = record(tmp_path / "a.aedat4")
    with pytest.raises(SinkError, match="no space left"):
        convert_events(str(name), str(tmp_path / "b.txt"))
    assert [path.name for path in tmp_path.iterdir()] == ["a.aedat4"]


@pytest.mark.parametrize("interrupted", [False, True])
def test_a_stream_is_recorded_to_its_end_or_to_ctrl_c(tmp_path: Path, interrupted: bool) -> None:
    server = open_socket_sink(f"unix://{tmp_path}/events.sock", WIDTH, HEIGHT)
    sent = threading.Event()

    def serve() -> None:
        server.wait_for_clients(1, 10)
        for start in range(0, len(EVENTS), 500):
            server.write(EVENTS[start : start + 500], end_of(EVENTS[start : start + 500]))
        if not interrupted:
            time.sleep(0.05)
            server.close()
        sent.set()

    def progress(copied: Copied) -> None:
        if interrupted and copied.events == len(EVENTS):
            raise KeyboardInterrupt

    thread = threading.Thread(target=serve)
    thread.start()
    target = tmp_path / "b.aedat4"
    try:
        if interrupted:
            with pytest.raises(KeyboardInterrupt):
                convert_events(f"unix://{tmp_path}/events.sock", str(target), None, progress)
        else:
            convert_events(f"unix://{tmp_path}/events.sock", str(target), None, progress)
    finally:
        thread.join(10)
        server.close()
    assert sent.is_set() and np.array_equal(read(target), EVENTS)
    assert json.loads(Path(f"{target}.json").read_text())["events"] == len(EVENTS)


def test_a_stream_that_breaks_off_leaves_a_recording_with_its_sidecar(tmp_path: Path) -> None:
    encoder = DvEncoder(WIDTH, HEIGHT)
    data = encoder.header + b"".join(packet for packet, _ in encoder.packets(EVENTS[:1000])) + b"\xff" * 8
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
        listener.bind(f"{tmp_path}/s")
        listener.listen()

        def serve() -> None:
            with listener.accept()[0] as connection:
                connection.sendall(data)

        thread = threading.Thread(target=serve)
        thread.start()
        with pytest.raises(InputError, match="a packet claims -1 bytes"):
            convert_events(f"unix://{tmp_path}/s", str(tmp_path / "b.txt"))
        thread.join(10)
    assert np.array_equal(read(tmp_path / "b.txt"), EVENTS[:1000])
    assert json.loads((tmp_path / "b.txt.json").read_text())["events"] == 1000


@pytest.mark.parametrize(("fitting", "last_us"), [([0x2001, 0x2002], (1 << 12) + 7), ([], 0)])
def test_events_left_out_after_the_last_that_fit_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fitting: list[int], last_us: int
) -> None:
    monkeypatch.setattr("clsim.events.formats.prophesee.evt3_words._BLOCK_WORDS", 5)
    words = [0x8001, 0x6007, 3, *fitting] + [0x2000 | WIDTH] * 12
    head = f"% evt 3.0\n% geometry {WIDTH}x{HEIGHT}\n% end\n".encode()
    (tmp_path / "a.raw").write_bytes(head + np.array(words, "<u2").tobytes())
    assert convert_events(str(tmp_path / "a.raw"), str(tmp_path / "b.txt")) == Copied(len(fitting), last_us, 12)


def test_a_source_without_labels_is_opened_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It may be a pipe, which gives its events to who opens it first."""
    source, opened = tmp_path / "a.txt", []
    source.write_text("0.001 3 4 1\n0.002 5 6 0\n")
    read_text = text.open_source
    monkeypatch.setattr(text, "open_source", lambda path: opened.append(path) or read_text(path))
    assert convert_events(str(source), str(tmp_path / "b.h5"), (WIDTH, HEIGHT)).events == 2
    assert opened == [source]
