"""The false decisions of sampling rules, stated and measured."""

import math

import numpy as np
import pytest
from scipy.stats import t as student

from tools import sampling_decisions as tool

TRIALS = 1500
MOST = tool.ALPHA + 3 * math.sqrt(tool.ALPHA * (1 - tool.ALPHA) / TRIALS)
"""What is measured where the stated error is true, but once in 700 times."""


def measured(name, noise):
    rule = next(rule for rule in tool.rules(noise) if rule.name == name)
    return tool.measure(rule, noise, tool.at_threshold(TRIALS), seed=4)


@pytest.mark.parametrize("noise", ["independent", "common"])
class TestStatedErrors:
    def test_one_look_keeps_it_for_a_frame_but_not_until_the_next_event(self, noise):
        outcome = measured("one look", noise)
        assert 0.5 * tool.ALPHA < outcome.false_by_frame <= MOST < outcome.false_by_interval

    @pytest.mark.parametrize("spending", ["Pocock", "O'Brien-Fleming"])
    def test_spent_over_frames_it_holds_until_the_next_event(self, noise, spending):
        outcome = measured(f"one look, error spent over frames, {spending}", noise)
        assert 0 < outcome.false_by_interval <= MOST

    def test_doubling_breaks_it_within_a_frame(self, noise):
        assert measured("doubling", noise).false_by_frame > MOST

    @pytest.mark.parametrize("spending", ["Pocock", "O'Brien-Fleming"])
    def test_spent_over_looks_it_holds_for_a_frame(self, noise, spending):
        outcome = measured(f"doubling, error spent over looks, {spending}", noise)
        assert 0 < outcome.false_by_frame <= MOST and outcome.paths < tool.SIZES[-1]


def test_welchs_test_overstates_the_error_of_common_numbers():
    rng = np.random.default_rng(0)
    frames = tool.draw("common", 200, rng)
    seen = tool.look(np.zeros(200), frames[1], frames[0])
    true_error = seen.passed.std(axis=1)
    np.testing.assert_allclose(np.sqrt(np.mean(seen.paired**2, axis=1)) / true_error, 1, atol=0.2)
    assert (np.median(seen.welch / seen.paired, axis=1) > 10).all()


@pytest.mark.parametrize("spend", [tool.pocock, tool.obrien_fleming])
def test_all_is_spent_and_no_more(spend):
    shares = [0.0625, 0.125, 0.25, 0.5, 1.0]
    assert math.isclose(sum(tool.spent_at_looks(spend, shares)), tool.ALPHA, rel_tol=1e-6)
    assert sum(tool.spent_at_looks(spend, [1 - 0.5**k for k in range(1, 30)])) <= tool.ALPHA


@pytest.mark.parametrize("alpha", [0.05, 0.02, 1e-3, 1e-4])
def test_deviations_are_students(alpha):
    exact = student.isf(alpha, tool.WINDOW * np.array(tool.SIZES) - 1)
    np.testing.assert_allclose(tool.deviations(alpha)[:, 0], exact, rtol=0.01)


def test_the_table_has_every_rule():
    text = tool.table(20, 0)
    assert all(f"| {noise} | {rule.name} |" in text for noise in tool.NOISES for rule in tool.rules(noise))
