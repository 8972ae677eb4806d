"""An agent that sees events."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import clsim
from clsim.errors import InputError
from clsim.events import EVENT_DTYPE
from clsim.events.grids import voxel_grid
from clsim.scene.motion import compose
from tests.simulator.stage import scene, simulator

gymnasium = pytest.importorskip("gymnasium", reason="gymnasium is not installed")

from clsim.bridges.gymnasium import Columns, EventObservation  # noqa: E402
from tests.bridges.slide import Slide  # noqa: E402


def wrapped(run: clsim.Simulator, **options: Any) -> EventObservation:
    env = Slide()

    def follow(simulator: clsim.Simulator) -> int:
        at_us = 10_000 * env.steps
        simulator.set_pose("box", compose((env.x, 0.0, 0.0), np.eye(3)), at_us)
        return at_us

    return EventObservation(env, run, follow, **options)


class Noise:
    """Stands for a simulator in which nothing but noise fires, which is as its seed."""

    width, height = 6, 4

    def reset(self, seed: int | None = None) -> None:
        self.random, self.time_us = np.random.default_rng(seed), 0

    def set_pose(self, name: str, pose: Any, at_us: int) -> None:
        pass

    def step(self, until_us: int) -> np.ndarray:
        events = np.zeros(0 if until_us == self.time_us else 50, EVENT_DTYPE)
        events["t"] = np.sort(self.random.integers(self.time_us, until_us + 1, len(events)))
        events["x"], events["y"] = (self.random.integers(0, end, len(events)) for end in (self.width, self.height))
        events["on"] = self.random.random(len(events)) < 0.5
        self.time_us = until_us
        return events


def test_an_episode_begins_as_the_environment_is_asked_to(monkeypatch: pytest.MonkeyPatch) -> None:
    """The seed and the options reach the environment that is wrapped, as do those that are not given."""
    heard: list[dict[str, Any]] = []
    begin = Slide.reset

    def listen(self: Slide, **told: Any) -> Any:
        heard.append(told)
        return begin(self, **told)

    monkeypatch.setattr(Slide, "reset", listen)
    env = wrapped(Noise())  # type: ignore[arg-type]
    env.reset(seed=3, options={"x": 0.25})
    env.reset()
    assert heard == [{"seed": 3, "options": {"x": 0.25}}, {"seed": None, "options": None}]


@pytest.mark.parametrize("form", ["voxels", "histogram"])
def test_noise_is_that_of_the_seed_and_arrays_hold_what_fired(form: str) -> None:
    env = wrapped(Noise(), form=form, bins=4, limit=3.0)  # type: ignore[arg-type]

    def episode(seed: int) -> list[bytes]:
        env.reset(seed=seed)
        found = []
        for k in range(3):
            observation, *_, info = env.step(np.array([0.0]))
            events = np.rec.fromarrays(list(info["events"].values()), EVENT_DTYPE)
            assert len(events) == 50 and observation in env.observation_space
            expected = np.zeros((4 if form == "voxels" else 2, 4, 6))
            for t, x, y, on in events.tolist():
                if form == "histogram":
                    expected[int(on), y, x] += 1
                    continue
                for point in range(4):  # a hat about each of four points from the step's start to its end
                    hat = max(0.0, 1.0 - abs((t - 10_000 * k) * 3 / 10_000 - point))
                    expected[point, y, x] += hat if on else -hat
            assert observation["events"] == pytest.approx(np.clip(expected, -3, 3), abs=1e-5)
            found.append(info["events"]["t"].tobytes())
        return found

    first, other = episode(4), episode(5)
    assert episode(4) == first != other


@pytest.mark.filterwarnings("ignore:.*different from the unwrapped version", "ignore:.*symmetric and normalized")
@pytest.mark.slow
@pytest.mark.parametrize("form", ["voxels", "histogram"])
def test_gymnasium_finds_nothing_wrong(tmp_path: Path, form: str) -> None:
    from gymnasium.utils.env_checker import check_env

    with simulator(tmp_path) as run:
        check_env(wrapped(run, form=form), skip_render_check=True)


@pytest.mark.slow
def test_what_is_observed_is_what_fired(tmp_path: Path) -> None:
    with simulator(tmp_path) as run:
        env = wrapped(run, bins=3, limit=2.0)
        observation, info = env.reset(seed=4)
        assert (
            observation in env.observation_space and len(info["events"]["t"]) == 0 and not observation["events"].any()
        )
        start = observation["state"]
        found = []
        for k in range(3):
            observation, reward, terminated, truncated, info = env.step(np.array([20.0]))
            assert observation in env.observation_space and (terminated, truncated) == (False, False)
            assert info["x"] == pytest.approx(float(start[0]) + 0.2 * (k + 1)) and reward == -abs(info["x"])
            events = np.rec.fromarrays(list(info["events"].values()), EVENT_DTYPE)
            assert len(events) > 20 and 10_000 * k < events["t"].min() <= events["t"].max() <= 10_000 * (k + 1)
            grid = voxel_grid(events, 32, 24, 3, 10_000 * k, 10_000 * (k + 1))
            assert (observation["events"] == np.clip(grid, -2.0, 2.0)).all()
            found.append(info["events"]["t"].tobytes())
        env.reset(seed=4)
        assert [env.step(np.array([20.0]))[4]["events"]["t"].tobytes() for _ in range(3)] == found
        counted = wrapped(run, form="histogram")
        counted.reset(seed=4)
        observation, *_, info = counted.step(np.array([20.0]))
        assert (
            observation["events"].sum(axis=(1, 2)) == [(~info["events"]["on"]).sum(), info["events"]["on"].sum()]
        ).all()


def test_what_cannot_be_is_told(tmp_path: Path) -> None:
    with simulator(tmp_path) as run:
        for options in ({"bins": 0}, {"limit": 0.0}, {"limit": -1.0}):
            with pytest.raises(InputError, match="`bins` must be at least 1 and `limit` positive"):
                wrapped(run, **options)
        with pytest.raises(InputError, match="`form` must be one of voxels, histogram, got 'image'"):
            wrapped(run, form="image")


@pytest.mark.parametrize("told", [None, 0.01, True])
def test_who_follows_and_tells_no_time_is_told(told: Any) -> None:
    env = EventObservation(Slide(), Noise(), lambda simulator: told)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=f"`follow` must return a time as a whole number of µs, got {told}"):
        env.reset()


@pytest.mark.slow
def test_a_vector_of_environments_shares_one_scene(tmp_path: Path) -> None:
    def rounds(envs: Any) -> list[bytes]:
        observed, _ = envs.reset(seed=[3, 4])
        assert observed["events"].shape[0] == 2
        found = []
        for _ in range(2):
            *_, info = envs.step(np.array([[20.0], [-15.0]]))
            found += [events["t"].tobytes() for events in info["events"]]
        return found

    with clsim.batch(scene(tmp_path), 2, quality="draft") as simulators:
        envs = gymnasium.vector.SyncVectorEnv([lambda run=run: wrapped(run) for run in simulators])
        together = rounds(envs)
        assert simulators[0]._data is simulators[1]._data
    runs = [simulator(tmp_path, quality="draft") for _ in range(2)]
    alone = rounds(gymnasium.vector.SyncVectorEnv([lambda run=run: wrapped(run) for run in runs]))
    assert together == alone and min(map(len, together)) > 20 * 8
    for run in runs:
        run.close()


def test_columns_are_alike_where_all_their_values_are() -> None:
    """As Gymnasium's checker asks of two runs with one seed."""
    t, x = np.array([1, 2, 3]), np.array([0, 0, 1])
    known = Columns({"t": t, "x": x})
    assert known == Columns({"x": x.copy(), "t": t.copy()})
    for other in ({"t": t}, {"t": t, "x": x + 1}, {"t": t, "y": x}, {"t": t[:2], "x": x[:2]}):
        assert known != Columns(other)
    assert known != {"t": t, "x": x} and known != 1


@pytest.mark.parametrize(("form", "lowest"), [("voxels", -3.0), ("histogram", 0.0)])
def test_the_space_ends_where_observations_do(form: str, lowest: float) -> None:
    """Counts are never negative; polarities are. Networks scale what they see by these ends."""
    space = wrapped(Noise(), form=form, bins=4, limit=3.0).observation_space["events"]  # type: ignore[arg-type,index]
    assert (space.low == lowest).all() and (space.high == 3.0).all()
    assert space.shape == (4 if form == "voxels" else 2, 4, 6) and space.dtype == np.float32
