"""What a sensor is: a group of numbers for each stage, each group off until it says otherwise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from clsim.errors import InputError
from clsim.sensor.stage import Constants, Context, Stage, check_not_negative, check_positive
from clsim.values import read_fields, read_value

_DECADE = math.log(10.0)
_NODES_APART = 0.25
"""Of noise, in time constants: what happens between nodes is known well enough then (see sensor_noise.clh)."""


@dataclass(frozen=True)
class Threshold(Stage):
    """Contrast thresholds, and how they differ from pixel to pixel.

    Attributes:
        on, off: contrast thresholds [natural-log units]; None takes the scene's.
        mismatch: standard deviation of each over the pixels [natural-log units]; normal, and at least a tenth of the
            threshold.
    """

    on: float | None = None
    off: float | None = None
    mismatch: float = 0.0

    own: ClassVar[Mapping[str, tuple[str, ...]]] = {"": ("ON", "OFF")}
    state: ClassVar[Mapping[str, tuple[str, ...]]] = {"": ("REFERENCE", "SINCE")}

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        read_fields(self)
        check_positive(self, "on", "off")
        check_not_negative(self, "mismatch")

    def macros(self) -> tuple[str, ...]:
        """Pixels always have thresholds."""
        return ("", "MISMATCH") if self.mismatch > 0 else ("",)

    def constants(self, context: Context) -> Constants:
        """In natural-log units."""
        return {"THRESHOLD_ON": context.threshold_on, "THRESHOLD_OFF": context.threshold_off, "MISMATCH": self.mismatch}


@dataclass(frozen=True)
class FrontEnd(Stage):
    """From light to what the pixel compares: photocurrent, receptor, source follower.

    Attributes:
        dark_lux: illuminance that gives as much photocurrent as there is in the dark [lux].
        receptor_hz_per_lux: bandwidth (−3 dB) of the receptor for each lux, those of ``dark_lux`` included; None is
            infinitely fast.
        follower_hz: bandwidth (−3 dB) of the source follower, whatever the light [Hz]; None is infinitely fast.
    """

    dark_lux: float = 0.0
    receptor_hz_per_lux: float | None = None
    follower_hz: float | None = None

    state: ClassVar[Mapping[str, tuple[str, ...]]] = {"RECEPTOR": ("RECEPTOR",), "FOLLOWER": ("FOLLOWER",)}

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        read_fields(self)
        check_not_negative(self, "dark_lux")
        check_positive(self, "receptor_hz_per_lux", "follower_hz")

    def macros(self) -> tuple[str, ...]:
        """Each part for itself."""
        parts = {
            "DARK": self.dark_lux > 0,
            "RECEPTOR": self.receptor_hz_per_lux is not None,
            "FOLLOWER": self.follower_hz is not None,
        }
        return tuple(name for name, on in parts.items() if on)

    def constants(self, context: Context) -> Constants:
        """In light of level 0, and seconds."""
        result: Constants = {"DARK": self.dark_lux / context.lux}
        if self.receptor_hz_per_lux is not None:
            result["RECEPTOR_S"] = 1 / (2 * math.pi * self.receptor_hz_per_lux * context.lux)
        return result | {"FOLLOWER_S": context.follower_s}

    @property
    def follower_s(self) -> float:
        """Time constant of the source follower [s]; 0 without one."""
        return 0.0 if self.follower_hz is None else 1 / (2 * math.pi * self.follower_hz)


@dataclass(frozen=True)
class Noise(Stage):
    """Background activity, in one of two ways: events at given rates, or the noise that brings them about.

    Attributes:
        on_hz, off_hz: rate of noise events of each polarity, of a pixel that rests otherwise [1/s]; one number, or one
            for each of ``lux``. Poisson.
        lux: illuminances to which the rates belong, rising; between them rates are linear in the log of light.
        spread_decades: standard deviation of log10 of the rates over the pixels.
        shot: standard deviation in the dark of noise in what the pixel compares [natural-log units]. It has the front
            end's bandwidth, which must be given, and falls with light as that of photons does.
    """

    on_hz: tuple[float, ...] = ()
    off_hz: tuple[float, ...] = ()
    lux: tuple[float, ...] = ()
    spread_decades: float = 0.0
    shot: float = 0.0

    own: ClassVar[Mapping[str, tuple[str, ...]]] = {"RATE_NOISE": ("RATE_FACTOR",)}
    state: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "SHOT_NOISE": ("NOISE", "NEXT_NOISE", "NOISE_AT_REFERENCE", "NOISE_SINCE")
    }

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        read_fields(self)
        check_not_negative(self, "on_hz", "off_hz", "spread_decades", "shot")
        check_positive(self, "lux")
        wanted = max(1, len(self.lux))
        for name in ("on_hz", "off_hz"):
            count = len(getattr(self, name))
            if count not in (0, wanted):
                raise InputError(f"`{name}` has {count} numbers, expected {wanted}, as many as `lux`")
        if list(self.lux) != sorted(set(self.lux)):
            raise InputError(f"`lux` must rise, got {', '.join(f'{each:g}' for each in self.lux)}")

    def macros(self) -> tuple[str, ...]:
        """Each way for itself."""
        rates = max((*self.on_hz, *self.off_hz), default=0.0) > 0
        return (*(("RATE_NOISE",) if rates else ()), *(("SHOT_NOISE",) if self.shot > 0 else ()))

    def constants(self, context: Context) -> Constants:
        """Rates in 1/s at levels."""
        levels = tuple(math.log(lux / context.lux) for lux in self.lux) or (0.0,)
        on, off = (rates or (0.0,) * len(levels) for rates in (self.on_hz, self.off_hz))
        most = max(map(sum, zip(on, off, strict=True)))
        return {
            "RATE_LEVEL": levels,
            "RATE_ON": on,
            "RATE_OFF": off,
            "RATE_MOST": most,
            "RATE_SPREAD": self.spread_decades * _DECADE,
            # Of a length that seldom has two candidates.
            "RATE_SLOT_NS": float(round(1e9 * min(max(0.1 / most, 1e-3), 10.0))) if most > 0 else 1e9,
            "NOISE_SIGMA": self.shot,
            "NOISE_S": context.follower_s,
            "NOISE_SLOT_NS": float(max(1000, round(_NODES_APART * context.follower_s * 1e9))),
        }


@dataclass(frozen=True)
class Leak(Stage):
    """The reference leaks towards ON events.

    Attributes:
        hz: rate of ON events of a median pixel in the dark that rests otherwise [1/s].
        spread_decades: standard deviation of log10 of the rates over the pixels.
        parasitic_hz_per_lux: what light adds to ``hz``.
    """

    hz: float = 0.0
    spread_decades: float = 0.0
    parasitic_hz_per_lux: float = 0.0

    own: ClassVar[Mapping[str, tuple[str, ...]]] = {"LEAK": ("LEAK",), "PARASITIC": ("LEAK_FACTOR",)}
    state: ClassVar[Mapping[str, tuple[str, ...]]] = {"PARASITIC": ("LEAK", "LEAKED")}

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        read_fields(self)
        check_not_negative(self, "hz", "spread_decades", "parasitic_hz_per_lux")

    def macros(self) -> tuple[str, ...]:
        """Light's share for itself."""
        if self.parasitic_hz_per_lux > 0:
            return ("LEAK", "PARASITIC")
        return ("LEAK",) if self.hz > 0 else ()

    def constants(self, context: Context) -> Constants:
        """In ln/s; a rate belongs to the nominal threshold, so that mismatch of thresholds shows in rates."""
        return {
            "LEAK": self.hz * context.threshold_on,
            "LEAK_SPREAD": self.spread_decades * _DECADE,
            "PARASITIC": self.parasitic_hz_per_lux * context.lux * context.threshold_on,
        }


