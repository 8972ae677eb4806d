"""Options of detection."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Literal

from clsim.errors import InputError
from clsim.values import read_fields

Method = Literal["esim", "wlr-esim", "esim-ad", "irradiance"]
Gate = Literal["delta-r", "radiance", "delta-r-exact", "published"]
EventRule = Literal["interpolated", "linear-light", "frame"]
Kernel = Literal["gaussian", "epanechnikov"]
Response = Literal["ln", "lin-log"]
Regress = Literal["log", "linear"]
Bandwidth = Literal["fixed", "tsvd", "optimised"]
Luma = Literal["rec709", "rec601"]
Weights = tuple[float, float, float]
Luminance = Luma | Weights
Precision = Literal["float32", "float64"]
SMALLEST_THRESHOLD = 1e-36
"""The number of crossings in a step, up to 160 / C, must be a number in float32."""
LARGEST_THRESHOLD = 1e30
"""So must be C itself, and sums with it."""
LARGEST_SHRINK = 100.0
LARGEST_CONFIDENCE = 100.0
SMALLEST_FLOOR = 1.2e-38
"""Smaller numbers are subnormal in float32: some devices take them for 0."""
KEPT_WINDOW_GATES: tuple[Gate, ...] = ("delta-r-exact", "published")
"""Gates that need the window of each pixel's last event, and so recorded frames."""
_OF_GATES = ("gate", "gate_scale", "box")
_OF_REGRESSIONS = (
    "stride",
    "history",
    "kernel",
    "bandwidth_h",
    "bandwidth",
    "ridge",
    "regress",
    "shrink",
    "features",
)


@dataclass(frozen=True)
class MethodFacts:
    """What options mean to a method.

    Attributes:
        windowed: whether it reads more than the pixel.
        window: side of the window where none is asked for [pixels].
        regresses: whether brightness is regressed on features.
        gated: whether a gate chooses where.
        knows_error: whether the standard error of brightness is known.
    """

    windowed: bool = True
    window: int = 13
    regresses: bool = False
    gated: bool = False
    knows_error: bool = False


METHODS: dict[Method, MethodFacts] = {
    "esim": MethodFacts(windowed=False),
    "wlr-esim": MethodFacts(regresses=True),
    "esim-ad": MethodFacts(regresses=True, gated=True),
    "irradiance": MethodFacts(window=7, knows_error=True),
}


