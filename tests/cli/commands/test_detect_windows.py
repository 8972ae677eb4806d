"""A still picture seen through data windows that move fires only where a frame holds no pixels."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from clsim.events import EventBatch
from clsim.events.files import open_source

CASE = Path(__file__).parents[4] / "shared" / "cases" / "shift_texture"
pytestmark = pytest.mark.skipif(not CASE.is_dir(), reason="the shared cases are not beside the checkout")


def fired(clsim: Callable[..., object], path: Path, *options: str) -> EventBatch:
    assert clsim("detect", CASE, "--fps", 30, "--out", path, *options).status == 0
    with open_source(path) as source:
        assert (source.width, source.height) == (80, 48)
        return source.read()


def test_nothing_fires_where_both_frames_hold_the_picture(clsim: Callable[..., object], tmp_path: Path) -> None:
    columns = np.unique(fired(clsim, tmp_path / "a.h5", "--method", "esim")["x"]).tolist()
    assert columns == [0, 1, 2, 3, 64, 65, 66, 67]


def test_denoising_does_not_spread_the_black_around(clsim: Callable[..., object], tmp_path: Path) -> None:
    """Two pixels beside the edge are within its window, and see a little of it."""
    x = fired(clsim, tmp_path / "a.h5")["x"]
    assert not np.count_nonzero((x >= 6) & (x < 62)) and np.count_nonzero((x >= 4) & (x < 64)) < 0.02 * len(x)