@dataclass(frozen=True)
class Defects(Stage):
    """Pixels that fire always, or never.

    Attributes:
        hot_share: share of pixels that fire ON events by themselves.
        hot_hz: their median rate [1/s].
        hot_spread_decades: standard deviation of log10 of these rates.
        dead_share: share of pixels that never fire.
    """

    hot_share: float = 0.0
    hot_hz: float = 100.0
    hot_spread_decades: float = 0.5
    dead_share: float = 0.0

    own: ClassVar[Mapping[str, tuple[str, ...]]] = {"HOT_PIXELS": ("HOT",)}

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        read_fields(self)
        check_not_negative(self, "hot_share", "hot_hz", "hot_spread_decades", "dead_share")
        for name in ("hot_share", "dead_share"):
            if getattr(self, name) > 1:
                raise InputError(f"`{name}` must be a share from 0 to 1, got {getattr(self, name):g}")

    def macros(self) -> tuple[str, ...]:
        """Hot pixels leak."""
        hot = ("LEAK", "HOT_PIXELS") if self.hot_share > 0 else ()
        return hot + (("DEAD_PIXELS",) if self.dead_share > 0 else ())

    def constants(self, context: Context) -> Constants:
        """Leaks in ln/s."""
        return {
            "HOT_SHARE": self.hot_share,
            "HOT_LEAK": self.hot_hz * context.threshold_on,
            "HOT_SPREAD": self.hot_spread_decades * _DECADE,
            "DEAD_SHARE": self.dead_share,
        }


