"""Compare the kernels at extremes with an exact solution: errors, decisions that change, values that are none.

python -m tools.accuracy.stability --markdown stability.md
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from clsim.detect.config import DetectorConfig, Precision
from clsim.detect.estimator import BrightnessEstimator
from clsim.detect.float64.fit import TINY_RIDGE, Windows, feature_scale, gather, kernel_weights
from clsim.detect.float64.observation import Observation, feature_names, observe
from clsim.detect.layout import BORDER
from clsim.detect.methods.base import Stages
from clsim.detect.reference import ReferenceDetector
from clsim.detector import Detector
from clsim.frames import Frame, frame_time_us
from clsim.opencl.device import Device, choose_device
from clsim.opencl.workplace import Buffer
from tools.accuracy.stability_cases import F64, NAMES, Case, cases, frames

FLOAT32_SMALLEST = 1e-37
"""A range that is no larger is none in float32: 1/range would not be a number (SMALLEST in types.clh)."""
_FRAMES_OF_TIME = 10**6
_ODD_FPS = 60000 / 1001


@dataclass(frozen=True)
class Row:
    """A row of the table, for the float32 and the float64 kernels.

    Attributes:
        name: the extreme.
        alpha_error: largest |α − α of the SVD| [units of y: log units but where y is fed directly].
        flips: pixels that fire otherwise, or are solved otherwise, than in the float64 reference.
        pixels: pixels that were tested.
        bad_values: values that came out NaN or infinite for valid pixels.
    """

    name: str
    alpha_error: dict[Precision, float]
    flips: dict[Precision, int]
    pixels: int
    bad_values: dict[Precision, int]

    def as_dict(self) -> dict[str, Any]:
        """Return the row for JSON."""
        return asdict(self)


class FedEstimator(BrightnessEstimator):
    """An estimator that takes y as it is given, where log luminance has a floor and the rounding of float32 frames."""

    brightness: Sequence[F64] | None = None
    """``[H, W]`` for each frame, by its index; None leaves the frames' own."""

    def _pack(self, frame: Frame, stages: Stages) -> Stages:
        stages = super()._pack(frame, stages)
        if self.brightness is not None:
            packed = stages.place.read(stages.pack.packed)
            inside = packed[self._slot, BORDER : BORDER + frame.height, :, BORDER : BORDER + frame.width]
            inside[:, 1] = np.where(inside[:, 0] > 0, self.brightness[frame.index], 0.0)
            stages.place.write(stages.pack.packed, packed)
        return stages


class FedDetector(Detector):
    """A detector with such an estimator."""

    estimator_type = FedEstimator
    estimator: FedEstimator

    def levels(self) -> F64:
        """Return the level of each pixel, ``[H, W]``, in the kernels' precision; NaN where it has none."""
        if self.estimator.levels is None:
            raise ValueError("no frame yet")
        return self._read(self.estimator.levels.end)

    def references(self) -> F64:
        """Return the level of each pixel's last event, ``[H, W]``."""
        return self._read(self.sensor.references)

    def solved(self) -> Any:
        """Return which pixels the gate had solved in the last step, ``[H, W]``, new ones included."""
        if self.estimator.stages is None:
            raise ValueError("no frame yet")
        return self._read(self.estimator.stages.gate.flags) >= 2

    def _read(self, image: Buffer) -> F64:
        if self.estimator.stages is None:
            raise ValueError("no frame yet")
        return np.asarray(self.estimator.stages.place.read(image)[:, : self.width], dtype=np.float64)


def stability(device: Device | None = None, only: Iterable[Case] | None = None) -> Iterator[Row]:
    """Yield the rows of the table; ``only`` those cases."""
    device = device or choose_device()
    for case in cases() if only is None else only:
        yield measure(case, device)


def measure(case: Case, device: Device) -> Row:
    """Run the kernels in both precisions, the SVD and the reference on one case."""
    precisions: tuple[Precision, ...] = ("float32", "float64")
    errors, flips, bad, pixels = {}, {}, {}, 0
    for precision in precisions:
        errors[precision], wrong = _alpha_error(case, precision, device)
        flips[precision], pixels, unsound = _flips(case, precision, device)
        bad[precision] = wrong + unsound
    return Row(case.name, errors, flips, pixels, bad)


def _config(case: Case, **options: Any) -> DetectorConfig:
    size = case.threshold * case.unit
    return DetectorConfig(threshold_on=size, threshold_off=size, **{**case.options, **options})


def _alpha_error(case: Case, precision: Precision, device: Device) -> tuple[float, int]:
    """Regress every pixel of every frame; return the largest error, and how many results are no numbers."""
    first = case.frames[0]
    config = _config(case, method="wlr-esim", precision=precision)
    detector = FedDetector(config, first.width, first.height, first.names, device=device)
    detector.estimator.brightness = case.brightness
    history: list[Observation] = []
    largest, wrong = 0.0, 0
    for frame in case.frames:
        detector.step(frame)
        history = [*history, _observation(case, frame, config)][-config.history :]
        valid = history[-1].valid
        exact = np.full(valid.shape, np.nan)
        exact.flat[np.flatnonzero(valid)] = svd_alpha(history, np.flatnonzero(valid), config)
        got = detector.levels()
        wrong += int((~np.isfinite(got[valid])).sum())
        look = valid if case.where is None else valid & case.where
        error = np.abs(got - exact)[look]
        largest = max(largest, float(np.where(np.isfinite(error), error, np.inf).max(initial=0.0)))
    detector.close()
    return largest / case.unit, wrong


