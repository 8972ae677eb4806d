"""Formats of recordings that are read and not written, against rules spelt out word by word and other readers."""

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from clsim.errors import InputError
from clsim.events.files import ONLY_READ, open_source
from clsim.events.formats.prophesee.evt2_words import Encoding, Evt2Decoder
from tests.events.event_data import HEIGHT, WIDTH, events

CASES = Path(__file__).parents[4] / "shared" / "cases"
REAL = Path(__file__).parents[4] / "shared" / "real"
EVENTS = events(2000, start_us=12_345)
T, X, Y, ON = (EVENTS[name].astype(np.int64) for name in ("t", "x", "y", "on"))


def openeb(encoding: Encoding, words: list[int]) -> list[tuple[int, int, int, bool]]:
    """Return what OpenEB's decoders make of words, one by one; of EVT4 and EVT2.1 a vector's pixels in a row."""
    found: list[tuple[int, int, int, bool]] = []
    high: int | None = None
    laps = 0
    off, time_high = (0xA, 0xE) if encoding == "evt4" else (0, 8)
    step, k = (1 if encoding in ("evt2", "evt4") else 2), 0
    while k + step <= len(words):
        head, mask = words[k], 1
        if encoding.startswith("evt21"):
            head, mask = (words[k], words[k + 1]) if encoding == "evt21-legacy" else (words[k + 1], words[k])
        kind = head >> 28
        k += step
        if encoding == "evt4" and kind in (0xC, 0xD):
            if k == len(words):
                break
            mask, k = words[k], k + 1
        if kind == time_high:
            value = head & 0xFFFFFFF
            laps += high is not None and high - value >= 1 << 27
            high = value
        elif kind in (off, off + 1) or (encoding == "evt4" and kind in (0xC, 0xD)):
            for bit in range(32):
                x, y = (head >> 11 & 0x7FF) + bit, head & 0x7FF
                if mask >> bit & 1 and high is not None and x < WIDTH and y < HEIGHT:
                    found.append(((laps << 34) + (high << 6) + (head >> 22 & 63), x, y, bool(kind & 1)))
    return found


def word(kind: int, low: int, x: int, y: int) -> int:
    return kind << 28 | low << 22 | x << 11 | y


KINDS = st.sampled_from([0, 1, 8, 0xA, 0xB, 0xC, 0xD, 0xE])
WORDS = st.one_of(
    st.builds(lambda kind, rest: kind << 28 | rest, KINDS, st.integers(0, 2**28 - 1)),
    st.builds(word, KINDS, st.integers(0, 63), st.integers(0, WIDTH + 2), st.integers(0, HEIGHT + 2)),
    st.sampled_from([0x80000000, 0x8FFFFFFF, 0xE0000000, 0xEFFFFFFF, 0xFFFFFFFF, 0xC0000000, 0xD0000001]),
)


