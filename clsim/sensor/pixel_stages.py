"""The stages of a pixel: a group of numbers for each, off until it says otherwise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from clsim.errors import InputError
from clsim.sensor.stage import Constants, Context, Stage, check_not_negative, check_positive
from clsim.values import read_fields

_DECADE = math.log(10.0)
_SLOT = 0.75
"""Of noise, at most, in time constants of the follower; between slots it is drawn where it may reach a threshold."""


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

    state: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "FRONT": ("INPUT_SINCE", "INPUT_LEVEL", "INPUT_SLOPE"),
        "RECEPTOR": ("RECEPTOR",),
        "FOLLOWER": ("FOLLOWER",),
    }

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
        on = tuple(name for name, on in parts.items() if on)
        return ("FRONT", *on) if on else ()

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
        on_hz, off_hz: rate of noise events of each polarity, of a pixel that rests otherwise [1/s]; one number for all
            light, or one for each of ``lux``. Poisson.
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

    own: ClassVar[Mapping[str, tuple[str, ...]]] = {"RATE_NOISE": ("RATE_WAIT",)}
    state: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "SHOT_NOISE": ("NOISE_SLOT", "NOISE", "NEXT_NOISE", "NOISE_AT_REFERENCE", "NOISE_LIGHT")
    }

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        read_fields(self)
        check_not_negative(self, "on_hz", "off_hz", "spread_decades", "shot")
        check_positive(self, "lux")
        wanted = max(1, len(self.lux))
        for name in ("on_hz", "off_hz"):
            count = len(getattr(self, name))
            if count not in (0, 1, wanted):
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
        # One number holds in all light.
        on, off = (rates if len(rates) > 1 else (rates or (0.0,)) * len(levels) for rates in (self.on_hz, self.off_hz))
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
            "NOISE_SLOT_NS": 1e3 * self.slot_us(context.follower_s),
        }

    def slot_us(self, follower_s: float) -> int:
        """Return how far apart shot noise behind a source follower of this time constant is drawn [µs].

        A power of two, so that slots can be halved down to a µs, with which launches end.
        """
        longest = min(max(1.0, _SLOT * 1e6 * follower_s), 2.0**20)
        return 1 << int(math.log2(longest))


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
            return ("FRONT", "LEAK", "PARASITIC")
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