def _flips(case: Case, precision: Precision, device: Device) -> tuple[int, int, int]:
    """Test the last frame against the models of the one before; return differing, tested and unsound pixels."""
    first = case.frames[0]
    size = (first.width, first.height, first.names)
    config = _config(case, gate="radiance", precision=precision)
    detector, reference = FedDetector(config, *size, device=device), ReferenceDetector(config, *size)
    detector.estimator.brightness = case.brightness
    differ, tested, unsound = 0, 0, 0
    decided = np.zeros((first.height, first.width), dtype=bool)
    for frame in case.frames[:2]:
        observation = _observation(case, frame, config)
        counts = []
        for events in (detector.step(frame), reference.step_observation(observation, frame.time_us)):
            fired = np.zeros((2, *decided.shape), dtype=np.int64)
            np.add.at(fired, (events["on"].astype(int), events["y"], events["x"]), 1)
            counts.append(np.minimum(fired, 1))
        decided = (detector.solved() != reference.solved) | (counts[0] != counts[1]).any(axis=0)
        differ += int(decided.sum())
        for values in (detector.levels(), detector.references()):
            unsound += int((~np.isfinite(values[observation.valid])).sum())
    tested = reference.stats.tested
    detector.close()
    return differ, tested, unsound


def _observation(case: Case, frame: Frame, config: DetectorConfig) -> Observation:
    observation = observe(frame, feature_names(config, frame.names), config)
    if case.brightness is not None:
        observation.brightness = np.where(observation.valid, case.brightness[frame.index], 0.0)
    return observation


def svd_alpha(history: Sequence[Observation], pixels: Any, config: DetectorConfig) -> F64:
    """Return α of each pixel's regression from the singular values of its whole design matrix, in float64.

    The ridge stands as D further rows: no normal equations, which would square the condition number.
    """
    if not len(pixels):
        return np.zeros(0)
    return _svd(gather(history, pixels, config.side, config.stride), config)


def _svd(windows: Windows, config: DetectorConfig) -> F64:
    scale = feature_scale(windows.lo, windows.hi)
    if config.precision == "float32":
        scale = np.where(windows.hi - windows.lo <= FLOAT32_SMALLEST, 0.0, scale)
    x = (windows.x - windows.centre[:, None, :]) * scale[:, None, :]
    weights = windows.mask * kernel_weights(x / config.bandwidth_h, config.kernel)
    share = weights / weights.sum(axis=1, keepdims=True)
    variance = np.einsum("nm,nmj->nj", share, (x - np.einsum("nm,nmj->nj", share, x)[:, None]) ** 2)
    n, m, dimensions = x.shape
    design = np.zeros((n, m + dimensions, 1 + dimensions))
    root = np.sqrt(share)
    design[:, :m, 0] = root
    design[:, :m, 1:] = root[..., None] * x
    each = np.arange(dimensions)
    design[:, m + each, 1 + each] = np.sqrt(config.ridge * variance + TINY_RIDGE)
    right = np.zeros((n, m + dimensions, 1))
    right[:, :m, 0] = root * windows.y
    solution: F64 = np.linalg.pinv(design, rcond=1e-14) @ right
    return np.asarray(solution[:, 0, 0])


def time_error_us(device: Device | None = None) -> float:
    """Return the largest error [µs] of frame times and stamps after 10⁶ frames at a rate that no µs divides.

    Stamps are compared with those of the same two frames at the start, moved by the exact time between.
    """
    from fractions import Fraction

    device = device or choose_device()
    period = Fraction(1001, 60000) * 10**6
    indices = np.unique(np.linspace(0, _FRAMES_OF_TIME, 1000).astype(int)).tolist()
    largest = max(abs(frame_time_us(k, _ODD_FPS) - k * period) for k in indices)
    stamps = []
    config = DetectorConfig(method="esim", precision="float64", threshold_on=0.05, threshold_off=0.05)
    for start in (0, _FRAMES_OF_TIME):
        pair = frames(first_index=start, fps=_ODD_FPS)
        detector = Detector(config, pair[0].width, pair[0].height, NAMES, device=device)
        events = np.concatenate([detector.step(frame) for frame in pair])
        stamps.append(events[np.lexsort((events["t"], events["x"], events["y"]))]["t"])
        detector.close()
    if not len(stamps[0]) or len(stamps[0]) != len(stamps[1]):
        return float("inf")
    moved = stamps[1] - stamps[0] - round(_FRAMES_OF_TIME * period)
    return max(float(largest), float(np.abs(moved).max()))


def markdown(rows: Iterable[Row], time_us: float) -> str:
    """Return the table."""
    head = ("", "error of α, float32", "float64", "flips, float32", "float64", "of pixels", "NaN out")
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for row in rows:
        bad = sum(row.bad_values.values())
        cells = (row.name, *(f"{e:.0e}" for e in row.alpha_error.values()), *map(str, row.flips.values()),
                 str(row.pixels), "none" if bad == 0 else str(bad))  # fmt: skip
        lines.append(f"| {' | '.join(cells)} |")
    lines.append(f"\nAfter 10⁶ frames at 59.94 fps, times and stamps are off by at most {time_us:.1f} µs.\n")
    return "\n".join(lines)


def main() -> None:
    """Measure everything."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, help="write the figures into this file")
    parser.add_argument("--markdown", type=Path, help="write the table into this file")
    given = parser.parse_args()
    device = choose_device()
    rows, time_us = list(stability(device)), time_error_us(device)
    figures = {"device": device.name, "time_error_us": time_us, "rows": [row.as_dict() for row in rows]}
    if given.json is not None:
        given.json.write_text(json.dumps(figures, indent=1) + "\n")
    if given.markdown is not None:
        given.markdown.write_text(markdown(rows, time_us))
    print(markdown(rows, time_us))


if __name__ == "__main__":
    main()
