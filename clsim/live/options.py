"""Options of a live run."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from numbers import Real
from typing import Any

from clsim.detect.config import EventRule, Gate, Method
from clsim.errors import InputError
from clsim.events.files import LABELLED
from clsim.events.outputs import FileOptions
from clsim.frames import Policy
from clsim.live.pacing.schedule import LARGEST_FPS, LONGEST_S
from clsim.live.pacing.time_steps import LARGEST_TOLERANCE_US, SMALLEST_TOLERANCE_US, check_time
from clsim.live.pipeline import Pace
from clsim.live.quality import (
    DEFAULT,
    FOLLOWED,
    PLAIN,
    QUALITIES,
    UNCACHED,
    Noise,
    Point,
    Quality,
    Sampler,
    Sampling,
    setting_names,
    with_given,
)
from clsim.live.sensors import read_sensor
from clsim.scene.trajectories.trajectory import Axes, Interpolation
from clsim.sensor.settings import SensorSettings
from clsim.truth.layouts import check_layouts, layout_of
from clsim.truth.names import truth_names
from clsim.values import from_plain, read_fields

LIVE_GATES = ("delta-r", "radiance")


@dataclass(frozen=True)
class LiveOptions:
    """Options of a live run; None takes the scene's own value or, of those that `point` tells, that of the quality."""

    scene: str
    """Name of a bundled scene, or a scene file."""
    strict: bool = False
    """Refuse a scene that asks for what clsim lacks, instead of warning."""
    duration_s: float | None = None
    """Simulated time [s]; None plays the scene's motion once."""
    frame_count: int | None = None
    """Number of frames, instead of a duration."""
    loop: bool = False
    """Start the motion anew at its end, for ever or until ``duration_s``."""
    fps: float | None = None
    """Frames per simulated second."""
    quality: Quality | None = None
    """Named point of speed against accuracy that holds where nothing else is given: see `clsim.live.quality`.

    None takes "balanced", or, where a method is given, 8 light paths of plain random numbers a pixel."""
    sampling: Sampling | None = None
    """Whether every pixel gets the same number of light paths, or as many as tell whether an event fires.

    Or, cached, as many as make known the light that is kept on surfaces."""
    probe_spp: int | None = None
    """Light paths that every pixel gets, where sampling is adaptive."""
    probe_every: int | None = None
    """Frames in which the light of all pixels is found once, in turn; in each where it may decide about an event."""
    spp: int | None = None
    """Light paths per pixel and frame; where sampling is adaptive, at most."""
    first_hit_rays: int | None = None
    """Largest number of rays per pixel that look for the first hit alone; 0 takes it from the light paths."""
    resolution: tuple[int, int] | None = None
    """Width and height [pixels]."""
    camera_path: str | None = None
    """A file of poses that the camera follows, and how long the run lasts where nothing else is said."""
    camera_axes: Axes = "opencv"
    """The camera's axes in that file: opencv has +z ahead and y down, opengl −z ahead and y up."""
    camera_interpolation: Interpolation = "linear"
    """How the poses of that file are joined."""
    threshold: tuple[float, float] | None = None
    """Contrast thresholds of ON and OFF events [natural-log units]; one number is that of both."""
    sensor: SensorSettings | None = None
    """The sensor, also by the name of a preset or as a file; None is the ideal one.

    Its resolution and field of view hold where no ``resolution`` is given."""
    method: Method | None = None
    """How brightness is found from frames; see `clsim.detect.DetectorConfig` for this and what follows."""
    gate: Gate | None = None
    """Which pixels are regressed."""
    event_rule: EventRule | None = None
    """Whether a pixel fires at each crossing of a threshold, or once a frame."""
    window: int | None = None
    """Side of the window that brightness is found from [pixels]."""
    history: int = 1
    """Frames whose windows form one regression."""
    confidence: float = 0.0
    """Standard errors by which brightness must have changed before an event is fired."""
    noise: Noise | None = None
    """Whether every frame has the same random numbers, or its own."""
    seed: int = 0
    sampler: Sampler | None = None
    """Random numbers: plain, or Sobol's sequence (less noise for a little more time)."""
    follow_specular: bool = True
    """Whether depth, normal and albedo are those seen in mirrors and through clear glass."""
    max_depth: int = 8
    """Longest light path [edges]: 1 sees emitters only, 2 adds direct light, 3 one bounce."""
    threads: int | None = None
    """Threads that render; None takes one a core."""
    time: str = "auto"
    """When brightness is found: at frames alone (fixed), or between them too, where events happen (adaptive).

    Or in whole pictures between them, in which nothing goes farther than some pixels from one to the next
    (lambda=PIXELS). auto is adaptive where things go fast and the quality is one of `FOLLOWED`, and else fixed."""
    time_tolerance_us: float | None = None
    """Error of an event's time that will do where time is adaptive [µs]; None takes the quality's."""
    pace: Pace = "max"
    """Whether frames come as fast as they can be made, or no faster than the wall clock."""
    governor: bool = True
    """Whether a run at the pace of the wall clock renders less where it could not keep up."""
    ring: Policy = "block"
    """Whether rendering waits for the detector, or loses the oldest frame."""
    render_device: str = "cpu"
    """Where to render, "cpu" or "cuda:0" …"""
    opencl: str | None = None
    """Part of the name of the OpenCL device to use."""
    outputs: tuple[str, ...] = field(default=())
    """Files and addresses that receive the events."""
    files: FileOptions = field(default_factory=FileOptions)
    truth: tuple[str, ...] = ()
    """What is recorded beside events, of `clsim.truth.TRUTH_NAMES`, or all of it."""
    frame_rate: float | None = None
    """Frames of truth per simulated second, which go into ``fps`` without a rest; None takes all that are rendered."""
    pose_rate: float = 200.0
    """Poses of camera and objects per simulated second."""
    imu_rate: float = 1000.0
    """Inertial samples per simulated second."""
    imu_noise: str | None = None
    """Kalibr's imu.yaml, which says how noisy the inertial sensor is; None is a perfect one."""

    def __post_init__(self) -> None:
        """Refuse values that cannot work; see InputError for how messages name fields."""
        given: Any = self.threshold
        if isinstance(given, Real):
            object.__setattr__(self, "threshold", (given, given))
        object.__setattr__(self, "sensor", read_sensor(self.sensor))
        read_fields(self)
        for option, number in (("duration_s", self.duration_s), ("fps", self.fps)):
            if number is not None and number <= 0:
                raise InputError(f"`{option}` must be a positive number, got {number}")
        if self.duration_s is not None and self.duration_s > LONGEST_S:
            raise InputError(f"`duration_s` must be at most {LONGEST_S:g}, got {self.duration_s:g}")
        if self.max_depth < 1:
            raise InputError(f"`max_depth` must be at least 1, got {self.max_depth}")
        for option, maybe in (
            ("spp", self.spp),
            ("probe_spp", self.probe_spp),
            ("probe_every", self.probe_every),
            ("frame_count", self.frame_count),
            ("threads", self.threads),
        ):
            if maybe is not None and maybe < 1:
                raise InputError(f"`{option}` must be at least 1, got {maybe}")
        self._check_sampling()
        self._check_time()
        if self.seed < 0:
            raise InputError(f"`seed` must not be negative, got {self.seed}")
        if self.frame_count is not None and self.duration_s is not None:
            raise InputError("`frame_count` and `duration_s` both set the length of the run; give one of them")
        if self.resolution is not None and min(self.resolution) < 1:
            width, height = self.resolution
            raise InputError(f"`resolution` must be at least 1x1, got {width}x{height}")
        if self.threshold is not None and min(self.threshold) <= 0:
            raise InputError(f"`threshold` must be positive, got {','.join(f'{v:g}' for v in self.threshold)}")
        object.__setattr__(self, "truth", truth_names(self.truth))
        self._check_truth()
        self._check_files()
        if self.gate is not None and self.gate not in LIVE_GATES:
            raise InputError(
                f"`gate` {self.gate} needs the windows of past frames, which a live run does not keep; "
                f"use one of {', '.join(LIVE_GATES)}, or `clsim detect` on recorded frames"
            )
        if self.ring == "drop-oldest" and self.pace != "real":
            raise InputError("`ring` drop-oldest needs `pace` real: without a clock to keep, every frame would be late")

    @property
    def point(self) -> Point:
        """What holds of method, window, sampling and samples: what is given, and of the rest the quality's settings.

        A method or a sampling without the radiance cache takes the settings of that. Where no quality is named, noise
        of their own or no first-hit rays make samples uniform.
        """
        basis = self.basis
        plain = self.noise == "independent" or self.first_hit_rays == 0
        uncached = plain or self.method not in (None, "esim") or self.sampling in ("uniform", "adaptive")
        # Evidence wants the error of each pixel, which cached light does not tell.
        uncached = uncached or self.confidence > 0
        named = PLAIN if basis is None else (QUALITIES | UNCACHED if uncached else QUALITIES)[basis]
        if self.quality is None and plain:
            named = replace(named, sampling="uniform")
        point = with_given(named, {name: getattr(self, name) for name in setting_names()})
        if self.probe_every is None and (point.noise != "common" or point.first_hit_rays == 0):
            # There is no state from frame to frame.
            point = replace(point, probe_every=1)
        filtered = not (self.sensor is None or self.sensor.is_ideal)
        if filtered and self.event_rule is None and point.event_rule == "linear-light":
            # Levels go through filters, which take lines.
            point = replace(point, event_rule="interpolated")
        return point

    def settled(self, fast: bool) -> LiveOptions:
        """Return the options with a time that is not auto.

        It is adaptive where things go ``fast`` with a quality that follows them, if nothing is given that goes without.
        """
        if self.time != "auto":
            return self
        if fast and self.basis in FOLLOWED and self.pace == "max":
            with contextlib.suppress(InputError):
                return replace(self, time="adaptive")
        return replace(self, time="fixed")

    @property
    def basis(self) -> Quality | None:
        """The quality whose settings hold where nothing else is given; None for those of a named method."""
        if self.quality is not None:
            return self.quality
        return (
            DEFAULT if self.method is None or self.sampling in ("adaptive", "cached") or self.pace == "real" else None
        )

    @property
    def governed(self) -> bool:
        """Whether a governor sets the samples, to keep up with the wall clock."""
        return self.pace == "real" and self.governor and self.ungovernable is None

    @property
    def ungovernable(self) -> str | None:
        """The setting that leaves a governor nothing to set, as messages name it."""
        if self.point.noise != "common":
            return f"`noise` {self.noise}" if self.noise is not None else f"`quality` {self.quality}"
        if self.point.first_hit_rays > 0:
            return None
        return f"`quality` {self.quality}" if self.first_hit_rays is None else "`first_hit_rays` 0"

    def as_dict(self) -> dict[str, Any]:
        """Return the options as plain values, for a sidecar, with the settings that follow from them.

        `from_dict` takes them back.
        """
        point = self.point
        settings: dict[str, Any] = {name: getattr(point, name) for name in setting_names()} | {"quality": self.basis}
        if point.sampling == "uniform":
            settings["probe_spp"] = None
        return asdict(self) | settings

    @classmethod
    def from_dict(cls, plain: Mapping[str, Any]) -> LiveOptions:
        """Return options from plain values, such as ``options`` of a sidecar: they repeat its run.

        Raises:
            InputError: a key is unknown, or a value cannot be.
        """
        return from_plain(cls, plain)

    def _check_truth(self) -> None:
        for option, rate in (
            ("frame_rate", self.frame_rate),
            ("pose_rate", self.pose_rate),
            ("imu_rate", self.imu_rate),
        ):
            if rate is not None and not 0 < rate <= LARGEST_FPS:
                raise InputError(f"`{option}` must be positive and at most {LARGEST_FPS}, got {rate:g}")
        if self.frame_rate is not None and not self.truth:
            raise InputError("`frame_rate` is that of `truth`; say what shall be recorded")
        if self.truth and self.outputs:
            check_layouts(self.outputs, self.truth)
        if self.truth and self.loop:
            raise InputError("`truth` is of one pass of the motion; give it without `loop`")

    def _check_files(self) -> None:
        """Check how files are written; labels of a file with truth are part of that."""
        layouts = [name for name in self.outputs if self.truth and layout_of(name)]
        plain = [name for name in self.outputs if name not in layouts]
        if not self.files.labels or "labels" not in self.truth:
            if self.files.labels and layouts:
                raise InputError("`labels` of outputs with `truth` are part of that; add labels to `truth`")
            files = replace(self.files, objects=False)
            files.check(plain)
        else:
            alone = any(self.files.format_of(name) in LABELLED for name in plain)
            files = replace(self.files, labels=alone, objects=False)
            files.check(plain)
            files = replace(files, objects=alone)
        object.__setattr__(self, "files", files)

    def _check_sampling(self) -> None:
        if self.first_hit_rays is not None and self.first_hit_rays < 0:
            raise InputError(f"`first_hit_rays` must not be negative, got {self.first_hit_rays}")
        point = self.point
        if point.sampling == "uniform" and self.probe_spp is not None:
            raise InputError(
                f"`probe_spp` {self.probe_spp} is for `sampling` adaptive or cached, but sampling is uniform"
            )
        if point.probe_every > 1:
            self._need_first_hit_rays(f"`probe_every` {point.probe_every}")
            if point.noise != "common":
                raise InputError(f"`probe_every` {point.probe_every} needs `noise` common, got {point.noise}")
        if point.sampling != "uniform":
            self._need_first_hit_rays(f"`sampling` {point.sampling}")
            if point.probe_spp > point.spp:
                raise InputError(f"`probe_spp` must be at most `spp` {point.spp}, got {point.probe_spp}")
            if point.noise != "common":
                raise InputError(f"`sampling` {point.sampling} needs `noise` common, got {point.noise}")

    def _check_time(self) -> None:
        check_time(self.time)
        tolerance, point = self.time_tolerance_us, self.point
        if tolerance is not None and not SMALLEST_TOLERANCE_US <= tolerance <= LARGEST_TOLERANCE_US:
            raise InputError(
                f"`time_tolerance_us` must be from {SMALLEST_TOLERANCE_US:g} to {LARGEST_TOLERANCE_US:g}, "
                f"got {tolerance:g}"
            )
        if tolerance is not None and self.time != "adaptive":
            raise InputError(f"`time_tolerance_us` {tolerance:g} is for `time` adaptive, but time is {self.time}")
        if self.time in ("auto", "fixed"):
            return
        if point.method not in ("esim", "irradiance"):
            raise InputError(f"`time` {self.time} needs `method` esim or irradiance, got {point.method}")
        if point.noise != "common":
            raise InputError(f"`time` {self.time} needs `noise` common, got {point.noise}")
        if self.confidence > 0:
            raise InputError(f"`confidence` {self.confidence:g} needs `time` fixed, got {self.time}")
        if point.event_rule == "frame":
            raise InputError(f"`time` {self.time} needs `event_rule` interpolated or linear-light, got frame")
        if point.method == "irradiance":
            self._need_first_hit_rays(f"`time` {self.time} with `method` irradiance")

    def _need_first_hit_rays(self, setting: str) -> None:
        if self.point.first_hit_rays == 0:
            implied = self.first_hit_rays is None and self.quality is not None
            found = f"which `quality` {self.quality} has not: give it too" if implied else "got 0"
            raise InputError(f"{setting} needs `first_hit_rays` of at least 1, {found}")
