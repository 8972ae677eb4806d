"""How fast the detector's kernels are, per second of processor time: PoCL's threads count, other programs do not."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from clsim.detect.config import DetectorConfig, Precision
from clsim.detect.gate import Levels
from clsim.detect.methods.base import Setting
from clsim.detect.methods.esim_ad import EsimAdStages
from clsim.detect.pack import FrameMemory
from clsim.detect.wlr import History
from clsim.frames import ALBEDO, DEPTH, NORMAL, RADIANCE, Frame, page_aligned
from clsim.opencl.device import Device, choose_device
from clsim.opencl.workplace import Grid, Workplace

PEAK_CHAINS = 12
"""Independent chains of multiply-adds in peak.cl."""
_FEATURES = DEPTH + NORMAL + ALBEDO
_NAMES = RADIANCE + _FEATURES


def detect_throughput(
    *, device: Device | None = None, width: int = 320, height: int = 240, window: int = 13, seconds: float = 1.0
) -> dict[str, float | str]:
    """Measure the regression and each stage on noise with all 9 features.

    Each figure is the best of several runs of at least ``seconds`` in all. On a GPU, whose work no processor time
    shows, wall-clock time is used instead, and the keys keep their names.

    Returns:
        ``fits_per_cpu_second``, ``sparse_fits_per_cpu_second`` (a tenth of the pixels, at random),
        ``float64_fits_per_cpu_second``, ``float64_ratio``, ``gate_pixels_per_cpu_second`` (closed-form ΔR test),
        ``<stage>_pixels_per_cpu_second``, ``fma_peak_flops``, ``fma_peak_fraction`` (of the dense regression), and
        ``device``.
    """
    device = device or choose_device()
    clock = time.process_time if device.is_cpu else time.perf_counter
    bench = _Bench(device, width, height, window, seconds, clock)
    result: dict[str, float | str] = {"device": device.name, "lanes": float(device.lanes)}
    result.update(bench.stages("float32"))
    peak = bench.peak("float32")
    fits = float(result["fits_per_cpu_second"])
    result["fma_peak_flops"] = peak
    result["fma_peak_fraction"] = fits * fit_flops(window, len(_FEATURES)) / peak
    double = bench.stages("float64")["fits_per_cpu_second"]
    result["float64_fits_per_cpu_second"] = double
    result["float64_ratio"] = double / fits
    return result


def fit_flops(window: int, features: int) -> int:
    """Return the floating-point operations of one fit as wlr.cl does it; a multiply-add counts 2, the solve 0."""
    weight = 4 * features + 1 + 2 * 4 + 3 + 2
    staging = features + 4
    staged = features + 3
    products = staged * (staged + 1) - 2
    return window * window * (weight + staging + products)


class _Bench:
    """One device, one size; builds what it measures."""

    def __init__(
        self, device: Device, width: int, height: int, window: int, seconds: float, clock: Callable[[], float]
    ) -> None:
        self.device, self.window, self.seconds, self.clock = device, window, seconds, clock
        self.frame = noise_frame(width, height)

    def rate(self, work: Callable[[], None], finish: Callable[[], None], count: float) -> float:
        """Return ``count`` per second of the fastest of some rounds of ``work``; the first one warms up."""
        work()
        finish()
        best, spent = np.inf, 0.0
        while spent < self.seconds:
            start = self.clock()
            work()
            finish()
            taken = max(self.clock() - start, 1e-9)
            best, spent = min(best, taken), spent + taken
        return count / best

    def esim_ad(self, config: DetectorConfig) -> EsimAdStages:
        """Build the stages of method esim-ad, with all features."""
        frame = self.frame
        double = config.precision == "float64"
        lanes = max(1, self.device.lanes // 2) if double else self.device.lanes
        grid = Grid(frame.width, frame.height, lanes, np.dtype(config.precision))
        return EsimAdStages(Setting(config, frame.names, grid, self.device, self.device.queue()), _FEATURES, ())

    def stages(self, precision: Precision) -> dict[str, float]:
        """Measure every stage of one precision."""
        frame, pixels = self.frame, self.frame.width * self.frame.height
        config = DetectorConfig(gate="delta-r", window=self.window, precision=precision)
        engine = self.esim_ad(config)
        radiance = DetectorConfig(gate="radiance", window=self.window, precision=precision)
        boxed = self.esim_ad(radiance)
        boxes = boxed.boxes
        assert boxes is not None
        fit, gate = engine.fit, engine.gate
        queue, history = engine.place.queue, History(0, 1, False)
        memory = FrameMemory(self.device, queue)
        levels, references = [], []
        for each in (engine, boxed):
            each.pack.run(memory.lend(frame), 0)
            memory.take_back(frame)
            images = [each.place.allocate(each.place.layout.image_shape) for _ in range(3)]
            levels.append(Levels(images[0], images[1], config.threshold_on, config.threshold_off))
            references.append(images[2])
        fit.prepare(0)
        rng = np.random.default_rng(0)
        chosen = np.flatnonzero(rng.random(pixels) < 0.1)
        span = engine.place.layout.span
        engine.place.write(gate.pixels, chosen // frame.width * span + chosen % frame.width)

        def pack() -> None:
            engine.pack.run(memory.lend(frame), 0)
            memory.take_back(frame)
            engine.pack.found()

        repeat = 20

        def repeated(work: Callable[[], None]) -> Callable[[], None]:
            def run() -> None:
                for _ in range(repeat):
                    work()

            return run

        def test() -> None:
            engine.test(0, levels[0], references[0])

        def test_radiance() -> None:
            boxed.test(0, levels[1], references[1])

        def collect() -> None:
            gate.collect()

        many = float(pixels * repeat)
        finish, finish_boxed = queue.finish, boxed.place.queue.finish
        result = {
            "fits_per_cpu_second": self.rate(lambda: fit.dense(history), finish, pixels),
            "sparse_fits_per_cpu_second": self.rate(
                lambda: fit.sparse(history, gate.pixels, len(chosen)), finish, len(chosen)
            ),
            "gate_pixels_per_cpu_second": self.rate(repeated(test), finish, many),
            "radiance_gate_pixels_per_cpu_second": self.rate(repeated(test_radiance), finish_boxed, many),
            "pack_pixels_per_cpu_second": self.rate(pack, finish, pixels),
            "minmax_pixels_per_cpu_second": self.rate(repeated(lambda: fit.prepare(0)), finish, many),
            "box_pixels_per_cpu_second": self.rate(
                repeated(lambda: boxes.average(boxed.pack.packed, 0)), finish_boxed, many
            ),
            "list_pixels_per_cpu_second": self.rate(repeated(collect), finish, many),
        }
        memory.close()
        return result

    def peak(self, precision: Precision) -> float:
        """Measure floating-point operations per second of independent multiply-adds on all cores, per core's second."""
        real = np.dtype(precision)
        lanes = self.device.lanes if precision == "float32" else max(1, self.device.lanes // 2)
        items, rounds = (64, 100_000) if self.device.is_cpu else (1 << 20, 1000)
        place = Workplace(self.device, Grid(1, 1, lanes, real), self.device.queue())
        (kernel,) = place.kernels("peak", ("peak",))
        out = place.allocate((items * lanes,))

        def work() -> None:
            place.launch(kernel, (items,), rounds, 0.5, 0.1, out)

        return self.rate(work, place.queue.finish, 2.0 * PEAK_CHAINS * lanes * items * rounds)


def noise_frame(width: int, height: int) -> Frame:
    """Return a frame of smooth features with noise: nothing in it is constant."""
    rng = np.random.default_rng(0)
    planes = page_aligned((len(_NAMES), height, width))
    planes[...] = rng.random(planes.shape, dtype=np.float32)
    return Frame(planes, _NAMES)
