"""The plain regression and gate, against the float64 reference's."""

from __future__ import annotations

import numpy as np
import pytest

from clsim.detect.config import DetectorConfig
from clsim.detect.float64.fit import make_windows, solve_windows
from clsim.detect.reference import ReferenceDetector
from clsim.frames import DEPTH, RADIANCE, Frame
from tools.peers.plain_wlr import Window, cut_window, fit_plane, gate_plane

NAMES = RADIANCE + DEPTH
CONFIG = DetectorConfig(gate="published", event_rule="frame", kernel="epanechnikov", window=7, ridge=0.0)


def frame(seed: int, index: int) -> Frame:
    planes = np.random.default_rng(seed).random((len(NAMES), 9, 11), dtype=np.float32) + 0.1
    return Frame(planes, NAMES, time_us=1000 * index, index=index)


def raw(of: Frame) -> tuple[np.ndarray, np.ndarray]:
    """Return features ``[H, W, D]`` in the reference's order, and brightness."""
    brightness = np.log(np.tensordot((0.2126, 0.7152, 0.0722), of.planes[:3].astype(float), axes=1))
    ys, xs = np.mgrid[0 : of.height, 0 : of.width].astype(float)
    return np.stack([xs, ys, *of.planes[3:].astype(float)], axis=-1), brightness


@pytest.mark.parametrize("kernel", ["gaussian", "epanechnikov"])
def test_the_plane_is_the_references(kernel: str) -> None:
    rng = np.random.default_rng(3)
    x, y = rng.normal(size=(169, 9)), rng.normal(size=169)
    plane = fit_plane(Window(x, y, x[84]), kernel)
    config = DetectorConfig(kernel=kernel, ridge=0.0)
    windows = make_windows(x[None], y[None], np.ones((1, 169), dtype=bool), x[None, 84])
    exact = solve_windows(windows, config)
    assert plane.alpha == pytest.approx(exact.alpha[0], rel=1e-7)
    np.testing.assert_allclose(plane.slope, (exact.slope * (windows.hi - windows.lo))[0], rtol=1e-6)
    assert plane.residual == pytest.approx(exact.residual[0], rel=1e-7)
    assert plane.x.min() == 0 and plane.x.max() == pytest.approx(1)


def test_a_constant_feature_does_no_harm() -> None:
    x = np.column_stack([np.arange(25.0), np.full(25, 7.0)])
    plane = fit_plane(Window(x, 2 * x[:, 0] + 1, x[12]), "epanechnikov")
    assert plane.alpha == pytest.approx(25) and plane.slope == pytest.approx([48, 0]) and plane.residual < 1e-12


def test_the_gate_solves_where_the_published_one_does() -> None:
    """Both decide by ΔR > C²; the reference's margin is |√ΔR − C|."""
    old, new = frame(0, 0), frame(1, 1)
    detector = ReferenceDetector(CONFIG, old.width, old.height, NAMES)
    detector.step(old)
    detector.step(new)
    c = CONFIG.threshold_on
    for row in range(old.height):
        for column in range(old.width):
            plane = fit_plane(cut_window(*raw(old), row, column, 7), "epanechnikov")
            delta_r = gate_plane(plane, cut_window(*raw(new), row, column, 7), "epanechnikov")
            assert (delta_r > c * c) == detector.solved[row, column]
            if not detector.solved[row, column]:
                assert abs(np.sqrt(delta_r) - c) == pytest.approx(detector.margin[row, column], rel=1e-4, abs=1e-7)
    assert 0 < detector.solved.mean() < 1
