"""Files that could mean several things: they are read by what they say, or refused."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import faery
import h5py
import numpy as np
import pytest
from scipy.io import savemat

from clsim.errors import InputError, Notice
from clsim.events.files import open_source
from clsim.events.formats.columns import from_columns

_AEDAT_2 = b"#!AER-DAT2.0\r\n# AEChip: eu.seebetter.ini.chips.davis.DAVIS240C\r\n"
_AEDAT_3 = b"#!AER-DAT3.1\r\n#Format: RAW\r\n#Source 1: DVS128\r\n#Source 2: DAVIS346\r\n#!END-HEADER\r\n"


@pytest.mark.parametrize(
    ("units", "us"),
    [
        (("second", "secs"), 1_000_000),
        (("msec", "millis", "millisecond", "Milliseconds"), 1000),
        (("microsec", "microsecond", "Microseconds", "\u03bcs", "\u00b5s"), 1),
    ],
)
@pytest.mark.parametrize("mark", ["t [{}]", "t_{}", "timestamp ({})"])
def test_a_unit_may_be_written_out(tmp_path: Path, mark: str, units: tuple[str, ...], us: int) -> None:
    for unit in units:
        (tmp_path / "a.csv").write_text(f"{mark.format(unit)},x,y,p\n0,1,2,1\n4000,1,2,0\n", encoding="utf-8")
        assert open_source(tmp_path / "a.csv").read()["t"].tolist() == [0, 4000 * us]
    for unit in ("nanosec", "nanosecond", "Nanoseconds"):
        (tmp_path / "a.csv").write_text(f"{mark.format(unit)},x,y,p\n0,1,2,1\n4000,1,2,0\n")
        assert open_source(tmp_path / "a.csv").read()["t"].tolist() == [0, 4]


def test_microseconds_in_latin_1_are_microseconds(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(b"t [\xb5s],x,y,p\n4000,1,2,1\n")
    assert open_source(tmp_path / "a.csv").read()["t"].tolist() == [4000]


@pytest.mark.parametrize("name", ["t [ticks]", "timestamp (10 us)", "t [1e-6 s]", "time [min]"])
def test_a_unit_that_is_not_known_is_refused_and_not_taken_for_microseconds(tmp_path: Path, name: str) -> None:
    (tmp_path / "a.csv").write_text(f"x,{name},y,p\n1,4000,2,1\n")
    with pytest.raises(InputError, match=r"names t in a unit that is not known: .*; expected s, ms, us or ns"):
        open_source(tmp_path / "a.csv").read()


@pytest.mark.parametrize("end", ["\r", "\u2028", "\x0b"])
def test_lines_that_end_in_another_way_are_not_passed_over_with_the_names(tmp_path: Path, end: str) -> None:
    lines = ["t,x,y,p", *(f"{1000 * k},1,2,1" for k in range(20))]
    (tmp_path / "a.csv").write_text(end.join(lines) + end, encoding="utf-8", newline="")
    with pytest.raises(InputError, match=r"a\.csv: "):
        open_source(tmp_path / "a.csv").read()


def test_polarities_of_three_kinds_are_refused() -> None:
    """0 is a fall beside 1, and no polarity beside -1."""
    row = np.arange(4)
    for polarity in ([0, -1, 0, -1], [1, -1, 0, 1]):
        with pytest.raises(InputError, match="column p has both 0 and -1; expected 0 and 1, or -1 and 1"):
            from_columns(row, row, row, np.array(polarity))
    for fine, on in (([-1, 1, 1, -1], [0, 1, 1, 0]), ([0, 0, 0, 0], [0] * 4), ([-1, -1, -1, -1], [0] * 4)):
        assert from_columns(row, row, row, np.array(fine))["on"].tolist() == on


@pytest.mark.parametrize("end", [b"", b"#End Of ASCII Header\r\n", b"# End of ASCII Header\r\n"])
@pytest.mark.parametrize("row", [39, 38, 100])
def test_an_event_whose_first_byte_is_a_hash_is_no_line_of_the_header(tmp_path: Path, end: bytes, row: int) -> None:
    """Those of four rows are: '#' is 35, and rows count from below, at bit 22."""
    assert (0x23 << 24) >> 22 == 179 - 39
    times = np.arange(300) * 1000
    address = np.full(300, (179 - row) << 22 | (239 - 7) << 12 | 1 << 11)
    events = np.stack([address, times], axis=1).astype(">u4").tobytes()
    (tmp_path / "a.aedat").write_bytes(_AEDAT_2 + end + events)
    found = open_source(tmp_path / "a.aedat").read()
    assert found["t"].tolist() == times.tolist() and set(found["y"]) == {row} and set(found["x"]) == {7}


def packet(kind: int, source: int, times: list[int], x: int) -> bytes:
    events = b"".join(struct.pack("<II", x << 17 | 5 << 2 | 1, t) for t in times)
    return struct.pack("<hhiiiiii", kind, source, 8, 4, 0, len(times), len(times), len(times)) + events


@pytest.mark.parametrize(("first", "other", "size"), [(1, 2, (128, 128)), (2, 1, (346, 260))])
def test_of_several_sources_the_first_is_read(tmp_path: Path, first: int, other: int, size: tuple[int, int]) -> None:
    """As of streams in AEDAT 4: events of two cameras are no recording of one."""
    parts = [packet(1, first, [0, 10], 70), packet(1, other, [5, 12], 100), packet(1, first, [20], 70)]
    (tmp_path / "a.aedat").write_bytes(_AEDAT_3 + b"".join(parts))
    found = open_source(tmp_path / "a.aedat")
    assert (found.width, found.height) == size
    assert [(int(e["t"]), int(e["x"])) for e in found.read()] == [(0, 70), (10, 70), (20, 70)]


def test_packets_that_caer_compressed_are_refused_and_those_of_frames_left_out(tmp_path: Path) -> None:
    """Its output marks them by the highest bit of their type, and tells their bytes in place of their capacity."""
    frames = struct.pack("<hhiiiiii", 2 - 0x8000, 2, 4000, 4, 0, 50, 1, 1) + bytes(50)
    (tmp_path / "a.aedat").write_bytes(_AEDAT_3 + frames + packet(1, 2, [0, 10], 300))
    assert open_source(tmp_path / "a.aedat").read()["t"].tolist() == [0, 10]
    events = struct.pack("<hhiiiiii", 1 - 0x8000, 2, 8, 4, 0, 50, 9, 9) + bytes(50)
    for before in (b"", packet(1, 2, [0, 10], 300)):
        (tmp_path / "a.aedat").write_bytes(_AEDAT_3 + before + events)
        with pytest.raises(InputError, match="a packet of events is compressed, expected cAER's format RAW"):
            open_source(tmp_path / "a.aedat").read()


def test_a_mat_of_several_structs_of_events_is_refused(tmp_path: Path) -> None:
    """Of an ATIS there are changes and measurements, of two cameras left and right."""
    row = np.arange(5)
    one = {"x": row, "y": row, "p": row % 2, "ts": row}
    savemat(tmp_path / "a.mat", {"note": 3, "TD": one, "EM": {"n": 1}})
    assert len(open_source(tmp_path / "a.mat").read()) == 5
    savemat(tmp_path / "a.mat", {"EM": one | {"x": row + 1}, "all": {"TD": one}})
    with pytest.raises(InputError, match=r"a\.mat: .*EM, all\.TD each hold events; expected one of them alone"):
        open_source(tmp_path / "a.mat").read()


def test_hdf5_whose_columns_end_at_several_rows_tells_that_it_may_be_cut(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, rows in {"t": 9, "x": 9, "y": 8, "p": 7}.items():
            file[f"events/{name}"] = np.arange(rows) % (2 if name == "p" else 100)
    with pytest.warns(Notice, match=r"a\.h5: ends at row 7, and some of its columns at row 9, so it may be cut"):
        assert len(open_source(tmp_path / "a.h5").read()) == 7
    with pytest.raises(InputError, match="refused by `strict`"):
        open_source(tmp_path / "a.h5", strict=True).read()


def test_hdf5_may_tell_the_sensor_beside_its_columns(tmp_path: Path) -> None:
    """As the data sets that Prophesee's detectors are trained with."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.update({f"events/{name}": np.arange(3) % 2 for name in "txyp"})
        file["events/height"], file["events/width"] = 720, 1280
    found = open_source(tmp_path / "a.h5")
    assert (found.width, found.height) == (1280, 720)


