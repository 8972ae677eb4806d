"""What we write is read by libraries that did not write it, event for event; what others write is read by us."""

import struct
from itertools import pairwise
from pathlib import Path

import aedat
import dv_processing as dv
import evt3
import faery
import h5py
import numpy as np
import pyarrow.parquet
import pytest
from expelliarmus import Wizard
from hypothesis import given, settings
from hypothesis import strategies as st

from clsim.errors import InputError
from clsim.events import EVENT_DTYPE, EventBatch
from clsim.events.files import open_source
from clsim.events.formats.aedat4 import read_frames
from clsim.events.formats.dv_stream import AEDAT4_MAGIC, Compression, pack_header
from clsim.events.formats.filesink import FlushPolicy
from clsim.events.formats.prophesee.evt3_words import Evt3Decoder, Evt3Encoder
from tests.events.event_data import HEIGHT, WIDTH, events, read, split, write

EVENTS = events(4000)


def same(expected: EventBatch, t, x, y, on) -> bool:
    """Compare whatever columns a library gives with a batch."""
    columns = {"t": t, "x": x, "y": y, "on": np.asarray(on) > 0}
    return all(np.array_equal(expected[name], np.asarray(column).astype(np.int64)) for name, column in columns.items())


def dv_events(path: Path) -> EventBatch:
    recording = dv.io.MonoCameraRecording(str(path))
    assert tuple(recording.getEventResolution()) == (WIDTH, HEIGHT)
    batches = []
    while (batch := recording.getNextEventBatch()) is not None:
        batches.append(batch.numpy())
    return np.concatenate(batches) if batches else np.empty(0, dv.EventStore().numpy().dtype)


def evlib_columns(path: Path):
    evlib = pytest.importorskip("evlib", reason="recent evlib has wheels for Python 3.11 and later only")
    frame = evlib.load_events(str(path)).collect()
    t = frame["t"].dt.total_microseconds()
    return t.to_numpy(), frame["x"].to_numpy(), frame["y"].to_numpy(), frame["polarity"].to_numpy()


def check_data_table(path: Path) -> list:
    """Return the data table, known to point at packets: dv-processing reads for ever where it does not."""
    table = faery.aedat.Decoder(str(path)).file_data_definitions()
    raw = path.read_bytes()
    for each in table:
        # The offset is the payload's: behind stream id and size, at an LZ4 frame.
        assert struct.unpack_from("<ii", raw, each.byte_offset - 8) == (0, each.size)
        assert raw[each.byte_offset :][:4] == b"\x04\x22\x4d\x18"
    return table


@pytest.mark.parametrize("batch", [EVENTS, EVENTS[:0]], ids=["events", "none"])
def test_aedat4_is_read_by_four_libraries(tmp_path, batch):
    path = write(tmp_path / "a.aedat4", split(batch), flush=FlushPolicy(events=500))
    check_data_table(path)
    found = dv_events(path)
    assert same(batch, found["timestamp"], found["x"], found["y"], found["polarity"])

    decoder = aedat.Decoder(str(path))
    assert decoder.id_to_stream() == {0: {"type": "events", "width": WIDTH, "height": HEIGHT}}
    packets = [packet["events"] for packet in decoder]
    found = np.concatenate(packets) if packets else np.empty(0, [("t", "u8"), ("x", "u2"), ("y", "u2"), ("on", "?")])
    assert same(batch, found["t"], found["x"], found["y"], found["on"])

    assert same(batch, *evlib_columns(path))

    packets = [packet for _, packet in faery.aedat.Decoder(str(path))]
    found = np.concatenate([*packets, np.empty(0, faery.EVENTS_DTYPE)])
    assert same(batch, found["t"], found["x"], found["y"], found["on"])


def test_aedat4_has_a_data_table_and_lz4(tmp_path):
    """AEStream reads no file without them."""
    path = write(tmp_path / "a.aedat4", [EVENTS], flush=FlushPolicy(events=1000))
    table = check_data_table(path)
    assert [each.elements_count for each in table] == [1000] * 4
    for index, each in enumerate(table):
        part = EVENTS[1000 * index : 1000 * (index + 1)]
        assert (each.start_t, each.end_t) == (part["t"][0], part["t"][-1])
    assert dv.io.MonoCameraRecording(str(path)).getTimeRange() == (EVENTS["t"][0], EVENTS["t"][-1])


