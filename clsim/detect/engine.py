"""What a detector needs for one set of features: kernels, memory, state."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.detect.config import REGRESSING, DetectorConfig
from clsim.detect.events import EventRule
from clsim.detect.gate import Gate, Level
from clsim.detect.interest import Interest
from clsim.detect.irradiance import PACKED_PLANES, Demodulation, Smoothing
from clsim.detect.pack import FrameMemory, Pack
from clsim.detect.wlr import Regression
from clsim.frames import COVERAGE, DEPTH
from clsim.opencl.device import Device
from clsim.opencl.workplace import BORDER, Buffer, Layout, Workplace


@dataclass
class Engine:
    """Kernels and memory for one set of features."""

    config: DetectorConfig
    size: tuple[int, int]
    names: tuple[str, ...]
    features: tuple[str, ...]
    quiet: tuple[str, ...]
    device: Device
    state: Buffer = field(init=False)

    def __post_init__(self) -> None:
        """Build the kernels and allocate all memory that the detector will use."""
        config = self.config
        smooths = config.method == "irradiance"
        count = PACKED_PLANES if smooths else len(self.features)
        double = config.precision == "float64"
        lanes = max(1, self.device.lanes // 2) if double else self.device.lanes
        shrinks = config.shrink > 0 and config.method in REGRESSING
        layout = Layout(*self.size, count, lanes, np.float64 if double else np.float32, int(shrinks))
        depth = self.features.index(DEPTH[0]) if DEPTH[0] in self.features else -1
        macros: dict[str, Any] = {
            "DEPTH": depth,
            "MISSES": int(depth >= 0 and COVERAGE[0] in self.names),
            "LIN_LOG": int(config.response == "lin-log"),
            "FLOOR_Y": f"{config.floor:.9e}" + ("" if double else "f"),
            "LINEAR": int(config.linear),
            "SHRINK": int(shrinks),
        }
        self.workplace = Workplace(self.device, layout, macros)
        self.memory = FrameMemory(self.workplace)
        self.pack: Pack | Demodulation
        self.smoothing: Smoothing | None = None
        self.regression: Regression | None = None
        if smooths:
            self.pack = Demodulation(self.workplace, config, self.names)
            self.smoothing = Smoothing(self.workplace, config, self.names)
        else:
            self.pack = Pack(self.workplace, config, self.names, self.features, self.quiet, config.history)
        packed = self.pack.packed
        if config.method in REGRESSING:
            self.regression = Regression(self.workplace, config, packed, config.history)
        self.gate = Gate(self.workplace, config)
        model = self.regression if config.method == "esim-ad" else None
        self.rule = EventRule(self.workplace, config, self.gate, packed, model)
        self.state = self.workplace.allocate(layout.image_shape(6 + 4 * count if model else 2))
        self.forget()

    @cached_property
    def interest(self) -> Interest:
        """What tells a renderer how close pixels are to firing; built when it is first wanted."""
        return Interest(self.workplace, self.config)

    def level(self, slot: int) -> Level:
        """Return where the current level of each pixel is: regressed, smoothed or (method esim) its brightness."""
        layout = self.workplace.layout
        if self.smoothing is not None:
            return Level(self.smoothing.level, 0, layout.span)
        if self.regression is not None:
            return Level(self.regression.fit, 0, (3 + layout.features) * layout.span)
        planes, pitch = self.pack.packed.shape[2:]
        return Level(
            self.pack.packed, self.pack.offset(slot) + BORDER * planes * pitch + pitch + BORDER, planes * pitch
        )

    def forget(self) -> None:
        """Take all references back: NaN marks a pixel that has none."""
        self.workplace.write(self.state, np.full(self.state.shape, np.nan, dtype=self.workplace.real))

    def take_over(self, older: Engine, constants: dict[str, float]) -> None:
        """Continue from an engine with fewer features, of which the new ones had the values ``constants`` until now."""
        old_state, old_packed = older.workplace.read(older.state), older.workplace.read(older.pack.packed)
        packed = np.zeros(self.pack.packed.shape, dtype=self.workplace.real)
        packed[:, :, :2] = old_packed[:, :, :2]
        if self.workplace.layout.extra:
            packed[:, :, -1] = old_packed[:, :, -1]
        for j, name in enumerate(self.features):
            if name in older.features:
                packed[:, :, 2 + j] = old_packed[:, :, 2 + older.features.index(name)]
            else:
                packed[:, :, 2 + j] = np.where(old_packed[:, :, 0] > 0, constants[name], 0.0)
        self.workplace.write(self.pack.packed, packed)
        if self.regression is None:
            return
        for slot in range(self.config.history):
            self.regression.prepare(slot)
        if self.config.method == "esim-ad":
            self.workplace.write(self.state, self._wider_state(old_state, older, constants))
        else:
            self.workplace.write(self.state, old_state)

    def _wider_state(self, old: npt.NDArray[Any], older: Engine, constants: dict[str, float]) -> npt.NDArray[Any]:
        f, g = len(self.features), len(older.features)
        state = np.zeros(self.state.shape, dtype=self.workplace.real)
        state[:, :6] = old[:, :6]
        for j, name in enumerate(self.features):
            for block in range(4):
                if name in older.features:
                    state[:, 6 + block * f + j] = old[:, 6 + block * g + older.features.index(name)]
                else:
                    state[:, 6 + block * f + j] = 0.0 if block == 0 else constants[name]
        return state
