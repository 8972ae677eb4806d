"""Which map a renderer finds."""

import threading

import numpy as np
import pytest

from clsim.errors import Error
from clsim.frames import DELAY, InterestBoard, InterestMap


def map_of(number: int) -> InterestMap:
    plane = np.zeros((1, 1), np.float32)
    return InterestMap(number, plane, plane, plane, plane)


def test_a_frame_gets_the_map_of_the_frame_two_before() -> None:
    board = InterestBoard()
    assert DELAY == 2 and board.find(0) is None and board.find(1) is None
    maps = [map_of(number) for number in range(3)]
    for each in maps:
        board.publish(each)
    assert [board.find(number) for number in (2, 3, 4)] == maps


def test_out_of_step_it_gets_the_newest_there_is() -> None:
    board = InterestBoard("newest")
    assert board.find(7) is None
    first, second = map_of(0), map_of(1)
    board.publish(first)
    board.publish(second)
    assert board.find(7) is second


def test_who_waits_gets_the_map_once_it_is_there_or_nothing_at_the_end() -> None:
    board, found = InterestBoard("wait"), []
    for number in (2, 3):
        thread = threading.Thread(target=lambda wanted=number: found.append(board.find(wanted)))
        thread.start()
        thread.join(0.05)
        assert thread.is_alive()
        if number == 2:
            board.publish(map_of(0))
        else:
            board.close()
        thread.join(5)
    assert found[0] is not None and found[0].number == 0 and found[1] is None


def test_in_one_thread_a_map_that_is_missing_is_an_error() -> None:
    with pytest.raises(Error, match="frame 5 takes the interest map of frame 3"):
        InterestBoard().find(5)