def test_each_packet_of_one_flush_has_its_own_times_in_the_data_table(tmp_path, monkeypatch):
    monkeypatch.setattr("clsim.events.formats.dv_stream.EVENTS_PER_PACKET", 300)
    table = check_data_table(write(tmp_path / "a.aedat4", [EVENTS[:1000]], flush=FlushPolicy(events=1000)))
    ends = (0, 300, 600, 900, 1000)
    parts = [EVENTS[start:end]["t"] for start, end in pairwise(ends)]
    assert [(each.start_t, each.end_t) for each in table] == [(part[0], part[-1]) for part in parts]


@pytest.mark.parametrize("packet", [50, 70, 100, 300, 4000])
def test_aedat4_is_read_when_a_kill_came_between_data_table_and_header(tmp_path, packet):
    path = write(tmp_path / "a.aedat4", [EVENTS], flush=FlushPolicy(events=packet))
    raw = path.read_bytes()
    unfinished = pack_header(WIDTH, HEIGHT, Compression.LZ4)
    start = len(AEDAT4_MAGIC)
    assert raw[start : start + len(unfinished)] != unfinished
    # That there is no table yet is the schema's default, which others may leave out.
    entry = unfinished.index(np.array([10, 24, 4, 12, 8], "<u2").tobytes()) + 6
    for header in (unfinished, unfinished[:entry] + bytes(2) + unfinished[entry + 2 :]):
        path.write_bytes(AEDAT4_MAGIC + header + raw[start + len(unfinished) :])
        assert np.array_equal(read(path), EVENTS)


@pytest.mark.parametrize("compression", [None, ("lz4", 1), ("zstd", 3)], ids=str)
def test_aedat4_of_others_is_read_however_it_is_compressed(tmp_path, compression):
    path = tmp_path / "a.aedat4"
    stream = faery.events_stream_from_array(EVENTS.astype(faery.EVENTS_DTYPE), (WIDTH, HEIGHT))
    stream.to_file(path, compression=compression)
    assert np.array_equal(read(path), EVENTS)


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_aedat4_with_frames_beside_the_events_is_read(tmp_path, channels):
    """A frame is grey, or blue, green and red, or these and its opacity; it is read as red, green and blue."""
    path = tmp_path / "a.aedat4"
    writer = dv.io.MonoCameraWriter(str(path), dv.io.MonoCameraWriter.DAVISConfig("camera", (WIDTH, HEIGHT)))
    store = dv.EventStore()
    for t, x, y, on in EVENTS[:500]:
        store.push_back(int(t), int(x), int(y), bool(on))
    image = np.random.default_rng(5).integers(0, 256, (HEIGHT, WIDTH, channels), np.uint8)
    writer.writeFrame(dv.Frame(int(EVENTS["t"][0]), image))
    writer.writeEvents(store)
    del writer
    assert np.array_equal(read(path), EVENTS[:500])
    ((time_us, shown),) = read_frames(path)
    assert time_us == EVENTS["t"][0]
    assert np.array_equal(shown, image[:, :, [0, 0, 0] if channels == 1 else [2, 1, 0]])


def test_evt2_is_read_by_two_libraries(tmp_path):
    path = write(tmp_path / "a.raw", split(EVENTS))
    found = Wizard(encoding="evt2").read(path)
    assert same(EVENTS, found["t"], found["x"], found["y"], found["p"])
    assert same(EVENTS, *evlib_columns(path))


def test_evt3_is_read_by_two_libraries_across_laps_of_its_clock(tmp_path):
    path = write(tmp_path / "a.evt3.raw", split(EVENTS))
    assert np.any(np.diff(EVENTS["t"] >> 24))
    found = evt3.decode_file(str(path))
    assert (found.sensor_width, found.sensor_height) == (WIDTH, HEIGHT)
    assert same(EVENTS, found.timestamp, found.x, found.y, found.polarity)
    assert same(EVENTS, *evlib_columns(path))


def test_evt3_that_begins_late_and_pauses_long_keeps_its_time(tmp_path):
    late = np.array([(100 << 24, 1, 1, True), (100 << 24, 2, 1, True), ((137 << 24) + 5, 1, 1, False)], EVENT_DTYPE)
    path = write(tmp_path / "a.evt3.raw", [late])
    found = evt3.decode_file(str(path))
    assert same(late, found.timestamp, found.x, found.y, found.polarity)
    assert np.array_equal(read(path), late)


