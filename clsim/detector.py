"""The detector: frames in, events out. It joins what estimates brightness and what turns brightness into events."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from clsim.detect.config import DetectorConfig
from clsim.detect.estimator import BrightnessEstimator
from clsim.detect.methods import method_of
from clsim.detect.stats import DetectorStats
from clsim.detect.subframe.between import Between
from clsim.detect.subframe.refine import Refiner
from clsim.detect.subframe.whole_pictures import WholePictures
from clsim.errors import InputError
from clsim.events import Causes, EventBatch
from clsim.frames import Frame, InterestMap, PixelTracer
from clsim.frames.frame import FloatArray
from clsim.opencl.device import Device, choose_device
from clsim.opencl.workplace import Grid, Workplace
from clsim.sensor import IdealPixels, RealPixels, Specimen, Thresholds


def check_sensor(config: DetectorConfig, specimen: Specimen) -> None:
    """Refuse options of detection that a sensor with faults has no use for.

    Raises:
        InputError: ``config`` has one.
    """
    if specimen.settings.is_ideal:
        return
    wants = {"event_rule": "interpolated"} | ({"response": "ln"} if specimen.settings.reads_light else {})
    for name, wanted in wants.items():
        if getattr(config, name) != wanted:
            given, sensor = getattr(config, name), specimen.settings.name
            raise InputError(f"`{name}` {given} is for the ideal sensor; `sensor` {sensor} needs {wanted}")
    if config.confidence > 0:
        raise InputError(f"`confidence` is for the ideal sensor, but `sensor` is {specimen.settings.name}")


class Detector:
    """Turns frames into events by the method, gate and rule of a `DetectorConfig`, in OpenCL.

    `clsim.detect.float64` is the same in float64 numpy.
    """

    estimator_type: ClassVar[type[BrightnessEstimator]] = BrightnessEstimator

    def __init__(
        self,
        config: DetectorConfig,
        width: int,
        height: int,
        names: tuple[str, ...],
        *,
        device: Device | None = None,
        specimen: Specimen | None = None,
        tracer: PixelTracer | None = None,
        tolerance_us: float = 100.0,
        way_px: float | None = None,
    ) -> None:
        """Take frames of ``width`` × ``height`` with the planes ``names``; kernels come by `prepare` or with the first.

        Args:
            config: method, gate and rule, and the nominal thresholds.
            width, height: of the frames [pixels].
            names: planes of the frames.
            device: what computes; None takes the best.
            specimen: the sensor; None is the ideal one.
            tracer: what traces pixels between frames, and is closed with the detector; None lets them be.
            tolerance_us: error of an event's time that will do, where pixels are traced [µs].
            way_px: whole pictures are traced, so many that nothing goes farther between two [pixels]; None traces the
                pixels that fire.

        Raises:
            InputError: a plane is missing, the gate needs recorded frames, options do not go with the sensor, or there
                is no OpenCL device.
        """
        config.check_stream()
        self._specimen = specimen or Specimen()
        check_sensor(config, self._specimen)
        self.config = config
        self.width, self.height, self.names = width, height, names
        self.device = device or choose_device()
        self.stats = DetectorStats()
        self.queue = self.device.queue()
        double = config.precision == "float64"
        lanes = max(1, self.device.lanes // 2) if double else self.device.lanes
        self._grid = Grid(width, height, lanes, np.float64 if double else np.float32)
        self.estimator = self.estimator_type(config, self._grid, names, self.device, self.queue)
        self._sensor: IdealPixels | RealPixels | None = None
        self.causes: Causes | None = None
        """Of the last step's events; None where brightness caused them all."""
        self._tracer = tracer
        self.between: Between | None = None
        self._refiner: Refiner | None = None
        if tracer is not None:
            place = Workplace(self.device, self._grid, self.queue)
            if way_px is None:
                self.between = self._refiner = Refiner(place, config, names, tracer, tolerance_us)
            else:
                self.between = WholePictures(place, config, names, tracer, way_px)

    @property
    def features(self) -> tuple[str, ...]:
        """Planes in the regression; those that have been constant so far are left out."""
        return self.estimator.features

    @property
    def sensor(self) -> IdealPixels | RealPixels:
        """The pixels; built when they are first wanted."""
        if self._sensor is None:
            config = self.config
            rule = config.event_rule
            thresholds = Thresholds(config.threshold_on, config.threshold_off, rule == "frame", rule == "linear-light")
            self._sensor = self._specimen.pixels(Workplace(self.device, self._grid, self.queue), thresholds)
        return self._sensor

    @property
    def tolerance_us(self) -> float:
        """Error of an event's time that will do [µs]; 0 where no chosen pixels are traced between frames."""
        return 0.0 if self._refiner is None else self._refiner.tolerance_us

    @tolerance_us.setter
    def tolerance_us(self, tolerance_us: float) -> None:
        if self._refiner is not None:
            self._refiner.tolerance_us = tolerance_us

    def prepare(self) -> None:
        """Build kernels now, as far as they do not depend on what the first frame shows: while that is rendered."""
        self.estimator.prepare(self.sensor.references)

    def reset(self) -> None:
        """Forget all references, as at the seam of a loop: the next frame initialises again and fires nothing."""
        self.estimator.reset()
        if self.between is not None:
            self.between.reset()
        if self._sensor is not None:
            self._sensor.forget()

    def restart(self) -> None:
        """Reset, and forget what is on its way off the sensor too: time may begin anew."""
        self.reset()
        if self._sensor is not None:
            self._sensor.restart()

    def close(self) -> None:
        """Release the device's memory; safe to call twice."""
        self.estimator.close()
        self._sensor = None
        if self._tracer is not None:
            self._tracer.close()

    def cancel(self) -> None:
        """Make a running ``step`` that traces pixels raise an error soon; safe from any thread."""
        if self._tracer is not None:
            self._tracer.cancel()

    def step(self, frame: Frame) -> EventBatch:
        """Process one frame and return its events, sorted by t, then (y, x).

        Raises:
            InputError: the frame has another size or other planes, or is not later than the one before.
        """
        sensor = self.sensor
        path, counts = self.estimator.observe(frame, sensor.references)
        if self.between is not None:
            path = self.between.refine(path, frame, sensor.references)
        fired = sensor.step(path)
        self.causes = fired.causes
        self.estimator.learn(path, fired.crossings)
        stats = self.stats
        stats.frames += 1
        stats.events += len(fired.events)
        stats.initialised += counts.fresh
        stats.masked += counts.invalid
        stats.tested += counts.kept + counts.solved
        stats.solved += self.estimator.solved(counts)
        stats.many_crossings += fired.many_crossings
        stats.most_crossings = max(stats.most_crossings, fired.most_crossings)
        stats.capped += fired.capped
        stats.lost += fired.lost
        return fired.events

    def level(self) -> FloatArray:
        """Return the brightness [natural-log units] of each pixel at the last frame, ``[H, W]``, for people to look at.

        NaN before a pixel's first valid frame.
        """
        return self.estimator.level()

    def error(self) -> FloatArray | None:
        """Return the standard error of brightness at the last frame, ``[H, W]``; None where the method knows none."""
        return self.estimator.error()

    def interest(self) -> InterestMap:
        """Return how close each pixel is to firing after the last frame; ask after every frame, from the first on.

        Raises:
            ValueError: there was no frame yet.
        """
        return self.estimator.interest(self.stats.frames - 1, self.sensor.references)


