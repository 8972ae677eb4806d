"""Copies of one scene: each fires what it fires alone, in whatever turn they step, and all share the scene."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import clsim
from clsim.errors import Error, InputError
from clsim.scene.motion import compose
from tests.simulator.stage import scene

OPTIONS: dict[str, Any] = {"clock": "caller", "quality": "draft"}
STEP_US = 4_000
Seen = list[bytes]


def go(simulator: clsim.Simulator, k: int, step: int) -> bytes:
    """Drive the k-th copy through a step of its own, and return the events' bytes."""
    angle = 0.05 * step * (k + 1)
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    simulator.set_pose("box", compose((0.03 * step * (k - 1), 0.01 * k, 0.0), turn))
    if k == 2:
        simulator.set_light("lamp", (20.0 + 3.0 * step, 20.0, 20.0 - 2.0 * step))
    simulator.set_camera(compose((0.02 * k * step, 0.4, 3.0), np.eye(3)))
    return simulator.step(STEP_US * step).tobytes()


@pytest.mark.parametrize("quality", ["draft", "exact"])
def test_each_fires_what_it_fires_alone(tmp_path: Path, quality: str) -> None:
    options = OPTIONS | {"quality": quality, "spp": 4 if quality == "exact" else None}
    turns = [0, 1, 2, 2, 0, 1, 0, 0, 2, 1, 1, 2]
    done = [0, 0, 0]
    found: list[Seen] = [[], [], []]
    with clsim.batch(scene(tmp_path), 3, seed=5, **options) as simulators:
        assert len(simulators) == 3 and [simulator._options.seed for simulator in simulators] == [5, 6, 7]
        for k in turns:
            found[k].append(go(simulators[k], k, done[k]))
            done[k] += 1
        assert len({id(simulator._data) for simulator in simulators}) == 1
        frames = [simulator.frame().planes for simulator in simulators]
        poses = [simulator.pose("box") for simulator in simulators]
    for k in range(3):
        with clsim.Simulator(scene(tmp_path), seed=5 + k, **options) as alone:
            assert [go(alone, k, step) for step in range(4)] == found[k]
            assert sum(map(len, found[k])) > 10 * clsim.EVENT_DTYPE.itemsize
            np.testing.assert_array_equal(alone.frame().planes, frames[k])
            np.testing.assert_array_equal(alone.pose("box"), poses[k])


def test_threads_that_drive_copies_wait_for_each_other(tmp_path: Path) -> None:
    """Two at once read what the other was moving, and the process ended there and then."""

    def driven(simulators: Any, each: Any) -> list[Seen]:
        for simulator in simulators:  # what will move is known before the first step of any
            simulator.set_pose("box", np.eye(4))
        return list(each(lambda k: [go(simulators[k], k, step) for step in range(8)], range(4)))

    with clsim.batch(scene(tmp_path), 4, **OPTIONS) as simulators, ThreadPoolExecutor(4) as pool:
        together = driven(simulators, pool.map)
    with clsim.batch(scene(tmp_path), 4, **OPTIONS) as simulators:
        assert driven(simulators, map) == together and all(any(seen) for seen in together)


def test_one_restarts_or_goes_back_while_others_go_on(tmp_path: Path) -> None:
    with clsim.batch(scene(tmp_path), 3, **OPTIONS) as simulators:
        first = [[go(simulator, k, step) for step in range(4)] for k, simulator in enumerate(simulators)]
        simulators[1].reset()
        again = []
        for step in range(4):
            again.append(go(simulators[1], 1, step))
            if step == 1:
                state = simulators[1].snapshot()
            go(simulators[2], 2, 4 + step)
        assert again == first[1]
        simulators[1].restore(state)
        go(simulators[0], 0, 4)
        assert [go(simulators[1], 1, step) for step in (2, 3)] == first[1][2:]
        simulators.reset()
        assert [[go(each, k, step) for step in range(4)] for k, each in enumerate(simulators)] == first


def test_what_one_sets_before_the_first_step_is_not_set_for_others(tmp_path: Path) -> None:
    """Each another thing, in turns."""
    with clsim.batch(scene(tmp_path), 3, **OPTIONS) as simulators:
        own = {name: simulators[0].pose(name) for name in ("box", "floor", "lamp")}
        for _ in range(2):
            for simulator, name in zip(simulators, own, strict=True):
                simulator.set_pose(name, compose((0.5, 0.5, 0.0), np.eye(3)), 0)
            for simulator, moved in zip(simulators, own, strict=True):
                for name, pose in own.items():
                    assert np.array_equal(simulator.pose(name), pose) == (name != moved)


def test_all_step_together(tmp_path: Path) -> None:
    with clsim.batch(scene(tmp_path), 2, **OPTIONS) as simulators:
        for step in range(3):
            for k, simulator in enumerate(simulators):
                simulator.set_pose("box", compose((0.1 * step * k, 0.0, 0.0), np.eye(3)))
            events = simulators.step(STEP_US * step)
        assert len(events[0]) == 0 < len(events[1])
        assert [simulator.time_us for simulator in simulators] == [2 * STEP_US] * 2
        assert simulators[-1] is simulators[1] and list(simulators) == simulators[:]
    with pytest.raises(Error, match="closed"):
        simulators[1].step(1)


def test_what_cannot_be_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="`n` must be at least 1, got 0"):
        clsim.batch("two-boxes", 0)
    with clsim.batch(scene(tmp_path), 1, **OPTIONS) as alone:
        assert len(alone) == 1
    with clsim.batch(scene(tmp_path), 2, **OPTIONS | {"seed": np.uint8(255)}) as simulators:
        assert [each._options.seed for each in simulators] == [255, 256], "not 0, as numpy's bytes go on"
    with clsim.batch(scene(tmp_path), 2, **OPTIONS) as simulators:
        simulators[0].set_pose("box", np.eye(4))
        simulators[0].step(0)
        with pytest.raises(InputError, match="floor stands still in stage and is built in"):
            simulators[1].set_pose("floor", np.eye(4))


def test_light_that_was_set_once_stays_whoever_steps_meanwhile(tmp_path: Path) -> None:
    def step(simulator: clsim.Simulator, number: int) -> bytes:
        simulator.set_pose("box", compose((0.03 * number, 0.0, 0.0), np.eye(3)))
        return simulator.step(STEP_US * number).tobytes()

    found: list[list[tuple[bytes, bytes]]] = [[], []]
    with clsim.batch(scene(tmp_path), 3, **OPTIONS) as simulators, clsim.Simulator(scene(tmp_path), **OPTIONS) as alone:
        for lit, others, seen in ((simulators[0], simulators[1:], found[0]), (alone, [], found[1])):
            lit.set_light("lamp", (60.0, 10.0, 10.0))
            for number in range(3):
                events = step(lit, number)
                seen.append((events, lit.frame().planes.tobytes()))
                for other in others:
                    step(other, number)
    assert found[0] == found[1] and found[0][-1][0]
