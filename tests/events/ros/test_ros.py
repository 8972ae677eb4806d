"""Bags of ROS, read back by rosbags and by mcap-ros2-support, and messages, against rosbags' serialisers."""

from __future__ import annotations

import contextlib
import json
import sqlite3
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

import clsim
from clsim.cli.app import app
from clsim.errors import InputError
from clsim.events.copy import convert_events
from clsim.events.files import open_source
from clsim.events.outputs import FileOptions, open_output
from clsim.events.ros import messages
from clsim.events.ros.bags import EVENT_TOPIC, Bag, typestore
from tests.events import test_disk_full as disks
from tests.events import test_kill as kills
from tests.events.event_data import HEIGHT, WIDTH, events, read, split, write
from tests.events.formats import test_file_formats as formats

_ENCODINGS = ("mono", "evt3", "array")


def messages_of(path):
    """Return every message of a bag as rosbags deserialises it, with its time [ns]."""
    from rosbags.highlevel import AnyReader

    with AnyReader([path]) as reader:
        return [(c, t, reader.deserialize(raw, c.msgtype)) for c, t, raw in reader.messages()]


def _stamp_us(stamp):
    return stamp.sec * 1_000_000 + stamp.nanosec // 1000


@pytest.mark.parametrize("encoding", _ENCODINGS)
@pytest.mark.parametrize("ending", [".mcap", ".db3", ".bag"])
def test_every_encoding_comes_back(tmp_path, ending, encoding):
    batch = events(3000)
    path = write(tmp_path / f"a{ending}", split(batch), ros_events=encoding)
    np.testing.assert_array_equal(read(path), batch)


