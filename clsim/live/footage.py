"""Detection on what cameras recorded: video, pictures and arrays."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from os import PathLike
from typing import Any, cast

import numpy.typing as npt

from clsim.detect.config import DetectorConfig
from clsim.errors import InputError, Notice
from clsim.events import EventBatch, Sink
from clsim.events.outputs import FileOptions
from clsim.footage import Convention, TimeUnit, Transfer
from clsim.footage.arrays import Arrays
from clsim.footage.conventions import CONVENTIONS, PLAIN, Settings
from clsim.footage.open import open_footage
from clsim.footage.source import Footage, Reading
from clsim.footage.times import read_time_us, read_times_us
from clsim.frames import Frame, SourceEnded, page_aligned
from clsim.live.outputs.opening import open_sinks
from clsim.live.outputs.sidecars import about_run
from clsim.live.pacing.schedule import Schedule
from clsim.live.pipeline import Pipeline
from clsim.live.sensors import RecordedSensor, cost_of
from clsim.live.session import Session, now
from clsim.live.stages import detector_maker, unused_options
from clsim.sensor.settings import SensorSettings
from clsim.values import from_plain, read_fields


@dataclass(frozen=True)
class FootageOptions:
    """Options of detection on video and pictures."""

    frames: str
    """A video, or a folder or glob pattern of pictures."""
    fps: float | None = None
    """Frames per second. [the times in the files, or in ``times``]"""
    times: str | None = None
    """File with a time for each frame of video or pictures: text, or .npy. [the file's]"""
    time_unit: TimeUnit = "s"
    """Unit of the times in ``times``."""
    transfer: Transfer | None = None
    """Transfer function that is undone in video and pictures; as-is undoes none. [the file's; bt709 for video that
    tells none, srgb for pictures of whole numbers, linear for others]"""
    like: Convention | None = None
    """What another converter of video takes for brightness, for comparisons; without its noise."""
    opencl: str | None = None
    outputs: tuple[str, ...] = ()
    files: FileOptions = field(default_factory=FileOptions)
    seen_by: RecordedSensor = field(default_factory=RecordedSensor)

    def __post_init__(self) -> None:
        """Refuse values that cannot work; see InputError for how messages name fields."""
        read_fields(self)
        if self.fps is not None and self.fps <= 0:
            raise InputError(f"`fps` must be a positive number, got {self.fps}")
        if self.fps is not None and self.times is not None:
            raise InputError("`fps` and `times` both tell when frames were taken; give one of them")
        self.files.check(self.outputs)

    @property
    def settings(self) -> Settings:
        """What holds where nothing is given."""
        return PLAIN if self.like is None else CONVENTIONS[self.like]

    def open(self) -> Footage:
        """Open the footage; raises InputError."""
        times_us = None if self.times is None else read_times_us(self.times, self.time_unit)
        settings = self.settings
        reading = Reading(self.transfer or settings.transfer, times_us, self.fps, settings.offset)
        return open_footage(self.frames, reading)


def footage_detector(source: Footage, settings: Settings, given: Mapping[str, Any]) -> DetectorConfig:
    """Return the detector's options for footage: those ``given``, ``settings``', what footage asks for."""
    chosen = settings.detector | dict(given)
    config = from_plain(DetectorConfig, chosen)
    floor = source.floor(min(config.threshold_on, config.threshold_off))
    if floor is None or "floor" in chosen or config.response != "ln":
        return config
    return from_plain(DetectorConfig, chosen | {"floor": max(floor * config.scale, config.floor)})


def open_footage_session(
    options: FootageOptions, detector: Mapping[str, Any], extra_sinks: Sequence[Sink] = ()
) -> Session:
    """Open footage and the outputs; raises InputError before anything is detected.

    ``detector`` are options of the detector by name, as far as they are given; see `DetectorConfig`.
    """
    started = now()
    source = options.open()
    try:
        asked = options.settings.detector | dict(detector)
        method = str(asked.get("method", "esim"))
        config = footage_detector(source, options.settings, options.seen_by.detector(asked, method))
        size = source.width, source.height
        schedule = Schedule(source.fps, 1 << 62, source.frame_count, recorded_times=True)
        pipeline = Pipeline(
            lambda: source,
            detector_maker(config, size, source.names, options.opencl, options.seen_by.specimen(config.scale)),
            open_sinks(options.outputs, options.files, extra_sinks, size),
            schedule,
            (source.names, source.height, source.width),
        )
    except BaseException:
        source.close()
        raise
    about = about_run(asdict(options) | {"transfer": source.transfer}, config, schedule.fps, options.seen_by.sensor)
    about |= {"camera": {"width": source.width, "height": source.height}, "detector": asdict(config)}
    warnings = (*source.warnings, *unused_options(config), *cost_of(options.seen_by.sensor, *size))
    return Session(
        options.frames, *size, schedule, pipeline, about, warnings, (), *started, False, footage=source,
        labelled=options.files.labels,
    )  # fmt: skip


def events_from(
    frames: str | PathLike[str] | Iterable[npt.ArrayLike],
    times_us: Iterable[int] | None = None,
    *,
    fps: float | None = None,
    transfer: Transfer | None = None,
    like: Convention | None = None,
    opencl: str | None = None,
    sensor: str | SensorSettings | None = None,
    seed: int = 0,
    lux_per_unit: float = 100.0,
    **detector: Any,
) -> Iterator[EventBatch]:
    """Return the events of a video, of pictures or of arrays, frame by frame, as an iterator; the first is checked now.

    >>> for events in clsim.events_from(pictures, times_us):  # doctest: +SKIP
    ...     print(len(events), "events")

    Args:
        frames: name of a video or folder, or arrays ``[H, W]`` or ``[H, W, 3]`` of uint8, uint16 or floating point.
        times_us: time of each frame [µs], rising; arrays and pictures need them, or ``fps``.
        fps: frames per second, where they are evenly spaced.
        transfer: transfer function of the values; None takes what a file tells, srgb for whole numbers, else linear.
        like: whose conventions hold where nothing else is given.
        opencl: part of the name of the OpenCL device.
        sensor: the sensor, as a preset's name, a TOML file or its settings; None is the ideal one.
        seed: of the sensor's random numbers.
        lux_per_unit: illuminance of the sensor under a luminance of 1 [lux].
        detector: fields of `clsim.detect.config.DetectorConfig`, such as ``threshold_on``.

    Raises:
        InputError: the footage or an option cannot be used.
    """
    if fps is not None and times_us is not None:
        raise InputError("`fps` and `times_us` both tell when frames were taken; give one of them")
    seen_by = from_plain(RecordedSensor, {"sensor": sensor, "seed": seed, "lux_per_unit": lux_per_unit})
    given = {"fps": fps, "transfer": transfer, "like": like, "opencl": opencl, "seen_by": seen_by}
    named = isinstance(frames, str | PathLike)
    told = from_plain(FootageOptions, given | {"frames": frames if named else ""})
    settings, fps = told.settings, told.fps
    chosen = told.transfer or settings.transfer
    if named:
        times = None if times_us is None else [read_time_us(time, k) for k, time in enumerate(times_us)]
        source: Footage = open_footage(told.frames, Reading(chosen, times, fps, settings.offset))
    else:
        source = Arrays(cast(Any, frames), times_us, chosen, fps=fps, offset=settings.offset)
    asked = seen_by.detector(settings.detector | detector, "esim")
    config = footage_detector(source, settings, asked)
    size = source.width, source.height
    make = detector_maker(config, size, source.names, opencl, seen_by.specimen(config.scale))
    return _run(source, make)


def _run(source: Footage, make_detector: Any) -> Iterator[EventBatch]:
    detector = make_detector()
    frame = Frame(page_aligned((len(source.names), source.height, source.width)), source.names)
    index = 0
    try:
        while True:
            try:
                source.fill(index, frame)
            except SourceEnded:
                break
            yield detector.step(frame)
            index += 1
        if masked := detector.stats.masked:
            warnings.warn(f"{masked:,} NaN or infinite pixels were masked", Notice, stacklevel=2)
    finally:
        detector.close()
        source.close()