@pytest.mark.parametrize("encoding", ["evt2", "evt21", "evt21-legacy", "evt4"])
@settings(deadline=None, max_examples=150)
@given(words=st.lists(WORDS, max_size=40), block=st.integers(1, 20))
def test_any_words_are_decoded_by_the_rules_of_openeb(encoding: Encoding, words: list[int], block: int) -> None:
    decoder = Evt2Decoder(encoding, WIDTH, HEIGHT)
    raw = np.array(words[: len(words) // 2 * 2], "<u4").tobytes()
    size = block * decoder.word_bytes
    parts = [decoder.decode(raw[start : start + size]) for start in range(0, len(raw), size)]
    assert [tuple(event) for part in parts for event in part.tolist()] == openeb(encoding, words[: len(words) // 2 * 2])


def evt(encoding: Encoding) -> tuple[bytes, bytes]:
    """Return the header and the words of EVENTS in an encoding."""
    head = np.stack([np.where(ON > 0, 1, 0) << 28 | (T & 63) << 22 | X << 11 | Y], axis=1)
    high = np.stack([8 << 28 | T >> 6], axis=1)
    words = np.concatenate([high, head], axis=1).ravel()
    told = f"height={HEIGHT};width={WIDTH}"
    if encoding == "evt2":
        return f"% evt 2.0\n% format EVT2;{told}\n% end\n".encode(), words.astype("<u4").tobytes()
    if encoding == "evt4":
        moved = np.concatenate([high + (6 << 28), head + (0xA << 28)], axis=1).ravel()
        return f"% format EVT4;{told}\n% end\n".encode(), moved.astype("<u4").tobytes()
    pairs = np.stack([words, np.ones(len(words), np.int64)], axis=1)
    if encoding == "evt21-legacy":
        return f"% evt 2.1\n% format EVT21;{told}\n% end\n".encode(), pairs.astype("<u4").tobytes()
    return f"% evt 2.1\n% format EVT21;endianness=little;{told}\n% end\n".encode(), pairs[:, ::-1].astype(
        "<u4"
    ).tobytes()


@pytest.mark.filterwarnings("ignore::clsim.errors.Notice")
@pytest.mark.parametrize("encoding", ["evt2", "evt21", "evt21-legacy", "evt4"])
def test_raw_files_tell_their_encoding(tmp_path: Path, encoding: Encoding) -> None:
    head, words = evt(encoding)
    (tmp_path / "a.raw").write_bytes(head + words + b"\1\2\3")  # and a torn word
    source = open_source(tmp_path / "a.raw")
    assert (source.format, source.width, source.height) == (encoding.removesuffix("-legacy"), WIDTH, HEIGHT)
    assert np.array_equal(source.read(), EVENTS)


def test_evt21_is_read_as_evlib_reads_it(tmp_path: Path) -> None:
    evlib = pytest.importorskip("evlib", reason="recent evlib has wheels for Python 3.11 and later only")
    head, words = evt("evt21")
    (tmp_path / "a.raw").write_bytes(head + words)
    frame = evlib.load_events(str(tmp_path / "a.raw")).collect()
    ours = open_source(tmp_path / "a.raw").read()
    assert np.array_equal(frame["t"].dt.total_microseconds().to_numpy(), ours["t"])
    assert np.array_equal(frame["x"].to_numpy(), ours["x"]) and np.array_equal(frame["y"].to_numpy(), ours["y"])


@pytest.mark.skipif(not CASES.is_dir(), reason="the shared cases are not beside the checkout")
def test_evt2_before_its_first_time_has_none_and_is_left_out() -> None:
    source = open_source(CASES / "pre.raw")
    found = source.read()
    assert (len(found), found["t"][0], source.dropped_events) == (100, 3_228_000_200, 40)


def test_dat_s_clock_begins_anew_and_version_1_has_fewer_bits(tmp_path: Path) -> None:
    words = np.array([[2**32 - 5, 1 | 2 << 14 | 2 << 28], [3, 4 | 5 << 14]], "<u4")
    (tmp_path / "a.dat").write_bytes(b"% Version 2\n% Width 9\n% Height 7\n" + bytes([0, 8]) + words.tobytes())
    source = open_source(tmp_path / "a.dat")
    assert source.read().tolist() == [(2**32 - 5, 1, 2, True), (2**32 + 3, 4, 5, False)]
    assert (source.width, source.height) == (9, 7)
    words = np.array([[7, 303 | 239 << 9 | 1 << 17], [8, 1 | 2 << 9]], "<u4")
    (tmp_path / "b.dat").write_bytes(b"% Data file\n" + bytes([0, 8]) + words.tobytes())
    assert open_source(tmp_path / "b.dat").read().tolist() == [(7, 303, 239, True), (8, 1, 2, False)]
    (tmp_path / "c.dat").write_bytes(b"% Version 2\n" + bytes([14, 8]) + words.tobytes())
    with pytest.raises(InputError, match="holds events of type 14 of 8 bytes; expected change-detection events"):
        open_source(tmp_path / "c.dat")


@pytest.mark.parametrize("ending", [".raw", ".dat"])
def test_a_sensor_of_no_pixels_in_a_header_is_one_that_nobody_told(tmp_path: Path, ending: str) -> None:
    """Converters that do not know the size write 0."""
    raw = b"% evt 2.0\n% geometry 0x0\n% end\n" + evt("evt2")[1]
    dat = np.stack([T, X | Y << 14 | ON << 28], axis=1).astype("<u4").tobytes()
    dat = b"% Version 2\n% Height 0\n% Width 0\n" + bytes([12, 8]) + dat
    (tmp_path / f"a{ending}").write_bytes(raw if ending == ".raw" else dat)
    source = open_source(tmp_path / f"a{ending}")
    assert (source.width, source.height) == (None, None)
    assert np.array_equal(source.read(), EVENTS)


def aedat2(chip: str, address: np.ndarray) -> bytes:
    records = np.zeros(len(T), [("address", ">u4"), ("t", ">u4")])
    records["address"], records["t"] = address, T
    head = b"#!AER-DAT2.0\r\n# Creation time: System.currentTimeMillis() 1695355587880\r\n# AEChip: " + chip.encode()
    return head + b"\r\n#<?xml version=1?>\r\n" + records.tobytes()


def test_aedat_2_of_a_davis_is_read_as_tonic_reads_it(tmp_path: Path) -> None:
    from tonic.io import read_davis_346

    address = (345 - X) << 12 | (259 - Y) << 22 | ON << 11
    path = tmp_path / "a.aedat"
    path.write_bytes(aedat2("eu.seebetter.ini.chips.davis.Davis346red", address))
    source = open_source(path)
    ours = source.read()
    assert (source.format, source.width, source.height) == ("aedat 2.0", 346, 260)
    assert np.array_equal(ours, EVENTS)
    _, _, theirs = read_davis_346(str(path))
    for name, column in (("x", ours["x"]), ("y", ours["y"]), ("t", ours["t"]), ("p", ours["on"])):
        assert np.array_equal(theirs[name], column)
    # Samples of frames and of inertial sensors, and special events, are no changes of brightness.
    address[::2] |= np.where(np.arange(len(T))[::2] % 4, 0x400, 0x80000000)
    path.write_bytes(aedat2("eu.seebetter.ini.chips.davis.Davis346red", address))
    assert np.array_equal(open_source(path).read(), EVENTS[1::2])


def test_aedat_2_of_a_dvs128_is_read_as_jaer_reads_it(tmp_path: Path) -> None:
    """Rows from below, columns mirrored, and 0 where brightness rose (jAER's DVS128.java)."""
    x, y = X % 128, Y % 128
    address = (127 - x) << 1 | (127 - y) << 8 | (1 - ON)
    for chip in ("ch.unizh.ini.jaer.chip.retina.DVS128", ""):  # older files do not tell
        (tmp_path / "a.aedat").write_bytes(aedat2(chip, address))
        found = open_source(tmp_path / "a.aedat").read()
        assert np.array_equal(np.stack([found["t"], found["x"], found["y"], found["on"]]), np.stack([T, x, y, ON]))
    (tmp_path / "a.aedat").write_bytes(aedat2("some.Cochlea", address))
    with pytest.raises(InputError, match="its chip is cochlea, whose addresses are not known; expected DVS128"):
        open_source(tmp_path / "a.aedat")


def aedat3(version: str = "3.1") -> bytes:
    records = np.stack([1 | ON << 1 | Y << 2 | X << 17, T & 0x7FFFFFFF], axis=1).astype("<u4")
    head = f"#!AER-DAT{version}\r\n#Format: RAW\r\n#Source 1: DAVIS346\r\n#Start-Time: now\r\n#!END-HEADER\r\n".encode()
    parts = []
    for laps, part in ((0, records[:1200]), (3, records[1200:])):
        parts.append(struct.pack("<hhiiiiii", 2, 1, 36, 0, 0, 2, 2, 2) + bytes(72))  # two of another kind
        parts.append(struct.pack("<hhiiiiii", 1, 1, 8, 4, laps, len(part) + 3, len(part), len(part)))
        parts.append(part.tobytes() + part[-3:].tobytes())  # room for three more, in which old ones stand
    return head + b"".join(parts)


def test_aedat_3_1_is_read_and_counts_its_laps(tmp_path: Path) -> None:
    path = tmp_path / "a.aedat"
    path.write_bytes(aedat3())
    source = open_source(path)
    found = source.read()
    assert (source.format, source.width, source.height) == ("aedat 3.1", 346, 260)
    expected = EVENTS.copy()
    expected["t"][1200:] += 3 << 31
    assert np.array_equal(found, expected)
    path.write_bytes(aedat3("3.0"))
    with pytest.raises(InputError, match=r"is AEDAT 3\.0; expected 3\.1, 2\.0 or 1\.0"):
        open_source(path)


def test_n_mnist_is_read_as_tonic_reads_it(tmp_path: Path) -> None:
    from tonic.io import events_struct, read_mnist_file

    t = np.sort(np.random.default_rng(0).integers(0, 300_000, 500))
    y = np.where(np.arange(500) % 50 == 49, 240, Y[:500] % 34)  # 240 marks that the clock has jumped
    data = (
        np.stack([X[:500] % 34, y, ON[:500] << 7 | t >> 16, t >> 8 & 255, t & 255], axis=1).astype(np.uint8).tobytes()
    )
    (tmp_path / "a.bin").write_bytes(data)
    found = open_source(tmp_path / "a.bin").read()
    theirs = read_mnist_file(str(tmp_path / "a.bin"), events_struct)
    assert len(found) == 490
    for name, column in (("x", found["x"]), ("y", found["y"]), ("t", found["t"]), ("p", found["on"])):
        assert np.array_equal(theirs[name], column)
    (tmp_path / "b.bin").write_bytes(data[:-1])
    with pytest.raises(InputError, match="2499 bytes are no events of 5 bytes"):
        open_source(tmp_path / "b.bin")


@pytest.mark.skipif(not REAL.is_dir(), reason="the shared recordings are not beside the checkout")
def test_a_real_digit_of_n_mnist() -> None:
    source = open_source(REAL / "nmnist" / "1.bs2")
    found = source.read()
    assert len(found) == 4681 and found["x"].max() < 34 and found["y"].max() < 34
    assert 300_000 < found["t"][-1] < 320_000 and source.dropped_events == source.moved_events == 0


def test_mat_of_version_7_3_is_read(tmp_path: Path) -> None:
    import h5py

    with h5py.File(tmp_path / "a.mat", "w", userblock_size=512) as file:
        for name, column in (("ts", T), ("x", X), ("y", Y), ("p", 2 * ON - 1)):
            file[f"TD/{name}"] = column[None].astype(np.float64)
    with (tmp_path / "a.mat").open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM")
    assert np.array_equal(open_source(tmp_path / "a.mat").read(), EVENTS)


@pytest.mark.parametrize(("kind", "name"), [(0, "generic"), (4, "color")])
def test_event_stream_s_other_kinds_are_named(tmp_path: Path, kind: int, name: str) -> None:
    size = struct.pack("<HH", 4, 3) if kind else b""
    (tmp_path / "a.es").write_bytes(b"Event Stream" + bytes([2, 0, 0, kind]) + size)
    with pytest.raises(InputError, match=f"holds Event Stream's events of the kind {name}"):
        open_source(tmp_path / "a.es")


def test_event_stream_of_an_atis_gives_its_changes(tmp_path: Path) -> None:
    """The others tell when a pixel's measurement of light crosses its thresholds."""
    records = [(1, False, True), (2, True, False), (3, False, False), (0, False, True)]
    body = b"".join(bytes([1 << 2 | on << 1 | crossing]) + struct.pack("<HH", x, 1) for x, crossing, on in records)
    (tmp_path / "a.es").write_bytes(b"Event Stream" + bytes([2, 0, 0, 2]) + struct.pack("<HH", 4, 3) + body)
    found = open_source(tmp_path / "a.es").read()
    assert found.tolist() == [(1, 1, 1, True), (3, 3, 1, False), (4, 0, 1, True)]


@pytest.mark.filterwarnings("ignore::clsim.errors.Notice")
@pytest.mark.parametrize("ending", [ending for each in ONLY_READ for ending in each.endings])
@settings(deadline=None, max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.binary(max_size=400), whole=st.sampled_from([b"", b"#!AER-DAT2.0\r\n", aedat3(), aedat2("x.DVS128", X)]))
def test_any_bytes_are_events_in_order_within_the_sensor_or_one_sentence(
    tmp_path: Path, ending: str, data: bytes, whole: bytes
) -> None:
    path = tmp_path / f"a{ending}"
    path.write_bytes(whole[: len(whole) // 2] + data)
    try:
        source = open_source(path)
        found = source.read()
    except InputError as error:
        assert str(path) in str(error) and "\n" not in str(error)
        return
    assert (np.diff(found["t"]) >= 0).all() and (found["t"] >= 0).all()
    assert source.width is None or not len(found) or found["x"].max() < source.width
    assert source.height is None or not len(found) or found["y"].max() < source.height


def test_what_is_only_read_is_not_written(tmp_path: Path) -> None:
    from clsim.events.files import open_sink

    for each in ONLY_READ:
        for ending in each.endings:
            with pytest.raises(InputError, match="are only read; expected"):
                open_sink(tmp_path / f"a{ending}", 9, 9)


def test_events_that_aedat_3_1_marks_as_not_valid_are_left_out(tmp_path: Path) -> None:
    raw = bytearray(aedat3())
    first = raw.index(np.array([1 | ON[0] << 1 | Y[0] << 2 | X[0] << 17, T[0]], "<u4").tobytes())
    for number in (0, 7, 8):
        raw[first + 8 * number] &= 0xFE
    (tmp_path / "a.aedat").write_bytes(raw)
    found = open_source(tmp_path / "a.aedat").read()
    assert np.array_equal(found[:1197], np.delete(EVENTS[:1200], (0, 7, 8)))


def test_n_mnist_s_clock_goes_on_from_portion_to_portion(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [(1, 240 if k % 3 == 2 else 2, 0, 0, k) for k in range(12)]
    (tmp_path / "a.bin").write_bytes(np.array(rows, np.uint8).tobytes())
    whole = open_source(tmp_path / "a.bin").read()
    monkeypatch.setattr("clsim.events.formats.nmnist.CHUNK_EVENTS", 2)
    assert np.array_equal(open_source(tmp_path / "a.bin").read(), whole)
    assert whole["t"].tolist() == [k + (k // 3 << 13) for k in range(12) if k % 3 < 2]


def test_dat_of_version_1_has_9_bits_of_x_8_of_y_and_one_of_polarity(tmp_path: Path) -> None:
    """Any event of an ATIS, of 304 × 240 pixels: no bit of one number is taken for one of another."""
    x, y = X % 304, Y % 240
    words = np.stack([T, x | y << 9 | ON << 17], axis=1).astype("<u4")
    (tmp_path / "a.dat").write_bytes(b"% Version 1\n" + bytes([0, 8]) + words.tobytes())
    found = open_source(tmp_path / "a.dat").read()
    assert np.array_equal(np.stack([found["t"], found["x"], found["y"], found["on"]]), np.stack([T, x, y, ON]))


DAVIS_SIZES = {"128": (128, 128), "208": (208, 192), "240C": (240, 180), "346red": (346, 260), "640": (640, 480)}
"""Of the chips of jAER's package ``eu.seebetter.ini.chips.davis``, in pixels."""


@pytest.mark.parametrize("chip", DAVIS_SIZES)
def test_all_pixels_of_each_davis_are_read(tmp_path: Path, chip: str) -> None:
    width, height = DAVIS_SIZES[chip]
    x, y = X % width, Y % height
    x[:4], y[:4] = (0, width - 1, 0, width - 1), (0, 0, height - 1, height - 1)
    address = (width - 1 - x) << 12 | (height - 1 - y) << 22 | ON << 11
    (tmp_path / "a.aedat").write_bytes(aedat2(f"eu.seebetter.ini.chips.davis.Davis{chip}", address))
    source = open_source(tmp_path / "a.aedat")
    assert (source.width, source.height) == (width, height)
    found = source.read()
    assert np.array_equal(np.stack([found["x"], found["y"], found["on"]]), np.stack([x, y, ON]))


@pytest.mark.parametrize("version", ["1.0", "2.0"])
def test_special_events_of_an_old_dvs128_are_no_changes_and_leave_it_known(tmp_path: Path, version: str) -> None:
    """Files from before jAER told the chip: its 16 bits of address, of which the highest marks special events."""
    x, y = X % 128, Y % 128
    address = (127 - x) << 1 | (127 - y) << 8 | (1 - ON)
    special = np.arange(len(T)) % 7 == 3
    records = np.zeros(len(T), [("address", ">u2" if version == "1.0" else ">u4"), ("t", ">u4")])
    records["address"], records["t"] = np.where(special, address | 0x8000, address), T
    (tmp_path / "a.aedat").write_bytes(f"#!AER-DAT{version}\r\n# of 2008\r\n".encode() + records.tobytes())
    source = open_source(tmp_path / "a.aedat")
    assert (source.width, source.height) == (128, 128)
    found = source.read()
    expected = np.stack([T, x, y, ON])[:, ~special]
    assert np.array_equal(np.stack([found["t"], found["x"], found["y"], found["on"]]), expected)
