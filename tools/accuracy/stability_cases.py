"""The extremes at which tools/accuracy/stability.py looks: frames, options, and where to look at them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.frames import ALBEDO, COVERAGE, DEPTH, NORMAL, RADIANCE, Frame, frame_time_us, page_aligned

F64 = npt.NDArray[np.float64]
NAMES = RADIANCE + DEPTH + NORMAL + ALBEDO
THRESHOLD = 0.14
LAMBDAS = (1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2)
_FPS = 60.0
_HEIGHT, _WIDTH = 20, 26


@dataclass(frozen=True)
class Case:
    """One row of the table.

    Attributes:
        name: what the row is called.
        frames: the second is tested against the model of the first.
        options: of `DetectorConfig`, beside the thresholds.
        unit: size of y; thresholds and errors are counted in it.
        brightness: ``[H, W]`` for each frame: y itself instead of the frames' log luminance.
        threshold: C, in units.
        where: ``[H, W]``, pixels whose α is compared; None for all.
    """

    name: str
    frames: list[Frame]
    options: Mapping[str, Any] = field(default_factory=dict)
    unit: float = 1.0
    brightness: list[F64] | None = None
    threshold: float = THRESHOLD
    where: npt.NDArray[np.bool_] | None = None


def cases() -> Iterator[Case]:
    """Yield every row."""
    yield Case("random features", frames())
    yield from _features()
    yield from _brightness()
    yield from _windows()
    yield from _bad_pixels()
    yield from _small_frames()
    for c in (1e-36, 1e-6, 1e30):
        yield Case(f"C = {c:.0e}", frames(), threshold=c)
    for value in LAMBDAS:
        yield Case(f"λ = {value:.0e}, features collinear but for 1e-4", _nearly_collinear(), {"ridge": value})
    for value in LAMBDAS:
        yield Case(f"λ = {value:.0e}, a smooth surface", changed(curved), {"ridge": value})


def frames(height: int = _HEIGHT, width: int = _WIDTH, first_index: int = 0, fps: float = _FPS) -> list[Frame]:
    """Return two noisy frames of random features, of which the second is a little changed."""
    rng = np.random.default_rng(7)
    start = rng.random((len(NAMES), height, width))
    result = []
    for k in range(2):
        planes = page_aligned((len(NAMES), height, width))
        planes[...] = start + 0.05 * k * rng.random(start.shape) + 0.05
        result.append(Frame(planes, NAMES, frame_time_us(first_index + k, fps), k))
    return result


def changed(change: Callable[[Frame], None], **size: int) -> list[Frame]:
    """Return random frames after ``change`` has been made to each."""
    result = frames(**size)
    for frame in result:
        change(frame)
    return result


def with_coverage(change: Callable[[Frame], None]) -> list[Frame]:
    """Return random frames that also have a coverage plane of 1, after ``change``."""
    result = []
    for frame in frames():
        planes = page_aligned((len(NAMES) + 1, frame.height, frame.width))
        planes[:-1], planes[-1] = frame.planes, 1.0
        result.append(Frame(planes, NAMES + COVERAGE, frame.time_us, frame.index))
        change(result[-1])
    return result


def curved(frame: Frame) -> None:
    """Give a frame the features of a smooth, drifting surface: in a window they are nearly linear, so collinear."""
    ys, xs = np.mgrid[0:_HEIGHT, 0:_WIDTH] + 0.3 * frame.index
    frame.plane("Depth")[...] = 3 + 0.1 * ys + 0.01 * xs * xs
    for j, name in enumerate(NAMES[4:]):
        frame.plane(name)[...] = np.sin(0.05 * (1 + j) * xs + 0.04 * j * ys)


def _features() -> Iterator[Case]:
    def constant(frame: Frame) -> None:
        frame.planes[3:] = 0.7

    def constant_in_windows(frame: Frame) -> None:
        frame.planes[3:, :, : _WIDTH // 2] = 0.7

    def collinear(frame: Frame) -> None:
        for j, name in enumerate(NAMES[4:]):
            frame.plane(name)[...] = 2.0**j * frame.plane("Depth")

    def deep(frame: Frame) -> None:
        frame.plane("Depth")[...] = 10.0 ** (9 * frame.plane("Depth") / 1.1 - 3)

    def far(frame: Frame) -> None:
        frame.plane("Depth")[...] += 1e6

    def subnormal(frame: Frame) -> None:
        frame.planes[3:5] *= 1e-40

    def sky(frame: Frame) -> None:
        missed = np.random.default_rng(3).random((_HEIGHT, _WIDTH)) < 0.3
        frame.planes[3:, missed] = 0

    yield Case("7 of 9 features constant", changed(constant))
    yield Case("the same in half of the frame", changed(constant_in_windows))
    yield Case("a smooth surface", changed(curved))
    yield Case("features collinear", changed(collinear))
    yield Case("features collinear but for 1e-4", _nearly_collinear())
    yield Case("depth 1e-3 … 1e6", changed(deep))
    yield Case("depth 1e6 + [0, 1]", changed(far))
    yield Case("subnormal features (1e-40)", changed(subnormal))
    yield Case("30 % misses", with_coverage(sky))


def _nearly_collinear() -> list[Frame]:
    def change(frame: Frame) -> None:
        noise = np.random.default_rng(5).random((len(NAMES), _HEIGHT, _WIDTH))
        for name, each in zip(NAMES[4:], noise, strict=False):
            frame.plane(name)[...] = frame.plane("Depth") + 1e-4 * each

    return changed(change)


def _brightness() -> Iterator[Case]:
    rng = np.random.default_rng(11)
    noise = [rng.standard_normal((_HEIGHT, _WIDTH)).astype(np.float32).astype(np.float64) for _ in range(2)]
    for size in (1e30, 1e12, 1e-12, 1e-30):
        fed = [(np.float32(size) * y.astype(np.float32)).astype(np.float64) for y in noise]
        yield Case(f"y of size {size:.0e}", frames(), unit=size, brightness=fed)

    def times(factor: float) -> Callable[[Frame], None]:
        def change(frame: Frame) -> None:
            frame.planes[:3] *= np.float32(factor)

        return change

    yield Case("luminance 1e30", changed(times(1e30)))
    yield Case("luminance 1e-30, floor 1e-37", changed(times(1e-30)), {"floor": 1e-37})
    yield Case("luminance 1e-42 (subnormal), floor 1e-37", changed(times(1e-42)), {"floor": 1e-37})
    yield Case("luminance 0", changed(times(0.0)))

    def black_spots(frame: Frame) -> None:
        frame.planes[:3, ::3, ::2] = 0

    yield Case("luminance 0 at every sixth pixel", changed(black_spots))
    yield Case("response lin-log, luminance 0 at every sixth pixel", changed(black_spots), {"response": "lin-log"})


def _windows() -> Iterator[Case]:
    corner = np.zeros((_HEIGHT, _WIDTH), dtype=bool)
    corner[np.ix_((0, 1, -2, -1), (0, 1, -2, -1))] = True
    yield Case("corners", frames(), where=corner)
    yield Case("9 pixels, 10 unknowns (3×3)", frames(), {"window": 3})
    yield Case(
        "21×21, stride 3, 3 frames", [*frames(), frames(first_index=2)[1]], {"window": 21, "stride": 3, "history": 3}
    )

    def lonely(frame: Frame) -> None:
        keep = frame.planes[:, 10, 13].copy()
        frame.planes[...] = np.nan
        frame.planes[:, 10, 13] = keep

    yield Case("one valid pixel", changed(lonely))


def _bad_pixels() -> Iterator[Case]:
    def sprinkled(frame: Frame) -> None:
        rng = np.random.default_rng(frame.index)
        bad = rng.random(frame.planes.shape) < 0.1 / len(NAMES)
        frame.planes[bad] = rng.choice([np.nan, np.inf, -np.inf], int(bad.sum()))

    def centre(frame: Frame) -> None:
        if frame.index:
            frame.planes[0, 10, 13] = np.nan

    def ring(frame: Frame) -> None:
        inside = frame.planes[:, 10, 13].copy()
        frame.planes[:, 4:17, 7:20] = np.inf
        frame.planes[:, 10, 13] = inside

    yield Case("10 % of the pixels NaN or infinite", changed(sprinkled))
    yield Case("NaN at one pixel, in the second frame", changed(centre))
    yield Case("a window of infinities round one pixel", changed(ring))


def _small_frames() -> Iterator[Case]:
    for height, width in ((1, 1), (1, 40), (40, 1), (5, 4)):
        yield Case(f"frame of {width}×{height}", frames(height=height, width=width))
