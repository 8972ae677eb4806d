"""Several agents that see events, in one process or in one each."""

import multiprocessing

import numpy as np
import pytest

import clsim
from clsim.errors import Error
from clsim.scene import Camera, Material, SphereLight, Static
from clsim.scene.motion import compose
from clsim.scene.shapes import box

gymnasium = pytest.importorskip("gymnasium", reason="gymnasium is not installed")

from clsim.bridges.gymnasium import EventObservation  # noqa: E402
from tests.bridges.slide import Slide  # noqa: E402


def seeing() -> EventObservation:
    scene = clsim.WorldBuilder(Camera(24, 24, 60.0, Static(compose((0.0, 0.0, 3.0), np.eye(3)))))
    parts = {"body": (box((0.4, 0.4, 0.4)), np.eye(4), Material(color=(0.1, 0.1, 0.1)))}
    scene.add_parts("box", parts)
    scene.add_light("lamp", SphereLight(0.2, (2.0, 2.0, 2.0), Static(compose((0.0, 0.0, 4.0), np.eye(3)))))
    world = scene.world(environment=(0.5, 0.5, 0.5))
    env = Slide(length=7, reach_m=0.0)

    def follow(simulator: clsim.Simulator) -> int:
        simulator.set_pose("box", compose((env.x, 0.0, 0.0), np.eye(3)), 10_000 * env.steps)
        return 10_000 * env.steps

    return EventObservation(env, clsim.Simulator(world, clock="caller", fps=200.0, quality="draft"), follow, bins=3)


def context(kind: str) -> str:
    if kind not in multiprocessing.get_all_start_methods():
        pytest.skip(f"there is no {kind} here")
    return kind


@pytest.mark.parametrize("kind", ["sync", "spawn", pytest.param("forkserver", marks=pytest.mark.slow)])
def test_vector_environments_reset_and_step(kind: str) -> None:
    both = (
        gymnasium.vector.SyncVectorEnv([seeing, seeing])
        if kind == "sync"
        else gymnasium.vector.AsyncVectorEnv([seeing, seeing], context=context(kind))
    )
    try:
        observation, info = both.reset(seed=1)
        assert observation["events"].shape == (2, 3, 24, 24) and not observation["events"].any()
        counts = []
        for k in range(10):  # beyond the end of an episode, after which each begins anew
            observation, _, _, ended, info = both.step(np.array([[20.0], [5.0]]) * (-1) ** (k // 3))
            events = info["events"]
            assert len(events) == 2
            for own, seen in zip(events, observation["events"], strict=True):
                assert set(own) == {"t", "x", "y", "on"} and len(own["t"]) == len(own["on"])
                assert np.isclose(seen.sum(), own["on"].sum() - (~own["on"]).sum(), atol=1e-3)
            counts.append([len(own["t"]) for own in events])
            assert ended.tolist() == [k == 6] * 2
        assert np.array(counts).any(0).all() and any(a != b for a, b in counts)
    finally:
        both.close()


@pytest.mark.filterwarnings("ignore:.*multi-threaded:DeprecationWarning")
def test_forked_environments_end_at_once_and_leave_nobody(capfd: pytest.CaptureFixture[str]) -> None:
    seeing().simulator.close()
    with pytest.raises((Error, EOFError, ConnectionError)):
        gymnasium.vector.AsyncVectorEnv([seeing, seeing], context=context("fork")).reset()
    for worker in multiprocessing.active_children():
        worker.join(10)
    assert not multiprocessing.active_children()
    assert "start workers by spawn" in capfd.readouterr().err