@dataclass(frozen=True)
class DetectorConfig:
    """Options of the detector; thresholds and floor in natural-log units of scaled luminance."""

    method: Method = "esim-ad"
    gate: Gate = "radiance"
    """Where esim-ad solves its regression. delta-r-exact (to check delta-r) and published (the ICIP 2023 program's)
    keep old windows and run in numpy, slowly."""
    event_rule: EventRule = "interpolated"
    """frame: at most one event a pixel and frame; else one for each crossing, at its own time between two frames.

    There the logarithm of light is linear in time (interpolated), or light itself (linear-light): so it is of an edge
    that passes a pixel, since the covered share is.
    """
    threshold_on: float = 0.2
    """Contrast threshold C of ON events, > 0."""
    threshold_off: float = 0.2
    """Contrast threshold C of OFF events, > 0 (its size: the sign is implied)."""
    confidence: float = 0.0
    """Standard errors by which brightness must have changed since the last event before the next one is fired.

    With more, fewer events are noise, and more are missed or late. Only `irradiance` knows its error.
    """
    window: int | None = None
    """Side K of the window [pixels], odd, 3…21; None takes 7 for irradiance, else 13 (see `side`)."""
    stride: int = 1
    """Step between the window's samples [pixels], 1…3."""
    history: int = 1
    """Number T of frames whose windows form one regression, 1…5."""
    box: int = 5
    """Side of the radiance gate's box means [pixels], odd."""
    gate_scale: float = 1.0
    """s: the radiance gate opens beyond s·C."""
    kernel: Kernel = "gaussian"
    """Weight of a sample by its distance in feature space."""
    bandwidth_h: float = 1.0
    """Bandwidth h of the weights."""
    bandwidth: Bandwidth = "fixed"
    """fixed: h everywhere; or chosen per pixel: tsvd leaves out noisy directions of feature space, optimised also
    weighs bias against variance. Both need variance planes and run in numpy, slowly."""
    ridge: float = 1e-5
    """λ: how much β is penalised, by the features' own second moments; α never is."""
    regress: Regress = "log"
    """What is regressed: log brightness, as in the paper; or linear luminance, whose log is taken then: that of few
    samples is too low on average."""
    shrink: float = 0.0
    """How readily a pixel's own value counts where its window's residual is more than noise: 0 never, 1.5 is good.
    Needs ``regress`` linear and the plane Variance.Luminance.

    The fit gives way to it by 1 − shrink·(noise / residual) where that is positive.
    """
    response: Response = "ln"
    """Brightness of a luminance."""
    luminance: Luminance = "rec709"
    """Weights of R, G and B: a standard's, or three of your own."""
    mosaic: tuple[Weights, Weights, Weights, Weights] | None = None
    """Such weights of the pixels (0, 0), (1, 0), (0, 1) and (1, 1) of each square, behind filters; None without."""
    scale: float = 1.0
    """Factor on luminance."""
    floor: float = 1e-4
    """Smallest luminance after scaling."""
    features: tuple[str, ...] | None = None
    """Planes to regress on besides pixel x and y. [what the frames have]"""
    precision: Precision = "float32"
    """Arithmetic of the regression."""

    @property
    def fires_at(self) -> tuple[float, float] | None:
        """Contrast thresholds of ON and OFF events, if a pixel fires at each that its own log brightness crosses."""
        crosses = self.method == "esim" and self.response == "ln" and self.event_rule != "frame"
        return (self.threshold_on, self.threshold_off) if crosses else None

    def __post_init__(self) -> None:
        """Refuse values outside their range; see InputError for how messages name fields."""
        read_fields(self)
        for name in ("threshold_on", "threshold_off"):
            value = getattr(self, name)
            if not SMALLEST_THRESHOLD <= value <= LARGEST_THRESHOLD:
                raise InputError(
                    f"`{name}` must be a positive number from {SMALLEST_THRESHOLD:g} to {LARGEST_THRESHOLD:g}, "
                    f"got {value:g} for {'ON' if name == 'threshold_on' else 'OFF'} events"
                )
        if self.event_rule == "linear-light" and self.response != "ln":
            raise InputError(f"`event_rule` linear-light needs `response` ln, got {self.response}")
        if not isinstance(self.luminance, str) and (min(self.luminance) < 0 or sum(self.luminance) == 0):
            raise InputError(f"`luminance` must be weights that are not negative, and not all 0, got {self.luminance}")
        if self.mosaic is not None and self.method != "esim":
            raise InputError(
                f"a `sensor` with a color_filter needs `method` esim, got {self.method}, which mixes neighbours that "
                "are behind other filters"
            )
        if 0 < self.floor < SMALLEST_FLOOR:
            raise InputError(f"`floor` must be at least {SMALLEST_FLOOR:g}, got {self.floor:g}")
        for name in ("bandwidth_h", "gate_scale", "scale", "floor"):
            value = getattr(self, name)
            if value <= 0:
                raise InputError(f"`{name}` must be a positive number, got {value}")
        if not 3 <= self.side <= 21 or self.side % 2 == 0:
            raise InputError(f"`window` must be an odd number from 3 to 21, got {self.window}")
        if not 1 <= self.stride <= 3:
            raise InputError(f"`stride` must be 1, 2 or 3, got {self.stride}")
        if not 1 <= self.history <= 5:
            raise InputError(f"`history` must be from 1 to 5 frames, got {self.history}")
        if not 1 <= self.box <= 21 or self.box % 2 == 0:
            raise InputError(f"`box` must be an odd number from 1 to 21, got {self.box}")
        if not 0 <= self.confidence <= LARGEST_CONFIDENCE:
            raise InputError(f"`confidence` must be from 0 to {LARGEST_CONFIDENCE:g}, got {self.confidence}")
        if not 0 <= self.ridge <= 1:
            raise InputError(f"`ridge` must be from 0 to 1, got {self.ridge}")
        if not 0 <= self.shrink <= LARGEST_SHRINK:
            raise InputError(f"`shrink` must be from 0 to {LARGEST_SHRINK:g}, got {self.shrink}")
        if self.shrink > 0 and self.regress != "linear":
            raise InputError(f"`shrink` needs `regress` linear, got {self.regress}")
        if self.shrink > 0 and self.bandwidth != "fixed":
            raise InputError(f"`shrink` needs `bandwidth` fixed, got {self.bandwidth}")
        if self._keeps_windows and self.regress == "linear":
            raise InputError(f"`gate` {self.gate} needs `regress` log, got {self.regress}")
        if self._keeps_windows and self.bandwidth != "fixed":
            raise InputError(f"`gate` {self.gate} needs `bandwidth` fixed, got {self.bandwidth}")

    @property
    def facts(self) -> MethodFacts:
        """What options mean to the method."""
        return METHODS[self.method]

    @property
    def side(self) -> int:
        """Side K of the window [pixels], as chosen or the method's own."""
        return self.facts.window if self.window is None else self.window

    @property
    def linear(self) -> bool:
        """Whether luminance is what is packed, regressed and remembered, instead of log brightness."""
        return self.regress == "linear" and self.facts.regresses

    @property
    def _keeps_windows(self) -> bool:
        return self.facts.gated and self.gate in KEPT_WINDOW_GATES

    @property
    def needs_numpy(self) -> bool:
        """Whether no kernel does what is asked for, so that it takes numpy and recorded frames."""
        return self._keeps_windows or (self.facts.regresses and self.bandwidth != "fixed")

    def check_stream(self) -> None:
        """Refuse what takes recorded frames.

        Raises:
            InputError: it is asked for.
        """
        if self._keeps_windows:
            raise InputError(f"`gate` {self.gate} needs old windows; expected delta-r or radiance for a stream")
        if self.needs_numpy:
            raise InputError(f"`bandwidth` {self.bandwidth} is for recorded frames; expected fixed for a stream")

    def without_use(self) -> tuple[str, ...]:
        """Return the fields that change nothing, whatever their values."""
        facts = self.facts
        names: tuple[str, ...] = () if facts.windowed else ("window",)
        if not facts.gated:
            names += _OF_GATES
        elif self.gate != "radiance":
            names += ("gate_scale", "box", *(("kernel",) if self.gate == "published" else ()))
        names += () if facts.regresses else _OF_REGRESSIONS
        return names + (() if facts.knows_error else ("confidence",))

    def unused(self) -> tuple[str, ...]:
        """Return the fields that are not the default's but change nothing."""
        defaults = {field.name: field.default for field in fields(self)}
        return tuple(name for name in self.without_use() if getattr(self, name) != defaults[name])

    def who(self) -> str:
        """Return the option that has no use for them, with its value, for a message."""
        return f"`gate` {self.gate}" if self.facts.gated else f"`method` {self.method}"
