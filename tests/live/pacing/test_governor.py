"""The governor on a machine that is a model: how long a frame takes depends on the level, the load and chance."""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from clsim.live.pacing.governor import Governor
from clsim.live.pacing.ladder import Level, ladder

BUDGET_S = 1 / 30
BEST = Level(probe_spp=1, spp=8, first_hit_rays=16)
LEVELS = ladder(BEST)
MEASURED = 3
"""Level of the frames before the clock runs."""
Load = Callable[[int], float]


@dataclass
class Machine:
    """Renders frame after frame at the pace of the clock; a level holds from the frame after the next on.

    Attributes:
        load: seconds per unit of cost at a frame.
        true_costs: what frames cost indeed, which the governor does not know.
        noise: standard deviation of the logarithm of a frame's time.
    """

    load: Load
    true_costs: list[float]
    noise: float = 0.05
    seed: int = 0
    levels: list[int] = field(default_factory=list)
    lags_s: list[float] = field(default_factory=list)
    busy_s: list[float] = field(default_factory=list)

    def run(self, governor: Governor, frames: int, warm: bool = True) -> "Machine":
        random = np.random.default_rng(self.seed)
        if warm:
            governor.begin(self.load(0) * self.true_costs[MEASURED], MEASURED)
        end_s, coming = 0.0, [governor.level] * 2
        for k in range(frames):
            start_s = max(k * BUDGET_S, end_s)
            level = coming.pop(0)
            busy_s = self.load(k) * self.true_costs[level] * float(np.exp(random.normal(0, self.noise)))
            end_s = start_s + busy_s
            governor.observe(busy_s, start_s - k * BUDGET_S)
            coming.append(governor.level)
            self.levels.append(governor.level)
            self.busy_s.append(busy_s)
            self.lags_s.append(start_s - k * BUDGET_S)
        return self

    @property
    def changes(self) -> int:
        return int(np.count_nonzero(np.diff(self.levels)))


def test_it_knows_that_the_cheapest_level_is_too_slow() -> None:
    cheapest = costs()[-1]
    for load, expected in ((1.3 * BUDGET_S / cheapest, True), (0.8 * BUDGET_S / cheapest, False)):
        governor = Governor(costs(), BUDGET_S)
        machine = Machine(lambda frame, load=load: load, costs()).run(governor, 100)  # type: ignore[misc]
        assert machine.levels[-1] == len(LEVELS) - 1 and governor.too_slow == expected
    governor = Governor(costs(), BUDGET_S)
    assert not governor.observe(2 * BUDGET_S) and not governor.too_slow, "it may still render less"


def costs() -> list[float]:
    return [level.cost for level in LEVELS]


def fitting(level: int, share: float = 0.7) -> float:
    """Load at which ``level`` takes that share of the budget."""
    return share * BUDGET_S / costs()[level]


def test_it_goes_down_within_a_few_frames_of_a_step_in_load_and_comes_back() -> None:
    middle = len(LEVELS) // 2
    machine = Machine(lambda k: fitting(middle) if 300 <= k < 900 else fitting(0), costs())
    machine.run(Governor(costs(), BUDGET_S), 1800)
    assert machine.levels[299] == 0
    assert max(machine.lags_s[:300]) < BUDGET_S
    assert machine.levels[308] >= middle
    assert max(machine.busy_s[310:900]) < BUDGET_S * 1.25
    assert max(machine.lags_s[400:900]) < BUDGET_S
    assert machine.levels[-1] == 0
    assert machine.changes <= 2 * len(LEVELS) + 4


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("level", [0, 2, 5])
@pytest.mark.parametrize("share", [0.6, 0.8, 0.95])
def test_a_load_that_stays_never_makes_it_oscillate(level: int, share: float, seed: int) -> None:
    """Five minutes: costs are wrong by up to a half and frames scatter, so that attempts fail, ever more rarely."""
    random = np.random.default_rng(seed)
    wrong = np.sort(random.uniform(0.67, 1.5, len(LEVELS)))[:: random.choice([-1, 1])]
    true_costs = np.maximum.accumulate((np.array(costs()) * wrong)[::-1])[::-1]
    machine = Machine(lambda k: share * BUDGET_S / true_costs[level], list(true_costs), noise=0.1, seed=seed)
    machine.run(Governor(costs(), BUDGET_S), 9000)
    assert machine.changes < 20
    assert np.count_nonzero(np.diff(machine.levels[4500:])) < 8
    assert np.mean(np.array(machine.lags_s) > BUDGET_S) < 0.001
    usual = int(np.median(machine.levels[4500:]))
    assert usual == 0 or share * true_costs[usual - 1] / true_costs[level] > 0.5, "it renders less than it could"


