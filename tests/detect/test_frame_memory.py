"""Frames' memory under the device's buffers."""

import gc
import weakref

from clsim.detect.pack import _CACHED_FRAMES, FrameMemory
from clsim.frames import Frame, page_aligned
from clsim.opencl.device import choose_device


def lend_all(memory, count, alive):
    for _ in range(count):
        planes = page_aligned((1, 4, 8))
        alive.append(weakref.ref(planes))
        frame = Frame(planes, ("R",))
        memory.lend(frame)
        memory.take_back(frame)


def test_an_array_lives_until_the_device_is_done_with_it() -> None:
    device, alive, seen = choose_device(), [], []
    memory = FrameMemory(device, device.queue())
    finish = memory._finish

    def watched():
        finish()
        seen.append([each() is not None for each in alive])

    memory._finish = watched
    lend_all(memory, _CACHED_FRAMES + 2, alive)
    assert len(seen) == 2 and seen[0][0] and seen[1][1], "alive when its hand-over was waited for"
    gc.collect()
    assert [each() is not None for each in alive[:3]] == [False, False, True]
    memory.close()
    assert all(seen[-1][2:])
    gc.collect()
    assert not any(each() is not None for each in alive)
