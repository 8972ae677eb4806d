"""Frames that are larger than what the page is sent: every second pixel of them, or every third."""

import struct
from typing import Any

import numpy as np
import pytest

from clsim.frames import Frame
from tests.live.view.test_view_page import ViewSink, wait_until, watch


@pytest.mark.parametrize(
    ("width", "height", "step"),
    [(640, 6, 1), (641, 6, 2), (960, 7, 2), (1279, 6, 2), (1280, 6, 2), (1281, 6, 3), (6, 641, 2)],
)
def test_no_picture_of_the_page_has_more_than_640_pixels_a_side(width: int, height: int, step: int) -> None:
    """The radiance, the detector's brightness and truth alike, each of the same pixels."""
    bright = np.random.default_rng(0).random((height, width)) < 0.5
    planes = np.stack([np.where(bright, 4.0, 0.1)] * 3 + [np.where(bright, 1.0, 5.0)]).astype(np.float32)
    sink = ViewSink("large", width, height, port=0, truth_every=1)

    def act() -> None:
        wait_until(sink.wants_frame)
        sink.show_frame(Frame(planes, ("R", "G", "B", "Z")), np.log(planes[0]))

    def pictures(messages: list[Any]) -> dict[int, bytes]:
        packets = [each for each in messages if isinstance(each, bytes)]
        return {kind: each for each in packets if (kind := each[0]) != 1}

    found = pictures(watch(sink.url, lambda messages: {2, 3, 5} <= pictures(messages).keys(), act))
    sink.close()
    expected = bright[::step, ::step]
    for kind in (2, 3, 5):
        _, channels, _, _, *size = struct.unpack_from("<IIqqII", found[kind])
        assert tuple(size) == expected.shape[::-1] and max(size) <= 640
        shown = np.frombuffer(found[kind], np.uint8, offset=32).reshape(*expected.shape, channels)
        assert ((shown[..., 0] > 128) == expected).all()