@dataclass(frozen=True)
class Refractory(Stage):
    """A rest after each event, at whose end the level is the new reference.

    Attributes:
        us: how long it is [µs]; without, the reference moves by the threshold.
    """

    us: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        read_fields(self)
        check_not_negative(self, "us")

    def macros(self) -> tuple[str, ...]:
        """One."""
        return ("REFRACTORY",) if self.us > 0 else ()

    def constants(self, context: Context) -> Constants:
        """In ns."""
        return {"REFRACTORY_NS": float(round(self.us * 1e3))}


@dataclass(frozen=True)
class Delay(Stage):
    """From a crossing to the event's request, beyond what the front end's bandwidth makes of it.

    Attributes:
        latency_us: its mean [µs].
        jitter_us: its standard deviation [µs]; normal, and no event comes before its cause.
    """

    latency_us: float = 0.0
    jitter_us: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        read_fields(self)
        check_not_negative(self, "latency_us", "jitter_us")

    def macros(self) -> tuple[str, ...]:
        """One."""
        return ("DELAY",) if self.latency_us > 0 or self.jitter_us > 0 else ()

    def constants(self, context: Context) -> Constants:
        """In ns."""
        return {"LATENCY_NS": self.latency_us * 1e3, "JITTER_NS": self.jitter_us * 1e3}


@dataclass(frozen=True)
class Readout:
    """From requests of pixels to events on the wire, in this order: scan, queue, controller, stamp.

    Attributes:
        scan_us: period of a scan of all columns, which holds the image: an event is read at the next scan, and one of
            a pixel each [µs]; 0 lets pixels ask at any time.
        event_us: how long the bus takes for an event [µs]: 1 / its largest rate.
        row_us: how much longer where an event is of another row than the one before [µs].
        most_wait_us: who would wait longer for the bus is lost [µs]; None waits for ever.
        control_period_us: period of the event-rate controller [µs].
        most_in_period: events that it lets pass in each, the first; None lets all pass.
        stamp_us: times are whole multiples of it [µs], at or after the event.
    """

    scan_us: float = 0.0
    event_us: float = 0.0
    row_us: float = 0.0
    most_wait_us: float | None = None
    control_period_us: float = 200.0
    most_in_period: int | None = None
    stamp_us: int = 1

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        read_fields(self)
        check_not_negative(self, "scan_us", "event_us", "row_us", "most_wait_us")
        check_positive(self, "control_period_us", "most_in_period", "stamp_us")
        for name in ("scan_us", "control_period_us"):
            if 0 < getattr(self, name) < 1:
                raise InputError(f"`{name}` must be at least 1 µs, got {getattr(self, name):g}")

    @property
    def queues(self) -> bool:
        """Whether the bus takes time."""
        return self.event_us > 0 or self.row_us > 0

    @property
    def is_perfect(self) -> bool:
        """Whether every request is an event at its own time."""
        return not (self.scan_us or self.queues) and self.most_in_period is None and self.stamp_us == 1