def test_a_frame_now_and_then_that_takes_long_changes_nothing() -> None:
    machine = Machine(lambda k: fitting(2) * (8 if k % 50 == 49 else 1), costs(), noise=0.02)
    machine.run(Governor(costs(), BUDGET_S), 600)
    assert set(machine.levels[100:]) == {machine.levels[100]} and machine.levels[100] <= 3


def test_without_a_warm_up_it_falls_to_what_fits() -> None:
    machine = Machine(lambda k: fitting(len(LEVELS) - 1), costs()).run(Governor(costs(), BUDGET_S), 300, warm=False)
    assert machine.levels[8] == len(LEVELS) - 1
    assert max(machine.lags_s[150:]) < BUDGET_S


def test_the_warm_up_begins_where_no_frame_is_late() -> None:
    for level in range(len(LEVELS)):
        machine = Machine(lambda k, level=level: fitting(level), costs()).run(Governor(costs(), BUDGET_S), 60)
        assert max(machine.lags_s) < BUDGET_S


def test_a_load_beyond_the_cheapest_level_stays_there() -> None:
    machine = Machine(lambda k: 3 * fitting(len(LEVELS) - 1), costs()).run(Governor(costs(), BUDGET_S), 300)
    assert set(machine.levels) == {len(LEVELS) - 1}


def test_a_run_that_is_late_renders_less_until_it_has_caught_up() -> None:
    governor = Governor(costs(), BUDGET_S)
    for _ in range(50):
        governor.observe(0.85 * BUDGET_S)
    assert governor.level == 0
    for _ in range(4):
        governor.observe(0.85 * BUDGET_S, lag_s=20 * BUDGET_S)
    assert governor.level > 0
    level = governor.level
    for _ in range(100):
        governor.observe(0.1 * BUDGET_S, lag_s=2 * BUDGET_S)
    assert governor.level == level


def test_two_late_frames_are_enough_to_go_down() -> None:
    governor = Governor(costs(), BUDGET_S)
    for _ in range(50):
        governor.observe(0.5 * BUDGET_S)
    assert [governor.observe(1.02 * BUDGET_S) for _ in range(2)] == [False, True]


def test_loads_that_rise_and_fall_again_are_not_taken_for_failures() -> None:
    """Each time the load has fallen the governor is back soon: waits do not grow, as they would if attempts failed."""
    machine = Machine(lambda k: fitting(0, 0.6) * (2.0 if k % 400 >= 300 else 1.0), costs(), noise=0.02)
    machine.run(Governor(costs(), BUDGET_S), 4000)
    for begin in range(400, 4000, 400):
        assert machine.levels[begin - 90] > 0
        assert machine.levels[begin + 150] == 0, f"not back after frame {begin}"


def test_a_new_load_is_not_made_to_wait_for_the_failures_of_the_old() -> None:
    """Level 0 looks as if it fitted and does not: attempts fail, rarer and rarer. Then the load falls."""
    true_costs = costs()
    true_costs[0] *= 2
    machine = Machine(lambda k: fitting(0) if k < 6000 else 0.45 * fitting(0), true_costs, noise=0.02)
    machine.run(Governor(costs(), BUDGET_S), 6200)
    assert 2 < np.count_nonzero(np.diff(machine.levels[:6000])) < 24
    assert machine.levels[-1] == 0