def test_evt3_has_no_vector_words(tmp_path):
    """faery writes VECT words alone, which Prophesee's decoder does not expect; a row of pixels invites them."""
    row = np.array([(1000, x, 7, True) for x in range(100)], EVENT_DTYPE)
    raw = write(tmp_path / "a.evt3.raw", [row]).read_bytes()
    words = np.frombuffer(raw[raw.index(b"% end\n") + 6 :], "<u2")
    assert set(words >> 12) == {0x0, 0x2, 0x6, 0x8}


def test_evt3_with_vectors_is_decoded_as_evt3_does(tmp_path):
    rows = [  # runs of all lengths, with holes
        (1000 * row, x, row, bool(row % 2)) for row in range(60) for x in range(row, 2 * row) if (x * x + row) % 7
    ]
    batch = np.array(rows, EVENT_DTYPE)
    path = tmp_path / "a.raw"
    with faery.evt.Encoder(path, "evt3", False, (WIDTH, HEIGHT), True) as encoder:
        encoder.write({"events": batch.astype(faery.EVENTS_DTYPE)})
    header = path.read_bytes().index(f"geometry {WIDTH}x{HEIGHT}\n".encode())
    kinds = np.frombuffer(path.read_bytes()[header + len(f"geometry {WIDTH}x{HEIGHT}\n") :], "<u2") >> 12
    assert {0x3, 0x4, 0x5} <= set(kinds)  # base and both vectors
    found = evt3.decode_file(str(path))
    ours = read(path)
    assert len(ours) == len(batch)
    assert same(ours, found.timestamp, found.x, found.y, found.polarity)

    words = np.frombuffer(path.read_bytes()[header + len(f"geometry {WIDTH}x{HEIGHT}\n") :], "<u2")
    for size in (1, 2, 3, 7):  # where blocks of words end must not matter
        decoder = Evt3Decoder(WIDTH, HEIGHT)
        pieces = [decoder.decode(words[start : start + size]) for start in range(0, len(words), size)]
        assert np.array_equal(np.concatenate(pieces), ours)


def test_evt3_words_in_orders_a_camera_sends_them(tmp_path):
    """Events ahead of the first time, an upper time without a lower one, upper times sent again, vectors in a row."""
    high, low, row, column, base, vector12, vector8 = 0x8000, 0x6000, 0x0000, 0x2000, 0x3000, 0x4000, 0x5000
    words = [row | 3, column | 1, high | 1, low | 5, row | 4, column | 2, high | 1, low | 6, column | 3]
    words += [high | 2, column | 4, low | 9, column | 0x800 | 5]
    words += [base | 6, vector8 | 1, vector12 | 3, vector8 | 2]
    path = evt3_file(tmp_path / "a.raw", words)
    ours = read(path)
    found = evt3.decode_file(str(path))
    assert same(ours, found.timestamp, found.x, found.y, found.polarity)
    assert ours[:4].tolist() == [(4101, 2, 4, False), (4102, 3, 4, False), (8192, 4, 4, False), (8201, 5, 4, True)]
    assert ours[4:].tolist() == [(8201, x, 4, False) for x in (6, 14, 15, 27)]


def evt3_file(path, words, width=WIDTH, height=HEIGHT):
    header = f"% evt 3.0\n% format EVT3;height={height};width={width}\n% end\n"
    path.write_bytes(header.encode() + np.array(words, "<u2").tobytes())
    return path


def openeb(words, width, height):
    """Return what OpenEB's evt3_decoder.h makes of words of time, row and column, one by one."""
    lap, high, low, row, events = 0, None, 0, 0, []
    for word in words:
        kind, value = int(word) >> 12, int(word) & 0xFFF
        if kind == 0x8:
            if high is None:
                high = max(value - 1, 0)
            lap += high >= (1 << 11) + value
            low = low if high == value else 0
            high = value
        elif high is None:
            continue  # it looks for the first upper time
        elif kind == 0x6:
            low = value
        elif kind == 0x0:
            row = value & 0x7FF
        elif kind == 0x2 and row < height and value & 0x7FF < width:
            events.append((lap << 24 | high << 12 | low, value & 0x7FF, row, bool(value >> 11)))
    return events


