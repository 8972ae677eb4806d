"""The settings of a live run in groups, each with its checks; `clsim.live.options.LiveOptions` is all of them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
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
from clsim.live.quality import Noise, Quality, Sampler, Sampling
from clsim.live.sensors import read_sensor
from clsim.scene.trajectories.trajectory import Axes, Interpolation
from clsim.sensor.settings import SensorSettings
from clsim.truth.layouts import held_by, layout_of
from clsim.values import read_fields

LIVE_GATES = ("delta-r", "radiance")


@dataclass(frozen=True)
class Group:
    """Settings that are read and checked when they are made; a class of several groups checks them all."""

    def __post_init__(self) -> None:
        """Refuse values that cannot work; see InputError for how messages name fields."""
        read_fields(self)
        self._check()

    def _check(self) -> None:
        """Check values of the right types; begins with ``super()._check()``."""

    def _at_least_1(self, *names: str) -> None:
        for name in names:
            value = getattr(self, name)
            if value is not None and value < 1:
                raise InputError(f"`{name}` must be at least 1, got {value}")


@dataclass(frozen=True)
class SceneSettings(Group):
    """What is seen, and by what camera."""

    scene: str
    """A bundled scene (see `clsim scenes`) or a .toml, .gltf, .glb, .usd, .obj, .ply, .xml or .pbrt file."""
    strict: bool = False
    """Refuse a scene that asks for what clsim lacks, instead of warning."""
    resolution: tuple[int, int] | None = None
    """Width and height [pixels]; the horizontal field of view stays. [the sensor's, else the scene's]"""
    camera_path: str | None = None
    """A file of poses that the camera follows: TUM text, CSV, npz, or a glTF with a camera. The run lasts as long."""
    camera_axes: Axes = "opencv"
    """The camera's axes in that file: opencv, +z ahead and y down; opengl, −z ahead and y up."""
    camera_interpolation: Interpolation = "linear"
    """How the poses of that file are joined: straight and by slerp, or along splines (cubic)."""
    sensor: SensorSettings | None = None
    """The camera: a preset such as davis346 (see docs/sensor.md), or a .toml file. It sets the resolution too, unless
    that is given. [ideal]"""

    def __post_init__(self) -> None:
        """Read what a preset or a file says of the sensor."""
        object.__setattr__(self, "sensor", read_sensor(self.sensor))
        super().__post_init__()

    def _check(self) -> None:
        super()._check()
        if self.resolution is not None and min(self.resolution) < 1:
            width, height = self.resolution
            raise InputError(f"`resolution` must be at least 1x1, got {width}x{height}")

    @property
    def ideal(self) -> bool:
        """Whether the sensor is the ideal one."""
        return self.sensor is None or self.sensor.is_ideal


@dataclass(frozen=True)
class SamplingSettings(Group):
    """How light is found; None takes the quality's."""

    quality: Quality | None = None
    """How much is spent on accuracy: draft is the fastest, balanced suits most, accurate costs several times as much,
    exact does not denoise, published is the ICIP 2023 paper's method with its settings. Other options win over it.
    [balanced; with ``method``, 8 plain paths]"""
    sampling: Sampling | None = None
    """The same for every pixel (uniform); as much as tells whether an event fires (adaptive); or with cached light.
    [the quality's]"""
    probe_spp: int | None = None
    """Light paths that every pixel gets, with adaptive or cached sampling. [the quality's]"""
    probe_every: int | None = None
    """Frames in which the light of all pixels is found once, in turn; in each where it may decide about an event.
    [the quality's]"""
    spp: int | None = None
    """Light paths per pixel and frame; with adaptive or cached sampling, at most. [the quality's]"""
    first_hit_rays: int | None = None
    """Rays per pixel that look for the first hit alone, at most; 0 takes it from the light paths. [the quality's]"""
    noise: Noise | None = None
    """The same random numbers in every frame (common), so that noise cancels in differences; or fresh ones.
    [the quality's]"""
    seed: int = 0
    """Seed of all random numbers."""
    sampler: Sampler | None = None
    """Random numbers: plain (pcg), or Sobol's sequence, which has less noise. [the quality's]"""
    follow_specular: bool = True
    """Depth, normal and albedo of what mirrors and clear glass show, not of the glass itself."""
    max_depth: int = 8
    """Longest light path [edges]: 1 sees emitters only, 2 adds direct light, 3 one bounce."""

    def _check(self) -> None:
        super()._check()
        self._at_least_1("max_depth", "spp", "probe_spp", "probe_every")
        for name, value in (("first_hit_rays", self.first_hit_rays), ("seed", self.seed)):
            if value is not None and value < 0:
                raise InputError(f"`{name}` must not be negative, got {value}")


