"""What is in a thing, as one value: two are alike in all that they hold, or they are not."""

import inspect
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np


def contents(thing: Any, left_out: tuple[str, ...] = ()) -> Any:
    """Return all that a thing holds, in numbers, texts and tuples; attributes of these names are ``left_out``.

    A function holds what it takes from around it; locks and what else holds nothing are their type alone.
    """
    return _contents(thing, frozenset(left_out), {})


def _contents(thing: Any, left_out: frozenset[str], seen: dict[int, Any]) -> Any:
    if thing is None or isinstance(thing, bool | int | float | complex | str | bytes | Path | Enum):
        return repr(thing)
    if isinstance(thing, type | ModuleType):
        return thing.__name__
    if isinstance(thing, np.ndarray | np.generic):
        # Whole numbers of 64 bits without a sign are Warp's handles: places in memory.
        return thing.dtype.str, thing.shape, b"" if thing.dtype == np.uint64 else thing.tobytes()
    if hasattr(thing, "numpy") and hasattr(thing, "dtype"):  # Warp's arrays
        return _contents(thing.numpy(), left_out, seen)
    if id(thing) in seen:
        return "above"
    seen[id(thing)] = thing  # kept, so that no other takes its number
    if isinstance(thing, Mapping):
        return tuple((_contents(key, left_out, seen), _contents(value, left_out, seen)) for key, value in thing.items())
    if isinstance(thing, list | tuple):
        return tuple(_contents(each, left_out, seen) for each in thing)
    if isinstance(thing, set | frozenset):
        return tuple(sorted(map(repr, thing)))
    kind = type(thing).__qualname__
    if hasattr(type(thing), "_length_"):  # Warp's numbers and vectors
        number = getattr(thing, "value", None)
        return kind, _contents(np.array(thing), left_out, seen) if number is None else kind == "uint64" or repr(number)
    struct = getattr(thing, "_cls", None)  # Warp's structs
    if struct is not None and hasattr(struct, "vars"):
        told = [name for name, held in struct.vars.items() if getattr(held.type, "__name__", "") != "uint64"]
        return kind, tuple((name, _contents(getattr(thing, name), left_out, seen)) for name in told)
    held = getattr(thing, "__dict__", {})
    if inspect.isfunction(thing):
        return thing.__qualname__, _contents(dict(inspect.getclosurevars(thing).nonlocals), left_out, seen)
    return kind, tuple((name, _contents(held[name], left_out, seen)) for name in sorted(held) if name not in left_out)


def differing(one: Any, other: Any, path: str = "") -> list[str]:
    """Return where two contents differ, and in what."""
    if one == other:
        return []
    if isinstance(one, tuple) and isinstance(other, tuple) and len(one) == len(other):
        named = bool(one) and isinstance(one[0], str) and one[0] == other[0]
        inner = [
            differing(*both, f"{path}.{one[0] if named else k}") for k, both in enumerate(zip(one, other, strict=True))
        ]
        return [place for places in inner for place in places]
    return [f"{path}: {one!r:.80} and {other!r:.80}"]
