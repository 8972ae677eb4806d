"""Values by chance, each from a stream of its own: adding one leaves all others as they were."""

from __future__ import annotations

import glob
import hashlib
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from clsim.errors import InputError

DISTRIBUTIONS = ("uniform", "log_uniform", "normal", "integers", "choice", "files")
"""Keys of a table that stands for a value: ``{ uniform = [0.1, 0.5] }``."""
_MOTION = ("camera", "keyframes", "orbit", "wander", "shake")
_HELD_OUT = "held_out"
_GOLDEN = (math.sqrt(5) - 1) / 2


def is_distribution(value: Any) -> bool:
    """Tell whether a table stands for a value by chance."""
    return isinstance(value, Mapping) and len(value) in (1, 2) and set(value) - {_HELD_OUT} <= set(DISTRIBUTIONS)


def check(value: Any, where: str, folder: Path) -> Any:
    """Return a template with its distributions checked and its ``files`` listed; ``where`` names it in messages.

    Raises:
        InputError: a distribution cannot be.
    """
    if not is_distribution(value):
        if isinstance(value, Mapping):
            _check_spelling(value, where)
            return {key: check(each, f"{where}.{key}", folder) for key, each in value.items()}
        if isinstance(value, list):
            return [check(each, f"{where}[{k}]", folder) for k, each in enumerate(value)]
        return value
    kinds = sorted(set(value) - {_HELD_OUT})
    if len(kinds) != 1:
        raise InputError(f"{where}: must have one distribution, got {' and '.join(kinds) or 'held_out alone'}")
    (kind,) = kinds
    told = value.get(kind)
    held_out = value.get(_HELD_OUT, False)
    if not isinstance(held_out, bool) or (held_out and kind not in ("choice", "files")):
        raise InputError(f"{where}: held_out is true or false, and is for choice and files")
    if kind == "files":
        found = sorted(glob.glob(os.path.join(folder, told), recursive=True)) if isinstance(told, str) else []
        if not found:
            raise InputError(f"{where}: no file matches {told!r} in {folder}")
        return {"choice": found, _HELD_OUT: held_out}
    if kind == "choice":
        if not isinstance(told, list) or not told:
            raise InputError(f"{where}: choice must be a list of values, got {told!r}")
        return {"choice": told, _HELD_OUT: held_out}
    _check_range(kind, told, where)
    return dict(value)


def _check_spelling(table: Mapping[str, Any], where: str) -> None:
    # A file is what many tables name.
    close = get_close_matches(next(iter(table)), set(DISTRIBUTIONS) - {"files"}, 1, 0.8) if len(table) == 1 else []
    if close:
        raise InputError(f"{where}: there is no distribution {next(iter(table))!r}; did you mean {close[0]!r}?")


def _check_range(kind: str, told: Any, where: str) -> None:
    try:
        low, high = (np.asarray(each, np.float64) for each in told)
        good = low.shape == high.shape and low.ndim < 2 and bool(np.isfinite(low).all() and np.isfinite(high).all())
    except (TypeError, ValueError):
        good = False
    if not good:
        raise InputError(f"{where}: {kind} must be two numbers, or two lists of as many numbers, got {told!r}")
    if kind == "normal":
        if (high < 0).any():
            raise InputError(f"{where}: normal must be a mean and a standard deviation of 0 or more, got {told!r}")
    elif (low > high).any() or (kind == "log_uniform" and (low <= 0).any()):
        raise InputError(f"{where}: {kind} must be a low and a high end, got {told!r}")
    elif kind == "integers" and not all(isinstance(each, int) for each in told):
        raise InputError(f"{where}: integers must be two whole numbers, got {told!r}")


@dataclass(frozen=True)
class Seeds:
    """Seeds of the streams, each of which varies alone."""

    scene: int = 0
    motion: int = 0
    sensor: int = 0
    noise: int = 0