@dataclass(frozen=True)
class Optics:
    """What a camera's chip and lens say of the picture; None leaves the scene's.

    Attributes:
        width, height: of the chip [pixels].
        pitch_um: from pixel to pixel [µm]; told, not simulated.
        fov_deg: horizontal field of view [degrees].
    """

    width: int | None = None
    height: int | None = None
    pitch_um: float | None = None
    fov_deg: float | None = None

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        read_fields(self)
        check_positive(self, "width", "height", "pitch_um", "fov_deg")
        if (self.width is None) != (self.height is None):
            raise InputError("`width` and `height` belong together; give both")
        if self.fov_deg is not None and self.fov_deg >= 180:
            raise InputError(f"`fov_deg` must be less than 180, got {self.fov_deg:g}")


_KINDS: dict[str, Any] = {
    "optics": Optics,
    "threshold": Threshold,
    "front_end": FrontEnd,
    "noise": Noise,
    "leak": Leak,
    "defects": Defects,
    "refractory": Refractory,
    "delay": Delay,
    "readout": Readout,
}
STAGES = tuple(name for name in _KINDS if issubclass(_KINDS[name], Stage))
"""What kernels are told of, in the order in which an event meets it."""


def _stage(name: str, value: Any) -> Any:
    """Return a group of settings, which may be given as a mapping."""
    try:
        return read_value(name, value, _KINDS[name])
    except InputError as error:
        raise InputError(f"{name}: {error}") from None


@dataclass(frozen=True)
class SensorSettings:
    """A sensor, by its stages; the defaults are the ideal pixel.

    Attributes:
        name: what it is called.
        optics: resolution and field of view.
        sources: where numbers are from, by "stage.number"; for people.
    """

    name: str = "ideal"
    optics: Optics = field(default_factory=Optics)
    threshold: Threshold = field(default_factory=Threshold)
    front_end: FrontEnd = field(default_factory=FrontEnd)
    noise: Noise = field(default_factory=Noise)
    leak: Leak = field(default_factory=Leak)
    defects: Defects = field(default_factory=Defects)
    refractory: Refractory = field(default_factory=Refractory)
    delay: Delay = field(default_factory=Delay)
    readout: Readout = field(default_factory=Readout)
    sources: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse stages that do not go together."""
        for name in STAGES:
            object.__setattr__(self, name, _stage(name, getattr(self, name)))
        for name in ("optics", "readout"):
            object.__setattr__(self, name, _stage(name, getattr(self, name)))
        front = self.front_end
        if self.noise.shot > 0 and front.follower_hz is None:
            raise InputError("noise: `shot` needs a bandwidth: give front_end `follower_hz`, or rates instead")

    @property
    def stages(self) -> tuple[Stage, ...]:
        """All stages."""
        return tuple(getattr(self, name) for name in STAGES)

    @property
    def macros(self) -> tuple[str, ...]:
        """Macros of the stages that are on."""
        return tuple(dict.fromkeys(name for stage in self.stages for name in stage.macros() if name))

    @property
    def reads_light(self) -> bool:
        """Whether anything hangs on how many lux there are."""
        return bool({"DARK", "RECEPTOR", "PARASITIC"} & set(self.macros)) or len(self.noise.lux) > 1

    @property
    def is_ideal(self) -> bool:
        """Whether no stage is on."""
        return not self.macros and self.readout.is_perfect