@pytest.mark.parametrize("compressed", [False, True])
def test_a_mat_whose_elements_lie_in_no_order_is_refused(tmp_path: Path, compressed: bool) -> None:
    """SciPy ended the process at an element of a kind that is none, and at one whose length reaches too far."""
    row = np.arange(30)
    savemat(tmp_path / "a.mat", {"t": row, "x": row, "y": row, "p": row % 2})
    data = (tmp_path / "a.mat").read_bytes()
    size = struct.unpack_from("<I", data, 132)[0]
    for at, value in ((152, 0x63), (176, 0xC8), (180, 1 << 20), (132, 1 << 30), (132, 20)):
        bad = bytearray(data[: 136 + size])
        struct.pack_into("<I", bad, at, value)
        if compressed:
            body = zlib.compress(bad[128:])
            bad = bad[:128] + struct.pack("<II", 15, len(body)) + body
        (tmp_path / "b.mat").write_bytes(bad)
        with pytest.raises(InputError, match=r"b\.mat: is damaged or of another format"):
            open_source(tmp_path / "b.mat").read()


def test_text_of_faery_has_the_sensor_in_its_names(tmp_path: Path) -> None:
    events = np.zeros(3, faery.EVENTS_DTYPE)
    events["t"], events["x"], events["y"], events["on"] = [500, 1500, 2500], [63, 0, 5], [0, 47, 5], [1, 0, 1]
    faery.events_stream_from_array(events, (64, 48)).to_file(tmp_path / "a.csv")
    found = open_source(tmp_path / "a.csv")
    assert (found.width, found.height) == (64, 48)
    assert [tuple(event) for event in found.read().tolist()] == [tuple(event) for event in events.tolist()]