def test_evt3_is_decoded_by_the_rules_of_openeb(tmp_path):
    """A step back of the upper time, the same one again, a lap, events outside the sensor."""
    high, low, row, column = 0x8000, 0x6000, 0x0000, 0x2000
    words = [high | 100, low | 7, row | 3, column | 1, high | 100, column | 2, high | 99, column | 3, high | 101]
    words += [column | 4, row | HEIGHT, column | 5, row | 4, column | WIDTH, column | 6, high | 3000, low | 1]
    words += [column | 7, high | 953, column | 8, high | 3100, column | 9]
    words += [high | 1052, low | 2, column | 10, high | 1052, column | 11]
    decoder = Evt3Decoder(WIDTH, HEIGHT)
    found = decoder.decode(np.array(words, "<u2"))
    assert found.tolist() == openeb(words, WIDTH, HEIGHT) and decoder.dropped_events == 2
    assert found["t"][-1] == (1 << 24) + (1052 << 12) + 2  # one lap: 3000 to 953 is no drop of 2048


@settings(deadline=None)
@given(
    st.lists(
        st.one_of(
            st.integers(0, 0xFFF).map(lambda value: 0x8000 | value),
            st.sampled_from([0x8000, 0x8001, 0x8FFF]),
            st.integers(0, 0xFFF).map(lambda value: 0x6000 | value),
            st.integers(0, HEIGHT + 3),
            st.integers(0, WIDTH + 3).map(lambda value: 0x2000 | value),
        ),
        max_size=60,
    ),
    st.integers(1, 60),
)
def test_any_evt3_words_are_decoded_by_the_rules_of_openeb(words, size):
    decoder = Evt3Decoder(WIDTH, HEIGHT)
    raw = np.array(words, "<u2")
    pieces = [decoder.decode(raw[start : start + size]) for start in range(0, len(raw), size)]
    found = [tuple(event) for piece in pieces for event in piece.tolist()]
    # The first word's time before it: OpenEB ignores rows ahead of the first upper time, we keep the row.
    start = next((index for index, word in enumerate(words) if word >> 12 == 0x8), len(words))
    rows = [word for word in words[:start] if word < 0x800][-1:]
    expected = openeb(words[start : start + 1] + rows + words[start + 1 :], WIDTH, HEIGHT)
    inside = sum(word >> 12 == 2 for word in words[start:])
    before = sum(word >> 12 == 2 for word in words[:start])
    assert found == expected and len(found) + decoder.dropped_events == inside + before


def test_words_sent_afresh_stand_alone_though_time_and_row_are_as_before():
    encoder = Evt3Encoder()
    events_at_once = np.array([(5_000_000, x, 7, True) for x in (3, 4)], EVENT_DTYPE)
    encoder.encode(events_at_once[:1])
    alone = Evt3Decoder(WIDTH, HEIGHT).decode(encoder.encode(events_at_once[1:], afresh=True))
    assert [(y, x, on) for _, x, y, on in alone.tolist()] == [(7, 4, True)]
    assert alone["t"] % (1 << 24) == 5_000_000


def test_a_version_of_evt_that_is_not_known_is_refused(tmp_path):
    (tmp_path / "a.raw").write_bytes(b"% evt 5.0\n% format EVT5;height=260;width=346\n% end\n" + bytes(64))
    with pytest.raises(InputError, match=r"is EVT5; expected EVT2, EVT2\.1, EVT3 or EVT4"):
        open_source(tmp_path / "a.raw")


def test_a_raw_file_without_its_version_is_refused(tmp_path):
    (tmp_path / "a.raw").write_bytes(b"% date 2024-01-01\n" + bytes(64))
    with pytest.raises(InputError, match="no EVT version"):
        open_source(tmp_path / "a.raw")


def test_dat_is_read_by_expelliarmus(tmp_path):
    found = Wizard(encoding="dat").read(write(tmp_path / "a.dat", split(EVENTS)))
    assert same(EVENTS, found["t"], found["x"], found["y"], found["p"])


def test_es_is_read_by_faery_with_its_origin_at_the_bottom(tmp_path):
    path = write(tmp_path / "a.es", split(EVENTS))
    with faery.es.Decoder(path, 0) as decoder:
        assert decoder.dimensions == (WIDTH, HEIGHT)
        found = np.concatenate(list(decoder))
    assert same(EVENTS, found["t"], found["x"], HEIGHT - 1 - found["y"], found["on"])
    found = np.concatenate(list(faery.events_stream_from_file(path)))  # its upper layer turns y
    assert same(EVENTS, found["t"], found["x"], found["y"], found["on"])


