"""When a reference is fine enough, told without rendering: references are named by their options."""

from types import SimpleNamespace

import pytest

from clsim.bench.convergence import converge
from clsim.render import RenderOptions

BASE = RenderOptions(spp=8, fps=20.0, frames=5, seed=1)


def found(budget_s, scores):
    """Converge with a cost of spp·frames seconds and the F1 of each reference by its spp."""
    made = []

    def render(options, name):
        made.append((name, options.spp, options.fps, options.frames, options.seed))
        return SimpleNamespace(options=options, cpu_s=float(options.spp * options.frames))

    def f1(judged, reference):
        assert (judged.options.spp, judged.options.seed, reference.options.seed) == (8, 2, 1)
        return scores[reference.options.spp]

    return converge(render, f1, BASE, 2, budget_s), made


def test_it_stops_where_scores_have_settled():
    done, made = found(1e9, {8: 0.4, 16: 0.6, 32: 0.585, 64: 0.1})
    assert done.converged and done.moved == pytest.approx(0.015)
    assert made == [
        ("reference", 8, 20.0, 5, 1),
        ("ceiling", 8, 20.0, 5, 2),
        ("reference", 16, 40.0, 9, 1),
        ("reference", 32, 80.0, 17, 1),
        ("ceiling", 32, 80.0, 17, 2),
    ]
    assert done.reference.options == done.options and done.ceiling.options.seed == 2
    assert done.spent_s == 2 * 40 + 144 + 2 * 544


@pytest.mark.parametrize(("budget_s", "spp", "moved"), [(0, 8, None), (399, 8, None), (400, 16, 0.2), (1375, 16, 0.2)])
def test_it_stops_where_a_step_and_its_ceiling_would_cost_more_than_is_left(budget_s, spp, moved):
    done, _ = found(budget_s, {8: 0.4, 16: 0.6, 32: 0.61})
    assert not done.converged and done.options.spp == spp
    assert done.moved == (moved if moved is None else pytest.approx(moved))
    assert done.spent_s <= max(budget_s, 80)
