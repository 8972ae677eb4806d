"""All settings of a live run, and what follows from several groups of them."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from clsim.errors import InputError
from clsim.live.quality import (
    DEFAULT,
    FOLLOWED,
    PLAIN,
    QUALITIES,
    UNCACHED,
    Point,
    Quality,
    setting_names,
    with_given,
)
from clsim.live.settings import (
    DetectionSettings,
    MachineSettings,
    OutputSettings,
    SamplingSettings,
    SceneSettings,
    TimeSettings,
)
from clsim.values import from_plain


@dataclass(frozen=True)
class LiveOptions(
    MachineSettings, OutputSettings, TimeSettings, DetectionSettings, SamplingSettings, SceneSettings
):  # the scene's come first
    """Options of a live run; where one is None, what stands in brackets holds.

    Each room takes the group that it needs; drivers alone know them all.
    """

    def _check(self) -> None:
        super()._check()
        self._check_sampling()
        self._check_time()
        if self.truth and self.loop:
            raise InputError("`truth` is of one pass of the motion; give it without `loop`")

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
        if not self.ideal and self.event_rule is None and point.event_rule == "linear-light":
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

    def _check_sampling(self) -> None:
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
        point = self.point
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
