"""What a sensor is: the stages of its pixels, its readout and its optics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from clsim.errors import InputError
from clsim.events.color_filter import Pattern
from clsim.scene.light.spectral import are_weights, mosaic_of
from clsim.scene.world import Mosaic, Spectral, Vec3
from clsim.sensor.pixel_stages import Defects, Delay, FrontEnd, Leak, Noise, Refractory, Threshold
from clsim.sensor.stage import Stage, check_not_negative, check_positive
from clsim.values import read_fields, read_value


@dataclass(frozen=True)
class Readout:
    """From requests of pixels to events on the wire, in this order: scan, bus, controller, stamp.

    Attributes:
        scan_us: period of a scan of all columns, which holds the image: an event is read at the next scan, and one of
            a pixel each [µs]; 0 lets pixels ask at any time.
        column_us: how long a scan takes for a column [µs], the last column first; where all take longer than
            ``scan_us``, they are the period. 0 reads and stamps all at once.
        arbiter: whom the bus serves: "events", one by one in the order in which pixels ask; or "rows", in the order in
            which they ask first, and all that waits in a row by then together. A pixel that waits asks for nothing
            more: what it fires meanwhile is lost.
        event_us: how long the bus takes for an event [µs]: 1 / its largest rate.
        row_us: how much longer for a row [µs]: for each that is read, or, where events are served, for each event of
            another row than the one before.
        row_stamps: events that are read together bear one time, that of the row; else each that at which it leaves.
        most_wait_us: who would wait longer for the bus is lost [µs]; None waits for ever.
        control_period_us: period of the event-rate controller [µs].
        most_in_period: events that it lets pass in each, the first; None lets all pass.
        stamp_us: times are whole multiples of it [µs], at or after the event.
    """

    scan_us: float = 0.0
    column_us: float = 0.0
    arbiter: Literal["events", "rows"] = "events"
    event_us: float = 0.0
    row_us: float = 0.0
    row_stamps: bool = False
    most_wait_us: float | None = None
    control_period_us: float = 200.0
    most_in_period: int | None = None
    stamp_us: int = 1

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        read_fields(self)
        check_not_negative(self, "scan_us", "column_us", "event_us", "row_us", "most_wait_us")
        check_positive(self, "control_period_us", "most_in_period", "stamp_us")
        for name in ("scan_us", "control_period_us"):
            if 0 < getattr(self, name) < 1:
                raise InputError(f"`{name}` must be at least 1 µs, got {getattr(self, name):g}")
        if self.column_us > 0 and self.scan_us == 0:
            raise InputError("`column_us` is of a scan: give `scan_us` too")
        if self.arbiter == "rows" and not self.queues:
            raise InputError("an `arbiter` of rows takes time: give `row_us`")
        if self.row_stamps and self.arbiter != "rows":
            raise InputError('`row_stamps` needs rows that are read together: give `arbiter = "rows"`')

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
        spectral: how much of R, G and B its pixels see; see `clsim.scene.light.spectral`.
        color_filter: colours of the filters before the pixels (0, 0), (1, 0), (0, 1), (1, 1), and so on.
        filter_red, filter_green, filter_blue: what these filters let through of R, G and B; each counts by its sum.
    """

    width: int | None = None
    height: int | None = None
    pitch_um: float | None = None
    fov_deg: float | None = None
    spectral: Spectral | None = None
    color_filter: Pattern | None = None
    filter_red: Vec3 = (1.0, 0.0, 0.0)
    filter_green: Vec3 = (0.0, 1.0, 0.0)
    filter_blue: Vec3 = (0.0, 0.0, 1.0)

    @property
    def mosaic(self) -> Mosaic | None:
        """What the pixels of each square of four see of R, G and B; None without filters."""
        if self.color_filter is None:
            return None
        return mosaic_of(self.color_filter, self.filter_red, self.filter_green, self.filter_blue)

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        read_fields(self)
        check_positive(self, "width", "height", "pitch_um", "fov_deg")
        if (self.width is None) != (self.height is None):
            raise InputError("`width` and `height` belong together; give both")
        if self.fov_deg is not None and self.fov_deg >= 180:
            raise InputError(f"`fov_deg` must be less than 180, got {self.fov_deg:g}")
        if self.spectral is not None and not are_weights(self.spectral):
            raise InputError(f"`spectral` must be weights of R, G and B from 0, and not all 0, got {self.spectral}")
        if self.spectral is not None and self.color_filter is not None:
            raise InputError("`spectral` is of pixels without filters; give it or `color_filter`")
        for name in ("filter_red", "filter_green", "filter_blue"):
            if not are_weights(getattr(self, name)):
                raise InputError(
                    f"`{name}` must be weights of R, G and B from 0, and not all 0, got {getattr(self, name)}"
                )


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
