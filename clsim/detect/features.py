"""The planes of a frame that detection reads: the weights of luminance, and the features to regress on."""

from __future__ import annotations

from clsim.detect.config import DetectorConfig
from clsim.errors import InputError
from clsim.frames import ALBEDO, COVERAGE, DEPTH, LUMINANCE_VARIANCE, NORMAL

FEATURE_PLANES = DEPTH + NORMAL + ALBEDO + COVERAGE
"""Planes that may be features, besides pixel x and y (Tsuji et al., ICIP 2023, section 3)."""

LUMINANCE_WEIGHTS = {"rec709": (0.2126, 0.7152, 0.0722), "rec601": (0.299, 0.587, 0.114)}


def luminance_weights(config: DetectorConfig) -> tuple[float, float, float]:
    """Return what brightness has of R, G and B."""
    return LUMINANCE_WEIGHTS[config.luminance] if isinstance(config.luminance, str) else config.luminance


def mosaic_weights(config: DetectorConfig) -> tuple[tuple[float, float, float], ...]:
    """Return the same of all pixels alike; behind filters, of the four of each square."""
    return (luminance_weights(config),) if config.mosaic is None else config.mosaic


def feature_names(config: DetectorConfig, names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the planes to regress on, in the order of ``names``.

    Raises:
        InputError: a plane asked for in ``config.features`` is missing, or cannot be a feature; or there is none, and
            the gate sees nothing else.
    """
    wanted = FEATURE_PLANES if config.features is None else config.features
    if config.features is not None:
        for name in config.features:
            if name not in FEATURE_PLANES:
                raise InputError(f"`features`: {name!r} is unknown; expected some of {', '.join(FEATURE_PLANES)}")
            if name not in names:
                raise InputError(f"`features`: {name!r} is not among the frames' planes {', '.join(names)}")
    found = tuple(name for name in names if name in wanted)
    if not found and config.facts.gated and config.gate != "radiance":
        raise InputError(
            f"`gate` {config.gate} sees changes of surfaces, such as of their albedo, normal or depth, and the frames "
            "tell none of these; expected radiance"
        )
    return found


def check_variance(config: DetectorConfig, names: tuple[str, ...]) -> None:
    """Refuse frames without the variance that ``config.shrink`` weighs with.

    Raises:
        InputError: it is missing.
    """
    if config.shrink > 0 and LUMINANCE_VARIANCE not in names:
        raise InputError(f"`shrink` needs the plane {LUMINANCE_VARIANCE!r}, which the frames lack")
