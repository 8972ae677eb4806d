"""Method esim: the frames' own brightness (Rebecq et al., "ESIM: an Open Event Camera Simulator", CoRL 2018)."""

from __future__ import annotations

from clsim.detect.gate import Counts, LevelGate, Levels
from clsim.detect.methods.base import BrightnessStages, Method, Setting, Stages
from clsim.detect.wlr import History
from clsim.opencl.workplace import Buffer


class EsimStages(BrightnessStages):
    """Nothing is smoothed."""

    def __init__(self, setting: Setting) -> None:
        """Build the kernels."""
        super().__init__(setting, (), (), setting.config.history)
        self.gate = LevelGate(self.place)

    def observe(self, history: History, levels: Levels, references: Buffer, *, with_error: bool) -> Counts:
        """Test the packed brightness."""
        slot = history.slot
        self.gate.test(self.pack.packed, self.pack.offset(slot), self.brightness(slot), levels, references)
        return self.gate.collect()


class Esim(Method):
    """Brightness as it is rendered."""

    def build(self, setting: Setting, features: tuple[str, ...], quiet: tuple[str, ...]) -> Stages:
        """Build the stages."""
        return EsimStages(setting)


METHOD = Esim()
