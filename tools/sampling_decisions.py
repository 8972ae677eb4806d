"""Measure rules that decide how many paths a pixel gets: how often they are wrong, and what they take.

No light is traced: pixels have a true log level whose distance to a threshold is known, and windows of paths whose
errors are independent in every frame, or persist from frame to frame as with common random numbers. A rule looks at the
paths traced so far and either finds its decision safe (the threshold was passed, or was not) or goes on, up to a cap.
It is wrong where it finds safe what is false; what is undecided at the cap is nobody's error.

python tools/sampling_decisions.py --trials 20000
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import NormalDist
from typing import Literal

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
THRESHOLD = 0.2
SIZES = (1, 2, 4, 8, 16)
"""Paths a pixel after which a rule may look."""
WINDOW = 25
"""Pixels that a level is the mean of."""
FRAMES = 8
"""Frames from one event to the next at most."""
SPREAD = 0.5
"""Standard deviation of a path's error [log units]; a window of probes has .1."""
ALPHA = 1 - NormalDist().cdf(2.0)
"""Stated share of false decisions where the level is as good as at the threshold: that of two standard errors."""

Noise = Literal["independent", "common", "common, few change"]
NOISES: tuple[Noise, ...] = ("independent", "common", "common, few change")
PERSISTENCE = 0.998
"""Correlation from frame to frame with common random numbers, or share of paths that do not change."""


def obrien_fleming(share: float, alpha: float = ALPHA) -> float:
    """Return the error spent after a share of the information, late: Lan and DeMets (Biometrika 1983), eq. 7."""
    normal = NormalDist()
    return 2 - 2 * normal.cdf(normal.inv_cdf(1 - alpha / 2) / math.sqrt(share)) if share > 0 else 0.0


def pocock(share: float, alpha: float = ALPHA) -> float:
    """Return the error spent after a share of the information, evenly: Lan and DeMets (Biometrika 1983), eq. 8."""
    return alpha * math.log(1 + (math.e - 1) * share)


def spent_at_looks(spend: Callable[[float], float], shares: Sequence[float]) -> list[float]:
    """Return the error of each look; the sum is what is spent, so that it bounds the error of all (Bonferroni)."""
    spent = [0.0, *map(spend, shares)]
    return [max(b - a, 1e-12) for a, b in pairwise(spent)]


def deviations(alpha: float) -> F64:
    """Return how many standard errors are safe with that error at each of `SIZES`, ``[sizes, 1]``.

    That is Student's t, by Cornish and Fisher's expansion: few paths know their own standard error badly.
    """
    z = -NormalDist().inv_cdf(alpha)
    freedom = WINDOW * np.array(SIZES, dtype=np.float64)[:, None] - 1
    return z + (z**3 + z) / (4 * freedom) + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * freedom**2)


def draw(noise: Noise, trials: int, rng: np.random.Generator) -> list[F64]:
    """Return the errors of paths, ``[trials, WINDOW, paths]`` in the frame of the last event and in those after it."""
    shape = (trials, WINDOW, SIZES[-1])
    if noise == "common, few change":
        frames = [SPREAD * (rng.exponential(size=shape) - 1)]
        for _ in range(FRAMES):
            fresh = SPREAD * (rng.exponential(size=shape) - 1)
            frames.append(np.where(rng.random(shape) < PERSISTENCE, frames[-1], fresh))
        return frames
    keep = PERSISTENCE if noise == "common" else 0.0
    frames = [SPREAD * rng.standard_normal(shape)]
    for _ in range(FRAMES):
        frames.append(keep * frames[-1] + math.sqrt(1 - keep**2) * SPREAD * rng.standard_normal(shape))
    return frames


@dataclass(frozen=True)
class Looks:
    """What a rule can see in one frame; each ``[sizes, trials]``.

    Attributes:
        passed: by how much the level seems to have passed the threshold since the last event.
        paired: standard error of that, from each path's difference to itself at the last event.
        welch: the same as if paths had nothing to do with each other.
    """

    passed: F64
    paired: F64
    welch: F64