class NumpyDetector:
    """What the kernels leave to float64 numpy: gates that need old windows, and bandwidths chosen per pixel.

    They serve to check and to reproduce, not to stream: a gate keeps a window per pixel, and all of it is slow.
    """

    def __init__(self, config: DetectorConfig, width: int, height: int, names: tuple[str, ...]) -> None:
        """Prepare for frames of ``width`` × ``height`` with the planes ``names``.

        Raises:
            InputError: a plane is missing.
        """
        from clsim.detect.float64 import Float64Detector

        method = method_of(config.method)
        method.check_planes(config, names)
        method.candidates(config, names)
        self._detector = Float64Detector(config, width, height, names)

    def step(self, frame: Frame) -> EventBatch:
        """Process one frame and return its events, sorted by t, then (y, x)."""
        return self._detector.step(frame)

    def reset(self) -> None:
        """Forget all references: the next frame initialises again and fires nothing."""
        self._detector.reset()

    def level(self) -> FloatArray:
        """Return the brightness [natural-log units] of each pixel at the last frame, ``[H, W]``."""
        return self._detector.level.astype(np.float32)

    def close(self) -> None:
        """Release nothing; here so that all detectors end alike."""

    @property
    def stats(self) -> DetectorStats:
        """Counts since the start."""
        return self._detector.stats


def recorded_detector(
    config: DetectorConfig,
    width: int,
    height: int,
    names: tuple[str, ...],
    *,
    device: Device | None = None,
    specimen: Specimen | None = None,
) -> Detector | NumpyDetector:
    """Return the detector of ``config`` for recorded frames; ``device`` is for those that run in OpenCL.

    Raises:
        InputError: a plane is missing, or there is no OpenCL device where one is needed.
    """
    if config.needs_numpy:
        if specimen is not None and not specimen.settings.is_ideal:
            raise InputError(f"{config.who()} runs in numpy, with the ideal `sensor` alone")
        return NumpyDetector(config, width, height, names)
    return Detector(config, width, height, names, device=device, specimen=specimen)