@dataclass(frozen=True)
class Drawer:
    """Draws the values of one sequence.

    Attributes:
        seeds: of the streams.
        index: number of the sequence.
        attempt: how often it was drawn before.
        split: which part of the data set it belongs to; "" where there is one part.
        parts: share of each part, which held-out values are shared out by.
    """

    seeds: Seeds
    index: int
    attempt: int = 0
    split: str = ""
    parts: tuple[tuple[str, float], ...] = ()

    def draw(self, template: Any, path: str, stream: str) -> Any:
        """Return ``template`` with a value for each distribution; ``path`` names it, and so its random numbers.

        Motion (the camera, keyframes, orbits, wandering, shake) has the stream of that name wherever it stands. A table
        with ``count`` in a list stands for so many of them.
        """
        if is_distribution(template):
            return self._value(template, path, stream)
        if isinstance(template, Mapping):
            return {
                key: self.draw(each, f"{path}.{key}", "motion" if key in _MOTION else stream)
                for key, each in template.items()
            }
        if isinstance(template, list):
            return [item for k, each in enumerate(template) for item in self._items(each, f"{path}[{k}]", stream)]
        return template

    def seed(self) -> int:
        """Return the seed of the sequence's noise."""
        return int(self._numbers("seed", "noise").integers(0, 1 << 31))

    def _items(self, template: Any, path: str, stream: str) -> list[Any]:
        if not isinstance(template, Mapping) or "count" not in template:
            return [self.draw(template, path, stream)]
        count = self.draw(template["count"], f"{path}.count", stream)
        one = {key: each for key, each in template.items() if key != "count"}
        return [self.draw(one, f"{path}#{k}", stream) for k in range(int(count))]

    def _value(self, table: Mapping[str, Any], path: str, stream: str) -> Any:
        (kind,) = set(table) - {_HELD_OUT}
        numbers = self._numbers(path, stream)
        if kind == "choice":
            options = table["choice"]
            if table.get(_HELD_OUT) and self.split:
                options = shared_out(options, self.parts, self.seeds.scene)[self.split]
            return options[int(numbers.integers(len(options)))]
        low, high = table[kind]
        if kind == "integers":
            return int(numbers.integers(low, high + 1))
        low, high = np.asarray(low, np.float64), np.asarray(high, np.float64)
        if kind == "normal":
            value = numbers.normal(low, high)
        elif kind == "uniform":
            value = numbers.uniform(low, high)
        else:
            value = np.exp(numbers.uniform(np.log(low), np.log(high)))
        return np.asarray(value).tolist()

    def _numbers(self, path: str, stream: str) -> np.random.Generator:
        told = f"{stream}:{getattr(self.seeds, stream)}:{self.index}:{self.attempt}:{path}"
        return np.random.Generator(
            np.random.Philox(key=int.from_bytes(hashlib.sha256(told.encode()).digest()[:16], "big"))
        )


def split_of(index: int, parts: tuple[tuple[str, float], ...]) -> str:
    """Return the part that a sequence belongs to: shares are met by any number of sequences, and hang on no count."""
    place, total = (index + 0.5) * _GOLDEN % 1.0, 0.0
    for name, share in parts:
        total += share
        if place < total:
            return name
    return parts[-1][0] if parts else ""


def shared_out(options: list[Any], parts: tuple[tuple[str, float], ...], seed: int) -> dict[str, list[Any]]:
    """Return which values each part has for itself: as by its share, and one at least.

    Raises:
        InputError: there are fewer values than parts.
    """
    if len(options) < len(parts):
        raise InputError(f"{len(options)} held-out values cannot be shared out over {len(parts)} parts")
    order = sorted(options, key=lambda each: hashlib.sha256(f"{seed}:{each!r}".encode()).digest())
    shares: dict[str, list[Any]] = {}
    total, first = 0.0, 0
    for k, (name, share) in enumerate(parts):
        total += share
        rest = len(parts) - k - 1
        last = len(options) if rest == 0 else min(max(round(total * len(options)), first + 1), len(options) - rest)
        shares[name] = order[first:last]
        first = last
    return shares