def test_a_level_may_make_it_wait_longer() -> None:
    governor = Governor([4.0, 2.0, 1.0], BUDGET_S, waits=[100, 20, 20])
    governor.begin(5 * BUDGET_S, level=2)
    changed = [k for k in range(200) if governor.observe(0.1 * BUDGET_S)]
    assert governor.level == 0 and 20 <= changed[0] < 40 and 100 <= changed[1] - changed[0] < 110


def test_costs_must_fall() -> None:
    with pytest.raises(ValueError, match="must be positive and fall"):
        Governor([3.0, 3.0, 1.0], BUDGET_S)


@given(
    st.integers(1, 8), st.integers(0, 8), st.sampled_from([1, 2, 4, 8, 16, 64]), st.sampled_from([1, 2, 4, 16]),
    st.sampled_from([None, 1.0, 20.0, 1e4]), st.sampled_from([0.0, 10.0, 30.0, 120.0, 500.0]), st.booleans(),
)  # fmt: skip
def test_down_the_ladder_what_loses_least_goes_first(
    probe_spp: int, more: int, rays: int, every: int, tolerance_us: float | None, fps: float, cached: bool
) -> None:
    """One thing gets worse from rung to rung and nothing better; times first, then frames above 60 a second, samples,
    rays down to 8, probes, and frames above 10 a second."""
    best = Level(probe_spp, probe_spp + more, rays, every, tolerance_us, cached=cached)
    levels = ladder(best, fps)
    order = []
    for above, below in pairwise(levels):
        worse = {
            "times": (below.tolerance_us or 0) - (above.tolerance_us or 0),
            "frames": below.one_in - above.one_in,
            "samples": above.spp - below.spp,
            "rays": above.first_hit_rays - below.first_hit_rays,
            "probes": below.every - above.every,
        }
        assert all(change >= 0 for change in worse.values())
        (name,) = (each for each, change in worse.items() if change)
        order.append("many frames" if name == "frames" and fps >= 60 * below.one_in else name)
        assert below.probe_spp <= below.spp and below.cost < above.cost
    wanted = ["times", "many frames", "samples", "rays", "probes", "frames"]
    assert order == sorted(order, key=wanted.index)
    last = levels[-1]
    assert (last.spp, last.first_hit_rays) == (1, min(rays, 8))
    assert last.every == (4 * every if cached else max(every, 4)), "cached light is seldom probed anyway"
    assert last.tolerance_us in (None, 1e4)
    assert last.one_in == 1 if fps < 20 else 10 <= fps / last.one_in <= 20
    assert all(1 < below.one_in / above.one_in <= 2 for above, below in pairwise(levels) if below.one_in > above.one_in)


def test_what_was_given_up_is_told_in_words() -> None:
    timed = ladder(Level(1, 8, 16, tolerance_us=20.0))
    assert timed[1].given_up_against(timed[0]) == "time tolerance 20 -> 200 us" and timed[0].effort == BEST.effort
    assert LEVELS[0].given_up_against(BEST) == ""
    assert LEVELS[-1].given_up_against(BEST) == "samples 8 -> 1, first-hit rays 16 -> 8, pixels probed each 4 frames"
    assert ladder(BEST, 120.0)[1].given_up_against(BEST) == "1 of 2 frames"


@pytest.mark.parametrize(
    "best", [BEST, Level(4, 16, 32), Level(1, 1, 4), Level(1, 1, 4, 2), Level(1, 1, 1), Level(256, 256, 64)]
)
def test_each_rung_costs_less_than_the_one_above(best: Level) -> None:
    found = [level.cost for level in ladder(best)]
    assert found == sorted(set(found), reverse=True)


