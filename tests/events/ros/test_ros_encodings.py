"""Packets of ROS that other drivers send, against event_camera_codecs' rules, word by word."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.events.event_data import HEIGHT, WIDTH, events

pytest.importorskip("rosbags")

from pathlib import Path

from clsim.events.files import open_source
from clsim.events.ros import messages

SENSOR = messages.Sensor(WIDTH, HEIGHT)
BASE_US = 1_702_309_120_762_236


def libcaer_cmp(packets: list[list[int]]) -> list[list[tuple[int, int, int, bool]]]:
    """Return what event_camera_codecs' libcaer_cmp_decoder.h makes of packets: times alone begin anew in each."""
    found = []
    column = base = 0
    on = False

    def add(y: int, on: bool) -> None:
        if column < WIDTH and y < HEIGHT:
            found[-1].append((BASE_US + (high << 12 | low), column, y, on))

    for words in packets:
        high = low = 0
        found.append([])
        for word in words:
            kind, value = word >> 12, word & 0xFFF
            if kind == 0:
                high = value
            elif kind == 1:
                low = value
            elif kind == 2:
                column = value & 0x7FF
            elif kind == 3:
                add(value & 0x7FF, value >> 11 == 1)
            elif kind == 4:
                base, on = value & 0x7FF, value >> 11 == 1
            elif kind == 5:
                for bit in range(8):
                    if value >> bit & 1:
                        add(base + bit, on)
                base += 8
    return found


def decoded(encoding: str, *packets: bytes) -> list[list[tuple[int, int, int, bool]]]:
    decoder = messages.MessageDecoder(2, messages.PACKET)
    found = []
    for data in packets:
        events = decoder.decode(messages.packet_bytes(2, SENSOR, 0, BASE_US, encoding, data))
        found.append([tuple(event) for event in events.tolist()])
    return found


words = st.builds(
    lambda kind, value: kind << 12 | value,
    st.integers(0, 6),
    st.one_of(st.integers(0, 4095), st.integers(0, WIDTH + 4), st.integers(0x800, 0x800 + HEIGHT + 4)),
)


@settings(deadline=None, max_examples=200)
@given(st.lists(st.lists(words, max_size=20), max_size=4))
def test_any_words_of_libcaer_cmp_are_decoded_by_its_rules(packets: list[list[int]]) -> None:
    """A packet may leave out a column or a base that the one before it has told."""
    assert decoded("libcaer_cmp", *(np.array(each, "<u2").tobytes() for each in packets)) == libcaer_cmp(packets)


def test_libcaer_s_records_are_decoded_and_their_clock_begins_anew_within_a_packet() -> None:
    """But not where it goes back a little."""
    ticks = np.array([2**31 - 2, 2**31 - 3, 0, 5])
    x, y, on = np.array([0, 345, 3, 4]), np.array([0, 259, 5, 6]), np.array([1, 0, 1, 0])
    data = np.stack([1 | on << 1 | y << 2 | x << 17, ticks], axis=1).astype("<u4").tobytes()
    times = BASE_US + np.array([2**31 - 2, 2**31 - 3, 2**31, 2**31 + 5])
    expected = list(zip(times.tolist(), x.tolist(), y.tolist(), (on > 0).tolist(), strict=True))
    assert decoded("libcaer", data) == [expected]


@given(st.integers(0, 2**15 - 1), st.integers(0, 2**15 - 1), st.booleans())
def test_libcaer_s_addresses_have_15_bits_of_each_axis(x: int, y: int, on: bool) -> None:
    large = messages.Sensor(2**15, 2**15)
    data = np.array([[1 | on << 1 | y << 2 | x << 17, 7]], "<u4").tobytes()
    packet = messages.packet_bytes(2, large, 0, BASE_US, "libcaer", data)
    found = messages.MessageDecoder(2, messages.PACKET).decode(packet)
    assert found.tolist() == [(BASE_US + 7, x, y, on)]


@pytest.mark.parametrize("ros", [1, 2])
@given(frame=st.text(max_size=20))
def test_events_are_read_whatever_their_camera_is_called(ros: int, frame: str) -> None:
    batch = events(10)
    named = messages.Sensor(WIDTH, HEIGHT, frame)
    found = messages.MessageDecoder(ros, messages.ARRAY).decode(messages.array_bytes(ros, named, 0, 5, batch))
    assert np.array_equal(found, batch)


def test_bags_of_the_older_message_and_overlapping_packets_are_read(tmp_path: Path) -> None:
    """event_array_msgs/EventArray is what EventPacket was at first; packets in the wrong order are put right."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    batch = events(4000, span_us=60_000)
    store = get_typestore(Stores.ROS1_NOETIC)
    text = messages.definitions(1)[messages.PACKET]
    store.register(get_types_from_msg(text, messages.OLDER_PACKET))
    parts = np.array_split(batch, 8)
    parts[2], parts[3] = parts[3], parts[2]
    with Writer(tmp_path / "a.bag") as bag:
        topic = bag.add_connection("/event_camera/events", messages.OLDER_PACKET, typestore=store)
        for k, part in enumerate(parts):
            start_us = int(part["t"][0])
            data = messages.mono_words(part, start_us).tobytes()
            bag.write(topic, k, messages.packet_bytes(1, SENSOR, k, start_us, "mono", data))
    source = open_source(tmp_path / "a.bag")
    found = source.read()
    assert np.array_equal(found["t"], batch["t"]) and source.moved_events == len(parts[2]) != 0
    assert sorted(found.tolist()) == sorted(batch.tolist())


@pytest.mark.parametrize(("encoding", "word"), [("mono", 8), ("evt3", 2), ("libcaer", 8), ("libcaer_cmp", 2)])
def test_a_packet_that_ends_within_a_word_is_damaged(encoding: str, word: int) -> None:
    assert decoded(encoding, b"") == decoded(encoding, bytes(0)) == [[]]
    for size in (1, word + 1, 3 * word - 1):
        with pytest.raises(ValueError, match=f"a packet of {size} bytes ends within a word of {encoding}"):
            decoded(encoding, bytes(size))
