"""When a reference is fine enough, told without rendering: references are named by their options."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from clsim.bench.tradeoff.convergence import converge
from clsim.render import RenderOptions

BASE = RenderOptions(spp=8, fps=20.0, frames=5, seed=1)


def found(budget_s, ceilings, same):
    """Converge with a cost of spp·frames seconds, and the F1 of ceilings and of the same events by samples."""
    made = []

    def render(options, name):
        made.append((name, options.spp, options.fps, options.frames, options.seed))
        return SimpleNamespace(options=options, cpu_s=float(options.spp * options.frames))

    def f1(judged, reference):
        assert (judged.options.seed, reference.options.seed) == (2, 1)
        if judged.options.spp == 8:
            return same[reference.options.spp]
        assert judged.options == replace(reference.options, seed=2)
        return ceilings[reference.options.spp]

    return converge(render, f1, BASE, 2, budget_s), made


RISING = {8: 0.4, 16: 0.6, 32: 0.585, 64: 0.59}
FLAT = {8: 0.4, 16: 0.401, 32: 0.402, 64: 0.403}


@pytest.mark.parametrize(
    ("ceilings", "same", "spp", "moved"),
    [(RISING, FLAT, 32, 0.015), (FLAT, RISING, 32, 0.015), (FLAT, FLAT, 16, 0.001)],
)
def test_it_stops_where_both_scores_have_settled(ceilings, same, spp, moved):
    done, made = found(1e9, {**ceilings, 8: 0.4}, same)
    assert done.converged and done.moved == pytest.approx(moved)
    finest = {16: (16, 40.0, 9), 32: (32, 80.0, 17)}
    kinds = (("reference", 1), ("ceiling", 2))
    steps = [(8, 20.0, 5), *(finest[each] for each in (16, 32) if each <= spp)]
    assert made == [(name, *step, seed) for step in steps for name, seed in kinds]
    assert done.reference.options == done.options and done.ceiling.options == replace(done.options, seed=2)
    assert [replace(done, moved=each).converged for each in (None, 0.019, 0.02, 0.03)] == [False, True, False, False]
    assert done.spent_s == sum(2 * step[0] * step[2] for step in steps)


@pytest.mark.parametrize(("budget_s", "spp", "moved"), [(0, 8, None), (399, 8, None), (400, 16, 0.2), (1519, 16, 0.2)])
def test_it_stops_where_a_step_would_cost_more_than_is_left(budget_s, spp, moved):
    done, _ = found(budget_s, RISING, FLAT)
    assert not done.converged and done.options.spp == spp
    assert done.moved == (moved if moved is None else pytest.approx(moved))
    assert done.spent_s <= max(budget_s, 80)
    assert (
        found(1520, RISING, FLAT)[0].options.spp == 32
    )  # 80 and 288 s are spent, and a step costs four times the last
