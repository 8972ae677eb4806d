"""Method irradiance: what falls on surfaces is smoothed, and their albedo is not (see `clsim.detect.irradiance`)."""

from __future__ import annotations

from clsim.detect.config import DetectorConfig
from clsim.detect.gate import Counts, Levels
from clsim.detect.irradiance import FEATURES, Demodulation, Smoothing, check_planes
from clsim.detect.methods.base import Method, Setting, Stages
from clsim.detect.wlr import History
from clsim.opencl.workplace import Buffer


class IrradianceStages(Stages):
    """Smoothing of every pixel."""

    def __init__(self, setting: Setting) -> None:
        """Build the kernels."""
        self.place = setting.place(FEATURES)
        self.pack: Demodulation = Demodulation(self.place, setting.config, setting.names)
        self.smoothing = Smoothing(self.place, setting.config, setting.names)
        self.gate = self.smoothing.gate
        self._error_known = False
        self._needs_error = setting.config.confidence > 0

    def observe(self, history: History, levels: Levels, references: Buffer, *, with_error: bool) -> Counts:
        """Smooth and test what comes out."""
        self._error_known = with_error or self._needs_error
        self.smoothing.run(self.pack.packed, with_error=self._error_known)
        self.smoothing.test(self.pack.packed, levels, references)
        return self.gate.collect()

    @property
    def error(self) -> Buffer:
        """Standard error of the window's mean; taken now if the last `observe` was not asked for it."""
        if not self._error_known:
            self.smoothing.run(self.pack.packed, with_error=True)
            self._error_known = True
        return self.smoothing.error


class Irradiance(Method):
    """ESIM on smoothed irradiance."""

    def check_planes(self, config: DetectorConfig, names: tuple[str, ...]) -> None:
        """Refuse frames that do not tell albedo, normal and depth."""
        super().check_planes(config, names)
        check_planes(names)

    def build(self, setting: Setting, features: tuple[str, ...], quiet: tuple[str, ...]) -> Stages:
        """Build the stages."""
        return IrradianceStages(setting)


METHOD = Irradiance()
