"""What every stage of a sensor is: settings that tell kernels what to compile, and with which numbers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, TypeAlias

from clsim.errors import InputError

Constants: TypeAlias = "dict[str, float | tuple[float, ...]]"
"""Numbers that kernels read as c[C_NAME], or N_NAME of them from there on: in s, ns and natural-log units."""


@dataclass(frozen=True)
class Context:
    """What stages must know beyond their own numbers.

    Attributes:
        threshold_on, threshold_off: contrast thresholds [natural-log units].
        lux: illuminance of the sensor where the level is 0 [lux].
        follower_s: time constant of the source follower [s]; 0 without one.
    """

    threshold_on: float
    threshold_off: float
    lux: float
    follower_s: float = 0.0


class Stage(ABC):
    """A stage: its settings, and what its functions in the kernels need.

    Attributes:
        macros: what is defined for the kernels where the stage is on, see `active`.
        own: planes of what each pixel keeps for ever, made once; P_NAME in kernels.
        state: planes of what each pixel carries from step to step; S_NAME in kernels.
    """

    @abstractmethod
    def macros(self) -> tuple[str, ...]:
        """Return the macros with which kernels are built; none where the stage is off."""

    @abstractmethod
    def constants(self, context: Context) -> Constants:
        """Return the constants of a stage that is on."""

    own: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    state: ClassVar[Mapping[str, tuple[str, ...]]] = {}


def _numbers(group: Any, names: tuple[str, ...]) -> Iterator[tuple[str, float]]:
    for name in names:
        value = getattr(group, name)
        for number in value if isinstance(value, tuple) else (value,):
            if number is not None:
                yield name, number


def check_positive(group: Any, *names: str) -> None:
    """Raise InputError where a number of a group is not above 0."""
    for name, number in _numbers(group, names):
        if number <= 0:
            raise InputError(f"`{name}` must be positive, got {number:g}")


def check_not_negative(group: Any, *names: str) -> None:
    """Raise InputError where a number of a group is below 0."""
    for name, number in _numbers(group, names):
        if number < 0:
            raise InputError(f"`{name}` must not be negative, got {number:g}")
