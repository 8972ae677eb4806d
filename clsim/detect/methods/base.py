"""The base of detection methods: how frames become brightness, and which pixels may fire."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from clsim.detect.config import DetectorConfig
from clsim.detect.features import check_variance, feature_names
from clsim.detect.gate import Counts, Gate, Level, LevelGate, Levels
from clsim.detect.layout import BORDER, FIRST_FEATURE, Layout, Place
from clsim.detect.pack import Pack
from clsim.detect.wlr import History, Regression
from clsim.errors import InputError
from clsim.frames import COVERAGE, DEPTH, RADIANCE
from clsim.opencl.device import Device
from clsim.opencl.workplace import Buffer, Grid, Workplace


@dataclass(frozen=True)
class Setting:
    """Where and on what a method works.

    Attributes:
        config: the options.
        names: planes of the frames.
        grid: the pixels.
        device: what computes.
        queue: an in-order queue of it, which all that share buffers use.
    """

    config: DetectorConfig
    names: tuple[str, ...]
    grid: Grid
    device: Device
    queue: Any

    def place(self, planes: int, features: tuple[str, ...] = ()) -> Place:
        """Return a workplace for frames with so many packed ``planes``, of which ``features`` are regressed on."""
        config, grid = self.config, self.grid
        shrinks = config.shrink > 0 and config.facts.regresses
        layout = Layout(grid.width, grid.height, grid.lanes, grid.real, planes, int(shrinks))
        depth = features.index(DEPTH[0]) if DEPTH[0] in features else -1
        macros: dict[str, object] = {
            "F": planes,
            "DEPTH": depth,
            "MISSES": int(depth >= 0 and COVERAGE[0] in self.names),
            "LIN_LOG": int(config.response == "lin-log"),
            "FLOOR_Y": f"{config.floor:.9e}" + ("" if config.precision == "float64" else "f"),
            "LINEAR": int(config.linear),
            "MOSAIC": int(config.mosaic is not None),
            "SHRINK": int(shrinks),
        }
        return Workplace(self.device, layout, self.queue, macros)


class Packer(Protocol):
    """What turns a frame's planes into a packed image."""

    packed: Buffer
    """``[slots, H + 2·border, planes, pitch]`` (packed.clh)."""

    def run(self, memory: Any, slot: int) -> None:
        """Enqueue the packing of the frame in ``memory``."""
        ...

    def offset(self, slot: int) -> int:
        """Where a slot starts, in values."""
        ...


class Stages(ABC):
    """A method's kernels and memory, for one set of features.

    Attributes:
        place: where they work.
        pack: what packs frames.
        gate: what sorts pixels.
        features: planes in the regression.
        quiet: planes that join it once they are no longer constant.
    """

    place: Place
    pack: Packer
    gate: Gate
    features: tuple[str, ...] = ()
    quiet: tuple[str, ...] = ()

    @property
    def error(self) -> Buffer | None:
        """Standard error of brightness after `observe` with ``with_error``, ``[H, span]``; None where nobody knows."""
        return None

    @abstractmethod
    def observe(self, history: History, levels: Levels, references: Buffer, *, with_error: bool) -> Counts:
        """Write the packed frame's levels and list the pixels that may fire; ``references`` are the sensor's.

        All that was enqueued before is done when it returns.
        """

    def found(self) -> tuple[int, npt.NDArray[np.float32]]:
        """Return what a regression wants to know of the packed frame: how many pixels are invalid, and the extremes of
        each quiet plane, ``[quiet, 2]``.
        """
        return 0, np.zeros((0, 2), dtype=np.float32)

    def learn(self, count: int, crossings: Buffer, history: History) -> None:  # noqa: B027 - most have nothing to learn
        """Take notice of which of the first ``count`` listed pixels fired: ``crossings`` is not 0 there."""

    def take_over(self, older: Stages, constants: Mapping[str, float], history: int) -> None:
        """Continue from stages with fewer features, of which the new ones had the values ``constants`` until now."""
        old = older.place.read(older.pack.packed)
        packed = np.zeros(self.pack.packed.shape, dtype=self.place.real)
        packed[:, :, :FIRST_FEATURE] = old[:, :, :FIRST_FEATURE]
        if self.place.layout.extra:
            packed[:, :, -1] = old[:, :, -1]
        for j, name in enumerate(self.features):
            if name in older.features:
                packed[:, :, FIRST_FEATURE + j] = old[:, :, FIRST_FEATURE + older.features.index(name)]
            else:
                packed[:, :, FIRST_FEATURE + j] = np.where(old[:, :, 0] > 0, constants[name], 0.0)
        self.place.write(self.pack.packed, packed)


class BrightnessStages(Stages):
    """The brightness of each pixel as it is, with nothing regressed: also the base of what regresses.

    Attributes:
        gate: by levels.
    """

    gate: LevelGate

    def __init__(self, setting: Setting, features: tuple[str, ...], quiet: tuple[str, ...], slots: int) -> None:
        """Prepare packed frames with ``features`` in ``slots`` frames' room."""
        self.features, self.quiet = features, quiet
        self.place = setting.place(len(features), features)
        self.pack: Pack = Pack(self.place, setting.config, setting.names, features, quiet, slots)

    def brightness(self, slot: int) -> Level:
        """Return where the packed frame's brightness is."""
        planes, pitch = self.pack.packed.shape[2:]
        start = self.pack.offset(slot) + BORDER * planes * pitch + pitch + BORDER
        return Level(self.pack.packed, start, planes * pitch)


class RegressingStages(BrightnessStages):
    """Frames packed for a regression.

    Attributes:
        fit: the regression.
    """

    def __init__(self, setting: Setting, features: tuple[str, ...], quiet: tuple[str, ...]) -> None:
        """Build the regression's kernels."""
        super().__init__(setting, features, quiet, setting.config.history)
        self.fit = Regression(self.place, setting.config, self.pack.packed, setting.config.history)

    def found(self) -> tuple[int, npt.NDArray[np.float32]]:
        """Return how many pixels of the packed frame are invalid, and the extremes of each quiet plane."""
        return self.pack.found()

    def take_over(self, older: Stages, constants: Mapping[str, float], history: int) -> None:
        """Continue from stages with fewer features."""
        super().take_over(older, constants, history)
        for slot in range(history):
            self.fit.prepare(slot)


class Method(ABC):
    """A method, as an object without state; what options mean to it stands in `clsim.detect.config`."""

    def check_planes(self, config: DetectorConfig, names: tuple[str, ...]) -> None:
        """Refuse frames that lack a plane.

        Raises:
            InputError: one is missing.
        """
        for name in RADIANCE:
            if name not in names:
                raise InputError(f"the frames have no plane {name!r}, expected {', '.join(RADIANCE)}")
        if config.facts.regresses:
            check_variance(config, names)

    def candidates(self, config: DetectorConfig, names: tuple[str, ...]) -> tuple[str, ...]:
        """Return the planes that may be regressed on.

        Raises:
            InputError: a plane asked for is missing, or cannot be a feature.
        """
        return feature_names(config, names) if config.facts.regresses else ()

    def solved(self, counts: Counts) -> int:
        """Return how many regressions of tested pixels were solved in a step."""
        return 0

    @abstractmethod
    def build(self, setting: Setting, features: tuple[str, ...], quiet: tuple[str, ...]) -> Stages:
        """Build the kernels and allocate all memory for regressions on ``features``."""