@dataclass(frozen=True)
class DetectionSettings(Group):
    """How events are found in brightness; see `clsim.detect.DetectorConfig`."""

    threshold: tuple[float, float] | None = None
    """Contrast thresholds of ON and OFF events [natural-log units]; one number is that of both. [the sensor's, else
    the scene's]"""
    method: Method | None = None
    """esim: no denoising; wlr-esim: a regression at every pixel; esim-ad: only where the gate opens; irradiance: a
    filter of the light that falls on surfaces. [the quality's]"""
    gate: Gate | None = None
    """Where esim-ad solves its regression; delta-r is the paper's. [the quality's]"""
    event_rule: EventRule | None = None
    """interpolated: each crossing gets its own time, the logarithm of light being linear between frames; linear-light:
    light itself is; frame: at most one event a frame. [the quality's, else interpolated]"""
    window: int | None = None
    """Side of the window that brightness is found from [pixels], odd, 3…21. [the quality's, else the method's]"""
    history: int = 1
    """Frames whose windows form one regression, 1…5."""
    confidence: float = 0.0
    """Standard errors by which brightness must have changed before an event is fired; with ``method`` irradiance
    alone."""

    def __post_init__(self) -> None:
        """Take one threshold for both."""
        given: Any = self.threshold
        if isinstance(given, Real):
            object.__setattr__(self, "threshold", (given, given))
        super().__post_init__()

    def _check(self) -> None:
        super()._check()
        if self.threshold is not None and min(self.threshold) <= 0:
            raise InputError(f"`threshold` must be positive, got {','.join(f'{v:g}' for v in self.threshold)}")
        if self.gate is not None and self.gate not in LIVE_GATES:
            raise InputError(
                f"`gate` {self.gate} needs the windows of past frames, which a live run does not keep; "
                f"use one of {', '.join(LIVE_GATES)}, or `clsim detect` on recorded frames"
            )


@dataclass(frozen=True)
class TimeSettings(Group):
    """How long a run lasts, when brightness is found, and what clock is kept."""

    duration_s: float | None = None
    """Simulated time [s], rounded to whole frames. [the scene's motion, once]"""
    frame_count: int | None = None
    """Number of frames, instead of a duration."""
    loop: bool = False
    """Start the motion anew at its end, for ever or until ``duration_s``."""
    fps: float | None = None
    """Frames per simulated second. [the scene's]"""
    time: str = "auto"
    """When brightness is found: at frames alone (fixed), or between them too, where events happen (adaptive), or in
    whole pictures from one to the next of which nothing goes farther than some pixels (lambda=0.5, as in ESIM). Unless
    ``fps`` is given there are 30 frames a second then, or what fast things or changing light need. auto is fixed, and
    adaptive where things go over 2 pixels a frame before a still camera, but for draft and published."""
    time_tolerance_us: float | None = None
    """With ``time`` adaptive, error of an event's time that will do [µs]. [100; 30 with accurate and exact]"""
    pace: Pace = "max"
    """As fast as it can; or by the wall clock (real), where a governor renders less while the machine is too slow."""
    governor: bool = True
    """With ``pace`` real, render less rather than fall behind."""
    ring: Policy = "block"
    """Whether rendering waits for the detector (block), or loses the oldest frame (drop-oldest, with ``pace`` real)."""

    def _check(self) -> None:
        super()._check()
        for name, number in (("duration_s", self.duration_s), ("fps", self.fps)):
            if number is not None and number <= 0:
                raise InputError(f"`{name}` must be a positive number, got {number}")
        if self.duration_s is not None and self.duration_s > LONGEST_S:
            raise InputError(f"`duration_s` must be at most {LONGEST_S:g}, got {self.duration_s:g}")
        self._at_least_1("frame_count")
        if self.frame_count is not None and self.duration_s is not None:
            raise InputError("`frame_count` and `duration_s` both set the length of the run; give one of them")
        if self.ring == "drop-oldest" and self.pace != "real":
            raise InputError("`ring` drop-oldest needs `pace` real: without a clock to keep, every frame would be late")
        check_time(self.time)
        tolerance = self.time_tolerance_us
        if tolerance is None:
            return
        if not SMALLEST_TOLERANCE_US <= tolerance <= LARGEST_TOLERANCE_US:
            raise InputError(
                f"`time_tolerance_us` must be from {SMALLEST_TOLERANCE_US:g} to {LARGEST_TOLERANCE_US:g}, "
                f"got {tolerance:g}"
            )
        if self.time != "adaptive":
            raise InputError(f"`time_tolerance_us` {tolerance:g} is for `time` adaptive, but time is {self.time}")


@dataclass(frozen=True)
class OutputSettings(Group):
    """Where events go, and what of the truth goes with them."""

    outputs: tuple[str, ...] = ()
    """Files and addresses that receive the events."""
    files: FileOptions = field(default_factory=FileOptions)
    truth: tuple[str, ...] = ()
    """What is recorded beside the events, such as depth and flow.

    It is all that outputs can hold, none, or of `clsim.truth.TRUTH_NAMES`.
    """
    frame_rate: float | None = None
    """Frames of ``truth`` per simulated second; ``fps`` must be a multiple of it. [all that are rendered]"""
    pose_rate: float = 200.0
    """Poses of camera and objects per simulated second, with ``truth`` poses."""
    imu_rate: float = 1000.0
    """Inertial samples per simulated second, with ``truth`` imu."""
    imu_noise: str | None = None
    """Kalibr's imu.yaml, which says how noisy the inertial sensor is. [a perfect one]"""

    def _check(self) -> None:
        super()._check()
        object.__setattr__(self, "truth", held_by(self.outputs, self.truth))
        for name in ("frame_rate", "pose_rate", "imu_rate"):
            rate = getattr(self, name)
            if rate is not None and not 0 < rate <= LARGEST_FPS:
                raise InputError(f"`{name}` must be positive and at most {LARGEST_FPS}, got {rate:g}")
        if self.frame_rate is not None and not self.truth:
            raise InputError("`frame_rate` is that of `truth`; say what shall be recorded")
        self._check_files()

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


@dataclass(frozen=True)
class MachineSettings(Group):
    """What computes."""

    threads: int | None = None
    """Threads that render. [one a core]"""
    render_device: str = "cpu"
    """Where to render: cpu, cuda:0 … (see `clsim devices`)."""
    opencl: str | None = None
    """Part of the name of the OpenCL device. [a GPU if there is one]"""

    def _check(self) -> None:
        super()._check()
        self._at_least_1("threads")