@pytest.mark.parametrize(("frames", "wait"), [(30, 20), (20, 40)])
def test_a_rise_is_told_from_a_failure_once_the_usual_time_is_known(frames: int, wait: int) -> None:
    """25 frames tell the usual time; the load that leaves a level before them counts as a failure of it."""
    governor = Governor([2.0, 1.0], BUDGET_S)
    for _ in range(frames):
        assert not governor.observe(0.5 * BUDGET_S)
    assert [governor.observe(1.02 * BUDGET_S) for _ in range(2)] == [False, True]
    after = next(k for k in range(100) if governor.observe(0.2 * BUDGET_S))
    assert wait <= after < wait + 10


@pytest.mark.parametrize(("slow_frames", "wait"), [(200, 40), (5, 20)])
def test_the_usual_time_is_that_of_the_last_frames(slow_frames: int, wait: int) -> None:
    """A load that rose long ago is the usual one, however long it was lower before: what leaves the level then is a
    failure of it, and not a rise."""
    governor = Governor([2.0, 1.0], BUDGET_S)
    for k in range(1000 + slow_frames):
        assert not governor.observe((0.5 if k < 1000 else 0.85) * BUDGET_S)
    assert [governor.observe(1.02 * BUDGET_S) for _ in range(2)] == [False, True]
    after = next(k for k in range(100) if governor.observe(0.2 * BUDGET_S))
    assert wait <= after < wait + 10


def test_failures_are_forgotten_for_good_as_soon_as_the_load_falls() -> None:
    governor = Governor([2.0, 1.0], BUDGET_S)
    for failures in range(4):
        while governor.level == 0:
            governor.observe(1.1 * BUDGET_S)
        if failures < 3:
            waited = next(k for k in range(1000) if governor.observe(0.35 * BUDGET_S))
            assert waited >= 20 << failures
    assert 20 <= next(k for k in range(1000) if governor.observe(0.1 * BUDGET_S)) < 30


@pytest.mark.parametrize("share", [0.3, 0.45, 0.55, 0.75, 0.95])
def test_it_begins_and_falls_as_low_as_it_must_and_no_lower(share: float) -> None:
    """The best level that leaves a third of the time free; after a fall, the best that leaves a fifth."""
    for level in range(len(LEVELS)):
        load = share * BUDGET_S / costs()[level]
        governor = Governor(costs(), BUDGET_S)
        governor.begin(load * costs()[MEASURED], MEASURED)
        fits = [k for k, cost in enumerate(costs()) if load * cost <= 0.6 * BUDGET_S * (1 + 1e-9)]
        assert governor.level == min(fits, default=len(LEVELS) - 1)
        governor = Governor(costs(), BUDGET_S)
        if level == 0 or load * costs()[0] <= BUDGET_S:
            continue
        fallen = next((k for k in range(10) if governor.observe(load * costs()[0])), None)
        fits = [k for k, cost in enumerate(costs()) if k > 0 and load * cost <= 0.8 * BUDGET_S * (1 + 1e-9)]
        assert fallen is not None and governor.level == min(fits, default=len(LEVELS) - 1)


def test_however_late_a_run_is_frames_may_take_seven_tenths_of_their_time() -> None:
    """A little less, where their average is about to be that: it need not fall as low as it can to catch up."""
    for share, leaves in ((0.63, False), (0.66, True)):
        governor = Governor([2.0, 1.0], BUDGET_S)
        assert any(governor.observe(share * BUDGET_S, 1e6) for _ in range(50)) == leaves


def test_frames_get_fewer_by_a_third_at_most_once_they_are_few() -> None:
    fewer = list(dict.fromkeys(level.one_in for level in ladder(BEST, 1000.0)))
    assert fewer == [1, 2, 3, 4, 6, 9, 13, 19, 28, 42, 63, 94]