def test_hdf5_follows_dsec(tmp_path):
    batch = events(4000, start_us=12_345_000)
    assert not np.all(batch["t"] % 1000)  # some at the very millisecond
    path = write(tmp_path / "a.h5", split(batch), flush=FlushPolicy(events=300))
    assert same(batch, *evlib_columns(path))
    with h5py.File(path) as file:
        columns = {name: file["events"][name][:] for name in "txyp"}
        assert {name: column.dtype.str for name, column in columns.items()} == {
            "t": "<u4",
            "x": "<u2",
            "y": "<u2",
            "p": "|u1",
        }
        assert same(batch, columns["t"].astype(np.int64) + file["t_offset"][()], *(columns[name] for name in "xyp"))
        index = file["ms_to_idx"][:].astype(np.int64)
    # DSEC's own words: t[ms_to_idx[ms]] >= ms * 1000 and t[ms_to_idx[ms] - 1] < ms * 1000
    milliseconds = np.arange(len(index))
    assert len(index) == batch["t"][-1] // 1000 + 1
    assert np.all(batch["t"][index] >= milliseconds * 1000)
    assert np.all(batch["t"][index[index > 0] - 1] < milliseconds[index > 0] * 1000)


def test_hdf5_that_begins_late_counts_from_a_whole_millisecond(tmp_path):
    """So that a millisecond of its clock is one of the index."""
    batch = events(4000, start_us=3_600_000_123)
    with h5py.File(write(tmp_path / "a.h5", split(batch))) as file:
        offset, index = int(file["t_offset"][()]), file["ms_to_idx"][:]
    assert offset == batch["t"][0] // 1000 * 1000
    np.testing.assert_array_equal(index, np.searchsorted(batch["t"], offset + 1000 * np.arange(len(index))))


def test_hdf5_that_is_compressed_is_read(tmp_path):
    hdf5plugin = pytest.importorskip("hdf5plugin", reason="the [hdf5] extra is not installed")
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        for name, field in (("t", "t"), ("x", "x"), ("y", "y"), ("p", "on")):
            file.create_dataset(f"events/{name}", data=EVENTS[field].astype(np.int64), **hdf5plugin.Blosc(cname="zstd"))
        file["t_offset"] = 1_000_000_000_000
    expected = EVENTS.copy()
    expected["t"] += 1_000_000_000_000
    assert np.array_equal(read(path), expected)


def test_text_is_read_by_numpy_and_evlib(tmp_path):
    path = write(tmp_path / "a.txt", split(EVENTS))
    assert same(EVENTS, *np.loadtxt(path, np.int64).T)
    t, x, y, on = evlib_columns(write(tmp_path / "seconds.txt", split(EVENTS), time_unit="s"))
    assert set(np.unique(EVENTS["t"] - t)) <= {0, 1}  # evlib cuts the product of a float where it should round it
    assert same(EVENTS, EVENTS["t"], x, y, on)
    found = faery.events_stream_from_file(write(tmp_path / "a.csv", [EVENTS]), dimensions_fallback=(WIDTH, HEIGHT))
    found = np.concatenate(list(found))
    assert same(EVENTS, found["t"], found["x"], found["y"], found["on"])


def test_text_in_seconds_is_exact_at_a_thousand_seconds(tmp_path):
    """float32, in which v2e keeps its time, has steps of 61 µs there."""
    times = 1_000_000_000 + np.arange(1000)
    batch = np.zeros(1000, EVENT_DTYPE)
    batch["t"] = times
    path = write(tmp_path / "a.txt", [batch], time_unit="s")
    assert path.read_text().startswith("1000.000000 0 0 0\n1000.000001 0 0 0\n")
    assert np.array_equal(read(path)["t"], times)


def test_parquet_and_npz_are_read_by_their_libraries(tmp_path):
    table = pyarrow.parquet.read_table(write(tmp_path / "a.parquet", split(EVENTS)))
    assert same(EVENTS, *(table.column(name).to_numpy() for name in "txyp"))
    arrays = np.load(write(tmp_path / "a.npz", split(EVENTS)))
    assert same(EVENTS, *(arrays[name] for name in "txyp"))
    assert (arrays["width"], arrays["height"]) == (WIDTH, HEIGHT)
