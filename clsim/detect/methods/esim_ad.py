"""Method esim-ad: brightness is regressed only where it may have reached a threshold (Tsuji et al., ICIP 2023)."""

from __future__ import annotations

from collections.abc import Mapping

from clsim.detect.box import Boxes
from clsim.detect.gate import Counts, Levels, ModelGate
from clsim.detect.methods.base import Method, RegressingStages, Setting, Stages
from clsim.detect.models import Models, model_macros
from clsim.detect.wlr import History
from clsim.opencl.workplace import Buffer

SPARSE_SHARE = 0.5
"""Below this share of pixels to solve, a list of them is faster than solving all (measured, random pixels)."""


class EsimAdStages(RegressingStages):
    """A model of each pixel's last event predicts its brightness; where that says too little, it is regressed."""

    gate: ModelGate  # type: ignore[assignment]

    def __init__(self, setting: Setting, features: tuple[str, ...], quiet: tuple[str, ...]) -> None:
        """Build the kernels."""
        super().__init__(setting, features, quiet)
        config = setting.config
        self._share, self._history = config.gate_scale, config.history
        self.boxes = Boxes(self.place, config.box) if config.gate == "radiance" else None
        self.gate = ModelGate(self.place, model_macros(self.boxes))
        self.models = Models(self.place, self.boxes)

    def test(self, slot: int, levels: Levels, references: Buffer) -> None:
        """Flag the pixels of the packed frame in ``slot``; box means have been taken."""
        means = None if self.boxes is None else self.boxes.means
        start = self.pack.offset(slot)
        self.gate.test(self.pack.packed, start, means, self._share, self.models.state, levels, references)

    def observe(self, history: History, levels: Levels, references: Buffer, *, with_error: bool) -> Counts:
        """Predict all, regress those that may fire."""
        layout = self.place.layout
        if self.boxes is not None:
            self.boxes.average(self.pack.packed, self.pack.offset(history.slot))
        self.test(history.slot, levels, references)
        counts = self.gate.collect()
        if counts.listed or self._history > 1:
            self.fit.prepare(history.slot)
        if counts.listed > SPARSE_SHARE * layout.width * layout.height:
            self.fit.dense(history)
        elif counts.listed:
            self.fit.sparse(history, self.gate.pixels, counts.listed)
        if counts.listed:
            self.gate.take_levels(counts.listed, self.fit.fit, levels)
        return counts

    def learn(self, count: int, crossings: Buffer, history: History) -> None:
        """Let pixels that fired remember what was fitted."""
        if count:
            self.models.keep(self.gate, count, crossings, self.fit, self.pack.packed, history)

    def take_over(self, older: Stages, constants: Mapping[str, float], history: int) -> None:
        """Continue from stages with fewer features: so do the models."""
        super().take_over(older, constants, history)
        if isinstance(older, EsimAdStages):
            at = [older.features.index(name) if name in older.features else None for name in self.features]
            self.models.take_over(older.models, at, [constants.get(name, 0.0) for name in self.features])


class EsimAd(Method):
    """ESIM with adaptive denoising."""

    def solved(self, counts: Counts) -> int:
        """Those that may have fired."""
        return counts.solved

    def build(self, setting: Setting, features: tuple[str, ...], quiet: tuple[str, ...]) -> Stages:
        """Build the stages."""
        return EsimAdStages(setting, features, quiet)


METHOD = EsimAd()
