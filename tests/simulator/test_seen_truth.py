"""Truth of what is driven, as `Simulator.truth` tells it."""

from pathlib import Path

import numpy as np
import pytest

import clsim
from clsim.errors import InputError
from tests.simulator.stage import scene, simulator


@pytest.mark.slow
def test_backward_flow_leads_to_the_frame_before_however_near_that_is(tmp_path: Path) -> None:
    """The box goes sideways at 4 m/s, and the caller's frames are nearer to each other than `fps` asks for."""
    with simulator(tmp_path, truth=("depth", "backward-flow"), fps=50.0, clock="caller") as run:
        run.set_pose("box", ((0.16, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)), 40_000)
        run.step(0)
        for until_us, way_m in ((5_000, 0.02), (12_000, 0.028)):
            run.step(until_us)
            known = run.truth()
            front = np.abs(known["depth"] - 2.6) < 1e-5
            assert front.sum() > 20
            expected = -16 / np.tan(np.radians(25)) * way_m / 2.6
            np.testing.assert_allclose(known["backward-flow"][front][:, 0], expected, atol=1e-4)


def test_flow_leads_to_a_frames_time_later(tmp_path: Path) -> None:
    """That of the simulator, which is not the scene's: the box goes 8 cm in 20 ms."""
    with simulator(tmp_path, truth=("depth", "flow"), fps=50.0, clock="caller") as run:
        run.set_pose("box", ((0.16, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)), 40_000)
        run.step(0)
        known = run.truth()
        front = np.abs(known["depth"] - 2.6) < 1e-5
        ahead = 16 / np.tan(np.radians(25)) * 0.08 / 2.6
        assert front.sum() > 20 and known["flow"][front][:, 0] == pytest.approx(ahead, abs=1e-4)


def test_truth_stays_what_it_was_when_a_step_follows(tmp_path: Path) -> None:
    with simulator(tmp_path, truth=("depth",)) as run:
        run.step(0)
        told = run.truth()
        kept = {name: values.copy() for name, values in told.items()}
        assert set(kept) == {"intensity", "depth"} and set(run.truth("depth")) == {"depth"}
        run.set_pose("box", ((0.5, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
        run.step(5_000)
        assert all((run.truth(name)[name] != kept[name]).any() for name in kept)
        assert all((told[name] == kept[name]).all() for name in kept)


def test_a_pose_may_come_for_a_time_that_truth_has_looked_ahead_to(tmp_path: Path) -> None:
    """Flow leads to the next frame at `fps`, 5 ms on: by what is known then, the box stays. Later it is told to go."""
    found = []
    for names in (("depth",), ("depth", "flow")):
        with simulator(tmp_path, truth=names) as run:
            run.step(0)
            run.set_pose("box", ((0.5, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
            found.append((run.step(5_000), run.truth("depth")["depth"]))
    (events, depth), (ahead_events, ahead_depth) = found
    assert len(events) > 20 and np.array_equal(events, ahead_events) and np.array_equal(depth, ahead_depth)


@pytest.mark.parametrize("name", ["imu", "poses", "image"])
def test_truth_that_only_recordings_have_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=f"must be of all, none, intensity, depth, .*, got '{name}'"):
        clsim.Simulator(scene(tmp_path), truth=("depth", name))


def test_truth_that_was_not_asked_for_says_how_to_ask(tmp_path: Path) -> None:
    with simulator(tmp_path) as run:
        run.step(0)
        with pytest.raises(InputError, match=r"has no depth: make it with truth=\('depth',\)"):
            run.truth("depth")
        with pytest.raises(InputError, match="`names` must be one of intensity, got 'dpth'"):
            run.truth("dpth")