def look(truth: F64, now: F64, then: F64) -> Looks:
    """Return what is seen where the truth is beyond the threshold by ``truth``, ``[trials]``."""
    passed, paired, welch = [], [], []
    for n in SIZES:
        a, b = now[:, :, :n].reshape(len(truth), -1), then[:, :, :n].reshape(len(truth), -1)
        difference, count = a - b, a.shape[1]
        passed.append(truth + difference.mean(axis=1))
        paired.append(np.sqrt(difference.var(axis=1, ddof=1) / count))
        welch.append(np.sqrt((a.var(axis=1, ddof=1) + b.var(axis=1, ddof=1)) / count))
    return Looks(np.array(passed), np.array(paired), np.array(welch))


@dataclass(frozen=True)
class Rule:
    """A rule: in each frame, the zones around the threshold that are unsafe at each size, and the sizes looked at.

    ``zones`` takes what is seen and the frame's number since the last event. ``sizes`` are indices of `SIZES` but the
    cap's; between the last of them and the cap nobody looks.
    """

    name: str
    zones: Callable[[Looks, int], F64]
    sizes: tuple[int, ...] = (0,)

    def decide(self, seen: Looks, frame: int) -> tuple[Mask, F64, F64]:
        """Return where a decision was found safe, by how much the threshold seemed passed then, and the paths taken."""
        zones = self.zones(seen, frame)
        safe = np.zeros(seen.passed.shape[1], dtype=bool)
        passed, paths = seen.passed[-1].copy(), np.full(len(safe), float(SIZES[-1]))
        for i in self.sizes:
            now = ~safe & (np.abs(seen.passed[i]) > zones[i])
            passed[now], paths[now] = seen.passed[i][now], SIZES[i]
            safe |= now
        return safe, passed, paths


@dataclass(frozen=True)
class Beforehand:
    """A rule that chooses the paths from what the frame before showed, and does not look again."""

    name: str
    sureness: float

    def choose(self, before: Looks) -> npt.NDArray[np.intp]:
        """Return the indices of the chosen sizes."""
        distance = np.maximum(np.abs(before.passed[0]), 1e-9)
        wanted = (self.sureness * before.paired[0] / distance) ** 2
        return np.minimum(np.searchsorted(SIZES, wanted), len(SIZES) - 1)


def rules(noise: Noise) -> list[Rule | Beforehand]:
    """Return the rules that are compared, with the test that is right for that noise.

    How many frames pass until the next event nobody knows: half of the error that is left is for each.
    """
    doubling = tuple(range(len(SIZES) - 1))
    halves = [1 - 0.5**k for k in range(1, FRAMES + 1)]
    sizes = [n / SIZES[-1] for n in SIZES]
    z = deviations(ALPHA)

    def error(seen: Looks) -> F64:
        return seen.welch if noise == "independent" else seen.paired

    def over_frames(spend: Callable[[float], float]) -> Callable[[Looks, int], F64]:
        safe = [deviations(alpha) for alpha in spent_at_looks(spend, halves)]
        return lambda seen, frame: safe[frame] * error(seen)

    def over_sizes(spend: Callable[[float], float]) -> Callable[[Looks, int], F64]:
        safe = np.array([deviations(alpha)[i] for i, alpha in enumerate(spent_at_looks(spend, sizes))])
        return lambda seen, frame: safe * error(seen)

    every: list[Rule | Beforehand] = [
        Rule("fixed zone C/10", lambda seen, frame: np.full(seen.passed.shape, THRESHOLD / 10)),
        Rule("one look", lambda seen, frame: z * error(seen)),
        Rule("one look, error spent over frames, Pocock", over_frames(pocock)),
        Rule("one look, error spent over frames, O'Brien-Fleming", over_frames(obrien_fleming)),
        Rule("doubling", lambda seen, frame: z * error(seen), doubling),
        Rule("doubling, error spent over looks, Pocock", over_sizes(pocock), doubling),
        Rule("doubling, error spent over looks, O'Brien-Fleming", over_sizes(obrien_fleming), doubling),
        Beforehand("number chosen beforehand", 2.0),
    ]
    if noise != "independent":
        every.append(Rule("doubling, Welch's test", lambda seen, frame: z * seen.welch, doubling))
    return every


