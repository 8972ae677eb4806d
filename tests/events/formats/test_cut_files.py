"""Files whose end is missing: what is whole is read, one warning tells of it, and strict reading refuses them."""

import json
import struct
import warnings
from pathlib import Path

import numpy as np
import pytest

import clsim
from clsim.errors import InputError, Notice
from clsim.events.formats.filesink import FlushPolicy
from tests.events.event_data import HEIGHT, WIDTH, events, write

EVENTS = events(300)
_LZ4 = struct.pack("<I", 0x184D2204)


def told(path: Path) -> tuple[int, list[str]]:
    """Return how many events a file has, and which notices reading it brought."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        count = len(clsim.open(path).read())
    assert all(issubclass(each.category, Notice) for each in caught)
    return count, [str(each.message).removeprefix(f"{path}: ") for each in caught]


@pytest.mark.parametrize(
    ("ending", "less", "where"),
    [
        (".aedat4", 0, "before its data table"),
        (".aedat4", 5, "within a packet"),
        (".txt", 4, "within a line"),
        (".csv", 4, "within a line"),
        (".raw", 1, "within a word"),
        (".evt3.raw", 1, "within a word"),
        (".dat", 3, "within an event"),
        (".es", 1, "within an event"),
        (".es", 4, "within an event"),
    ],
)
def test_a_cut_file_is_read_with_one_warning_and_refused_if_strict(
    tmp_path: Path, ending: str, less: int, where: str
) -> None:
    path = write(tmp_path / f"a{ending}", [EVENTS], flush=FlushPolicy(events=50))
    assert told(path) == (len(EVENTS), [])
    whole = path.read_bytes()
    if ending == ".aedat4":  # the last two that are compressed are a packet, behind its head of 8 bytes, and the table
        table = whole.rindex(_LZ4)
        whole = whole[: table if less else whole.rindex(_LZ4, 0, table) - 8]
    path.write_bytes(whole[: len(whole) - less])
    count, sentences = told(path)
    assert len(EVENTS) - 51 < count <= len(EVENTS) and sentences == [f"ends {where}, so it may be cut"]
    with pytest.raises(InputError, match=f"ends {where}, so it may be cut; expected a whole recording"):
        clsim.open(path, strict=True).read()


def test_aedat_of_others_and_evt4_tell_it_too(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat"
    path.write_bytes(b"#!AER-DAT2.0\r\n# AEChip: DVS128\r\n" + struct.pack(">4I", 2, 5, 4, 6)[:-1])
    assert told(path) == (1, ["ends within an event, so it may be cut"])
    packet = struct.pack("<hhiiiiii", 1, 0, 8, 4, 0, 2, 2, 2) + struct.pack("<4I", 3, 5, 3, 6)
    special = struct.pack("<hhiiiiii", 0, 0, 8, 4, 0, 2, 2, 2) + bytes(16)
    for data, count in ((packet[:-8], 1), (packet + packet[:9], 2), (packet + special[:-1], 2)):
        path.write_bytes(b"#!AER-DAT3.1\r\n#Source 1: DVS128\r\n#!END-HEADER\r\n" + data)
        assert told(path) == (count, ["ends within a packet, so it may be cut"])
    path.write_bytes(b"#!AER-DAT3.1\r\n#Source 1: DVS128\r\n#!END-HEADER\r\n" + packet + special)
    assert told(path) == (2, [])
    raw = tmp_path / "a.raw"
    raw.write_bytes(
        b"% evt 4.0\n% format EVT4;height=9;width=9\n% end\n" + struct.pack("<3I", 0xE << 28, 0xA << 28, 0xC << 28)
    )
    assert told(raw) == (1, ["ends within a vector of events, so it may be cut"])


def test_what_others_write_at_the_end_is_no_cut(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    for end in ("", "\n", " ", "\n# all", "\n\n"):
        path.write_text(f"1 2 3 1\n4 5 6 0{end}")
        assert told(path) == (2, [])
    es = write(tmp_path / "a.es", [EVENTS])
    es.write_bytes(es.read_bytes() + b"\xff" * 7)  # time goes on
    assert told(es) == (len(EVENTS), [])


@pytest.mark.parametrize(
    ("about", "sentence"),
    [
        ({"summary": {"events": 300}, "complete": False}, None),  # Ctrl-C
        ({"summary": {"events": 1300}}, "has 300 events, but {} tells of 1,300, so it may be cut"),
        ({"summary": {"events": 200}}, "has 300 events, but {} tells of 200, so the two may be of different runs"),
        ({"summary": {"events": 7}, "converted_from": "b.txt", "events": 300}, None),
        (
            {"complete": False},
            "its run has not ended, or was killed, as {} tells, so that its last events may be missing",
        ),
        ({"summary": {"events": "many"}}, None),
    ],
)
def test_a_sidecar_that_tells_otherwise(tmp_path: Path, about: dict[str, object], sentence: str | None) -> None:
    path = write(tmp_path / "a.dat", [EVENTS])
    sidecar = tmp_path / "a.dat.json"
    sidecar.write_text(json.dumps({"clsim_version": "1"} | about))
    assert told(path) == (300, [] if sentence is None else [sentence.format(sidecar)])
    sidecar.write_text(json.dumps(about))  # not ours
    assert told(path) == (300, [])


@pytest.mark.parametrize("ending", [".aedat4", ".dat", ".h5"])
def test_what_is_older_than_ten_milliseconds_is_in_the_file(tmp_path: Path, ending: str) -> None:
    part = EVENTS[:60].copy()
    part["t"] = 1_000_000 + 1000 * np.arange(len(part))
    with clsim.write(tmp_path / f"a{ending}", WIDTH, HEIGHT) as sink:
        for k, end_us in enumerate(part["t"].tolist()):
            sink.write(part[k : k + 1], end_us)
            if k % 7 == 6:
                assert told(tmp_path / f"a{ending}")[0] >= np.count_nonzero(part["t"] <= end_us - 10_000)


def test_a_file_that_grows_is_read_as_far_as_it_is(tmp_path: Path) -> None:
    with clsim.write(tmp_path / "a.aedat4", WIDTH, HEIGHT) as sink:
        for start in range(0, 300, 100):
            part = EVENTS[start : start + 100]
            sink.write(part, int(part["t"][-1]) + 10_000)
            assert told(tmp_path / "a.aedat4") == (start + 100, [])
