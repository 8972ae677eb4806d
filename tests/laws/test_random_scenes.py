"""What holds for scenes that nobody thought of: they are made by chance."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

import clsim
from tests.laws.random_scenes import Scene, as_toml, at_rest, brighter, larger, scene_of, with_speck

pytestmark = pytest.mark.slow  # a scene's kernels are compiled for it alone

SAME: dict[str, tuple[Callable[[Scene], Scene], int]] = {
    "with one thread": (lambda scene: scene, 1),
    "8 times as large": (lambda scene: larger(scene, 8.0), 2),
    "a sixteenth as large": (lambda scene: larger(scene, 1 / 16), 2),
    "4,096 times as bright": (lambda scene: brighter(scene, 4096.0), 2),
    "1/4,096 as bright": (lambda scene: brighter(scene, 1 / 4096), 2),
    "with a speck that nobody sees": (with_speck, 2),
}


SEEDS = [(1, "draft"), (2, "balanced"), (3, "balanced"), (4, "draft"), (5, "balanced")]


def events_of(path: Path, scene: Scene, quality: str, threads: int = 2) -> npt.NDArray[np.void]:
    path.write_text(as_toml(scene))
    with clsim.stream(str(path), frame_count=6, quality=quality, threads=threads) as run:
        return np.concatenate([batch.copy() for batch in run])


def shared(first: npt.NDArray[np.void], second: npt.NDArray[np.void]) -> float:
    """Return the share of events that both have, by their pixels and signs."""
    counts = [
        Counter(zip(*(each[name].tolist() for name in ("x", "y", "on")), strict=True)) for each in (first, second)
    ]
    return (counts[0] & counts[1]).total() / max(len(first), len(second), 1)


@pytest.mark.parametrize(("seed", "quality"), SEEDS)
def test_a_scene_has_the_same_events(tmp_path: Path, seed: int, quality: str) -> None:
    """By however many threads, in whatever units of length and light, and whatever moves where nobody looks."""
    scene = scene_of(seed)
    events = events_of(tmp_path / "scene.toml", scene, quality)
    for how, (changed, threads) in SAME.items():
        again = events_of(tmp_path / "again.toml", changed(scene), quality, threads)
        assert shared(events, again) > 0.97, how
    assert len(events) > 10


@pytest.mark.parametrize("seed", range(1, 7))
def test_a_scene_at_rest_is_silent_though_something_moves_that_nobody_sees(tmp_path: Path, seed: int) -> None:
    scene = with_speck(at_rest(scene_of(seed)))
    assert not len(events_of(tmp_path / "scene.toml", scene, "balanced"))
