"""Method wlr-esim: every pixel's brightness is regressed in every frame (Tsuji et al., ICIP 2023, section 2.1)."""

from __future__ import annotations

from clsim.detect.gate import Counts, Level, LevelGate, Levels
from clsim.detect.methods.base import Method, RegressingStages, Setting, Stages
from clsim.detect.wlr import History
from clsim.opencl.workplace import Buffer


class WlrStages(RegressingStages):
    """Regression of all pixels."""

    def __init__(self, setting: Setting, features: tuple[str, ...], quiet: tuple[str, ...]) -> None:
        """Build the kernels."""
        super().__init__(setting, features, quiet)
        self.gate = LevelGate(self.place)

    def observe(self, history: History, levels: Levels, references: Buffer, *, with_error: bool) -> Counts:
        """Regress all and test what comes out."""
        layout = self.place.layout
        self.fit.prepare(history.slot)
        self.fit.dense(history)
        level = Level(self.fit.fit, 0, (3 + layout.features) * layout.span)
        self.gate.test(self.pack.packed, self.pack.offset(history.slot), level, levels, references)
        return self.gate.collect()


class WlrEsim(Method):
    """Weighted local regression, then ESIM."""

    def solved(self, counts: Counts) -> int:
        """All that were tested."""
        return counts.kept + counts.solved

    def build(self, setting: Setting, features: tuple[str, ...], quiet: tuple[str, ...]) -> Stages:
        """Build the stages."""
        return WlrStages(setting, features, quiet)


METHOD = WlrEsim()