@dataclass(frozen=True)
class Outcome:
    """Shares of frames, and of intervals between events, with a false decision; paths a pixel and frame."""

    false_by_frame: float
    false_by_interval: float
    paths: float


def measure(rule: Rule | Beforehand, noise: Noise, truths: F64, seed: int) -> Outcome:
    """Run a rule over intervals between events; ``truths`` is ``[trials, FRAMES]``, beyond the threshold.

    An interval ends with the frame in which the threshold is passed: an event fires.
    """
    rng = np.random.default_rng(seed)
    frames = draw(noise, len(truths), rng)
    going, wrong_ever = np.ones(len(truths), dtype=bool), np.zeros(len(truths), dtype=bool)
    wrongs = pixels = paths_sum = 0.0
    before = look(truths[:, 0], frames[0], frames[0])
    for k in range(FRAMES):
        truth = truths[:, k]
        seen = look(truth, frames[k + 1], frames[0])
        if isinstance(rule, Beforehand):
            chosen = rule.choose(seen if k == 0 else before)
            safe, passed = chosen < len(SIZES) - 1, np.take_along_axis(seen.passed, chosen[None], 0)[0]
            paths = np.array(SIZES, dtype=np.float64)[chosen]
        else:
            safe, passed, paths = rule.decide(seen, k)
        wrong = going & safe & ((passed > 0) != (truth > 0))
        wrong_ever |= wrong
        wrongs += float(wrong.sum())
        pixels += float(going.sum())
        paths_sum += float(paths[going].sum())
        going &= truth <= 0
        before = seen
    return Outcome(wrongs / pixels, float(wrong_ever.mean()), paths_sum / pixels)


def at_threshold(trials: int) -> F64:
    """Levels that stay as near to the threshold as can be, and do not pass it: the worst case."""
    return np.full((trials, FRAMES), -1e-12)


def mixture(trials: int, seed: int) -> F64:
    """Levels that stay, drift or step, from anywhere between two thresholds: a third of each."""
    rng = np.random.default_rng([seed, 1])
    steps = np.arange(1, FRAMES + 1)
    kind = rng.integers(3, size=trials)
    drift = np.where(kind == 1, rng.uniform(0, THRESHOLD / 2, trials), 0)
    jump = np.where(kind == 2, rng.uniform(0, 2 * THRESHOLD, trials), 0)
    at = rng.integers(1, FRAMES + 1, trials)
    start = -rng.uniform(0, THRESHOLD, trials)
    return start[:, None] + drift[:, None] * steps + jump[:, None] * (steps >= at[:, None])


def table(trials: int, seed: int) -> str:
    """Return the Markdown table of all rules, stated and measured."""
    lines = [
        f"Stated: {ALPHA:.2%} where one look, or one interval, spends it all.",
        "",
        "| Noise | Rule | false at the threshold, a frame | an interval | false in the mixture, a frame | paths |",
        "| --- | --- | ---: | ---: | ---: | ---: |",
    ]
    for noise in NOISES:
        for rule in rules(noise):
            worst = measure(rule, noise, at_threshold(trials), seed)
            usual = measure(rule, noise, mixture(trials, seed), seed)
            lines.append(
                f"| {noise} | {rule.name} | {worst.false_by_frame:.2%} | {worst.false_by_interval:.2%} "
                f"| {usual.false_by_frame:.3%} | {usual.paths:.2f} |"
            )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=4000, help="pixels that are simulated")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    print(table(given.trials, given.seed), end="")


if __name__ == "__main__":
    main()