@pytest.mark.parametrize("ending", [".mcap", ".db3", ".bag"])
def test_rosbags_reads_packets(tmp_path, ending):
    batch = events(3000)
    found = messages_of(write(tmp_path / f"a{ending}", split(batch)))
    assert {c.topic for c, _, _ in found} == {EVENT_TOPIC}
    assert {c.msgtype for c, _, _ in found} == {"event_camera_msgs/msg/EventPacket"}
    assert [m.seq for _, _, m in found] == list(range(len(found)))
    t, x, y, on = [], [], [], []
    for _, _, packet in found:
        assert (packet.width, packet.height, packet.encoding, packet.is_bigendian) == (WIDTH, HEIGHT, "mono", False)
        words = np.asarray(packet.events, np.uint8).view("<u8").astype(object)
        assert _stamp_us(packet.header.stamp) * 1000 == packet.time_base
        t += [(packet.time_base + (int(w) & 0xFFFFFFFF)) // 1000 for w in words]
        x += [int(w) >> 32 & 0xFFFF for w in words]
        y += [int(w) >> 48 & 0x7FFF for w in words]
        on += [bool(int(w) >> 63) for w in words]
    np.testing.assert_array_equal(batch["t"], t)
    np.testing.assert_array_equal(batch["x"], x)
    np.testing.assert_array_equal(batch["y"], y)
    np.testing.assert_array_equal(batch["on"], on)


@pytest.mark.parametrize("ending", [".mcap", ".bag"])
def test_rosbags_reads_arrays(tmp_path, ending):
    batch = events(500)
    found = messages_of(write(tmp_path / f"a{ending}", split(batch), ros_events="array"))
    assert {c.msgtype for c, _, _ in found} == {"dvs_msgs/msg/EventArray"}
    told = [(_stamp_us(e.ts), e.x, e.y, e.polarity) for _, _, m in found for e in m.events]
    assert told == batch.tolist()


def test_mcap_ros2_reads_arrays_by_the_definition_in_the_file(tmp_path):
    from mcap_ros2.reader import read_ros2_messages

    batch = events(500)
    path = write(tmp_path / "a.mcap", split(batch), ros_events="array")
    told = []
    for message in read_ros2_messages(str(path)):
        assert message.channel.topic == EVENT_TOPIC
        assert message.ros_msg.width == WIDTH
        told += [(_stamp_us(e.ts), e.x, e.y, e.polarity) for e in message.ros_msg.events]
    assert told == batch.tolist()


def test_the_words_of_evt3_packets_are_a_recording_that_others_read(tmp_path):
    import evt3
    from mcap_ros2.reader import read_ros2_messages

    from clsim.events.formats.prophesee.raw import raw_header

    batch = events(3000)
    path = write(tmp_path / "a.mcap", split(batch), ros_events="evt3")
    words = b"".join(bytes(m.ros_msg.events) for m in read_ros2_messages(str(path)))
    raw = tmp_path / "a.raw"
    raw.write_bytes(raw_header("3", WIDTH, HEIGHT) + words)
    found = evt3.decode_file(str(raw))
    np.testing.assert_array_equal(found.timestamp, batch["t"])
    np.testing.assert_array_equal(found.x, batch["x"])
    np.testing.assert_array_equal(found.polarity != 0, batch["on"])


def test_a_packet_of_evt3_stands_alone(tmp_path):
    """A reader that comes late knows time and row from the packet itself."""
    batch = events(2000, span_us=100_000)
    found = messages_of(write(tmp_path / "a.mcap", split(batch), ros_events="evt3"))
    last = found[-1][2]
    decoder = messages.Evt3Decoder(WIDTH, HEIGHT)
    alone = decoder.decode(np.asarray(last.events, np.uint8).view("<u2"))
    tail = batch[-len(alone) :]
    np.testing.assert_array_equal(alone["t"] % (1 << 24), tail["t"] % (1 << 24))
    np.testing.assert_array_equal(alone["y"], tail["y"])


rows = st.lists(
    st.tuples(st.integers(0, 2**40), st.integers(0, 2**15 - 1), st.integers(0, 2**15 - 1), st.booleans()), max_size=8
)


@given(rows, st.sampled_from([1, 2]), st.integers(0, 2**32 - 1))
def test_messages_are_those_of_rosbags(found, ros, seq):
    """Byte for byte what rosbags serialises of the same values."""
    batch = np.array(sorted(found), messages.empty_batch().dtype)
    end_us = int(batch["t"][-1]) if len(batch) else 7
    store, sensor = _STORES[ros], messages.Sensor(1 << 15, 12, "camera")
    kinds = store.types
    time = kinds["builtin_interfaces/msg/Time"]

    def header(time_us):
        own = (seq,) if ros == 1 else ()
        return kinds["std_msgs/msg/Header"](*own, time(*messages.stamp(time_us)), "camera")

    serialise = store.serialize_ros1 if ros == 1 else store.serialize_cdr
    listed = [kinds[messages.EVENT](e["x"], e["y"], time(*messages.stamp(int(e["t"]))), bool(e["on"])) for e in batch]
    array = kinds[messages.ARRAY](header(end_us), 12, 1 << 15, listed)
    assert messages.array_bytes(ros, sensor, seq, end_us, batch) == bytes(serialise(array, messages.ARRAY))
    payload = np.arange(5, dtype=np.uint8)
    packet = kinds[messages.PACKET](header(end_us), 12, 1 << 15, seq, end_us * 1000, "mono", 0, payload)
    ours = messages.packet_bytes(ros, sensor, seq, end_us, "mono", payload.tobytes())
    assert ours == bytes(serialise(packet, messages.PACKET))


_STORES = {ros: typestore(ros) for ros in (1, 2)}


@given(st.binary(max_size=120), st.sampled_from([1, 2]), st.sampled_from(messages.EVENT_TYPES))
def test_any_bytes_are_events_or_a_value_error(data, ros, kind):
    for start in (b"", b"\0\1\0\0"):
        with contextlib.suppress(ValueError):
            messages.MessageDecoder(ros, kind).decode(start + data)


def test_ns_of_a_packet_and_its_base_are_added_before_they_become_us():
    """Cameras' clocks do not tick in whole µs: 1.5 + .7 µs is 2 µs."""
    words = np.array([700, 400 | 3 << 32 | 5 << 48 | 1 << 63], "<u8")
    data = messages.packet_bytes(2, messages.Sensor(9, 8), 0, 1, "mono", words.tobytes())
    at = data.index((1000).to_bytes(8, "little"))
    data = data[:at] + (1500).to_bytes(8, "little") + data[at + 8 :]
    found = messages.MessageDecoder(2, messages.PACKET).decode(data)
    assert found.tolist() == [(2, 0, 0, False), (1, 3, 5, True)]


def test_the_last_us_of_a_second():
    assert messages.stamp(1_999_999) == (1, 999_999_000)


def test_silence_at_the_end_is_told(tmp_path):
    from clsim.events.files import open_sink

    sink = open_sink(tmp_path / "a.mcap", WIDTH, HEIGHT)
    sink.write(events(10, start_us=0, span_us=1000), 5_000_000)
    sink.close()
    assert messages_of(tmp_path / "a.mcap")[-1][1] == 5_000_000_000


def test_long_pauses_fit_the_ns_of_a_packet(tmp_path):
    batch = events(20, start_us=0, span_us=200_000_000)
    assert np.diff(batch["t"]).max() > 4_300_000
    path = write(tmp_path / "a.mcap", [batch])
    np.testing.assert_array_equal(read(path), batch)
    for _, time_ns, packet in messages_of(path):  # each is played back when its own last event was
        last = int(np.asarray(packet.events, np.uint8).view("<u8")[-1] & np.uint64(0xFFFFFFFF))
        assert time_ns == packet.time_base + last


@pytest.mark.parametrize(("encoding", "most"), [("mono", 2**15), ("evt3", 2**11), ("array", 2**16)])
def test_a_sensor_larger_than_a_message_can_tell_is_refused(tmp_path, encoding, most):
    """Rows of mono have 15 bits, those of EVT3 11, and each number of an array 16."""
    files = FileOptions(ros_events=encoding)
    open_output(str(tmp_path / "a.mcap"), 4, most, files).close()
    with pytest.raises(InputError, match=f"bag of {encoding} messages"):
        open_output(str(tmp_path / "b.mcap"), 4, most + 1, files)


def test_one_topic_of_several_is_that_of_esim(tmp_path):
    batch = events(10)
    sensor = messages.Sensor(WIDTH, HEIGHT)
    for topics, chosen in ((("/a", EVENT_TOPIC), True), (("/left", "/right"), False)):
        path = tmp_path / f"{len(topics[1])}.mcap"
        bag = Bag(path, "mcap")
        for k, topic in enumerate(topics):
            bag.topic(topic, messages.ARRAY)
            bag.write(topic, 1, messages.array_bytes(2, sensor, 0, 1, batch[: 5 * (k + 1)]))
        bag.complete()
        if chosen:
            np.testing.assert_array_equal(read(path), batch)
        else:
            with pytest.raises(InputError, match=r"several topics: /left, /right; name one of them: '.*mcap#/left'"):
                open_source(path)
            for name, count in (("/left", 5), ("/right", 10)):
                np.testing.assert_array_equal(clsim.open(f"{path}#{name}").read(), batch[:count])
            with pytest.raises(InputError, match="no events of the topic /up; expected one of /left, /right"):
                clsim.open(f"{path}#/up")
            with pytest.raises(InputError, match=r"a\.npz: has no topics"):
                clsim.open(f"{tmp_path / 'a.npz'}#/left")
            before = path.read_bytes()
            with pytest.raises(InputError, match="is the file to read"):
                convert_events(f"{path}#/left", str(path))
            assert path.read_bytes() == before
            told = json.loads(CliRunner().invoke(app, ["info", f"{path}#/right", "--json"]).stdout)["events"]
            assert (told["format"], told["events"]) == ("mcap", 10)


def test_a_topic_that_several_nodes_published_on_is_read_whole(tmp_path):
    from rosbags.rosbag1 import Writer

    batch, types = events(10), typestore(1)
    with Writer(tmp_path / "a.bag") as bag:
        for k, (part, node) in enumerate(((batch[:4], "/one"), (batch[4:], "/two"))):
            connection = bag.add_connection("/left", messages.ARRAY, typestore=types, callerid=node)
            bag.write(connection, k, messages.array_bytes(1, messages.Sensor(WIDTH, HEIGHT), k, 1, part))
    for name in ("a.bag", "a.bag#/left"):
        np.testing.assert_array_equal(clsim.open(str(tmp_path / name)).read(), batch)


def test_a_bag_without_events_is_refused(tmp_path):
    bag = Bag(tmp_path / "a.mcap", "mcap")
    bag.topic("/imu", "sensor_msgs/msg/Imu")
    bag.complete()
    with pytest.raises(InputError, match=r"no messages of events, but sensor_msgs/msg/Imu"):
        open_source(tmp_path / "a.mcap")


@pytest.mark.parametrize("page", [4096, 65536])
def test_a_bag_of_sqlite_that_is_cut_is_refused_whatever_its_pages(tmp_path, page):
    """65536, the largest page, is written as 1."""
    path = write(tmp_path / "a.db3", split(events(20_000)))
    with contextlib.closing(sqlite3.connect(path, isolation_level=None)) as database:
        database.execute(f"PRAGMA page_size = {page}")
        database.execute("VACUUM")
    np.testing.assert_array_equal(read(path), events(20_000))
    with path.open("r+b") as file:
        file.truncate(path.stat().st_size - page)
    with pytest.raises(InputError, match="it is truncated"):
        read(path)


def test_an_abandoned_bag_leaves_what_was_there(tmp_path):
    from clsim.events.files import open_sink

    path = tmp_path / "a.mcap"
    path.write_bytes(b"old")
    sink = open_sink(path, WIDTH, HEIGHT)
    sink.write(events(10), 100_000_000)
    sink.abandon()
    assert path.read_bytes() == b"old"
    assert [each.name for each in tmp_path.iterdir()] == ["a.mcap"]


_SAME_TESTS = (
    formats.test_a_file_gives_back_its_events_and_its_size,
    formats.test_no_events_make_a_valid_file,
    formats.test_bytes_are_the_same_on_every_run_and_for_every_partition,
    formats.test_a_file_cut_anywhere_gives_its_first_events_or_one_sentence,
    formats.test_damaged_bytes_never_raise_anything_but_input_errors,
    disks.test_a_full_disk_is_one_error_and_other_sinks_go_on,
    disks.test_a_folder_that_vanishes_is_a_sink_error,
    kills.test_the_next_writer_of_a_name_removes_what_killed_ones_left,
)


@pytest.mark.slow
@pytest.mark.parametrize("ending", [".db3", ".bag"])
@pytest.mark.parametrize("test", _SAME_TESTS, ids=lambda test: test.__name__)
def test_what_holds_of_mcap_holds_of_other_bags(tmp_path, test, ending):
    test(tmp_path, ending)


@pytest.mark.parametrize("ending", [".mcap", ".db3", ".bag"])
def test_a_bag_may_be_written_in_another_thread_than_opens_it(tmp_path, ending):
    # So does a live run.
    batch, path = events(300), tmp_path / f"a{ending}"
    with clsim.write(path, WIDTH, HEIGHT) as sink, ThreadPoolExecutor(1) as thread:
        thread.submit(sink.write, batch, int(batch["t"][-1]) + 1).result()
    np.testing.assert_array_equal(read(path), batch)


@pytest.mark.parametrize("sign", "?#%")
def test_a_path_that_sqlite_does_not_take_is_told(tmp_path, sign):
    with pytest.raises(InputError, match=rf"a\{sign}\.db3: SQLite cannot write there; expected a path without \?"):
        clsim.write(tmp_path / f"a{sign}.db3", WIDTH, HEIGHT)
    assert list(tmp_path.iterdir()) == []


def test_the_old_name_of_messages_warns_and_is_understood() -> None:
    from clsim.events import ros_messages
    from clsim.events.ros.messages import mono_words

    with pytest.warns(DeprecationWarning, match=r"is now clsim\.events\.ros\.messages"):
        assert ros_messages.mono_words is mono_words
