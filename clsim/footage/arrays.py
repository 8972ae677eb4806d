"""Frames that a program has in memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain
from numbers import Real
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.footage import Transfer
from clsim.footage.source import Footage, Reading
from clsim.footage.times import read_time_us
from clsim.footage.transfer import decode
from clsim.frames import SourceEnded
from clsim.frames.frame import FloatArray


class Arrays(Footage):
    """Arrays ``[H, W]`` or ``[H, W, 3]`` with a time each, taken as they come."""

    def __init__(
        self,
        frames: Iterable[npt.ArrayLike],
        times_us: Iterable[int] | None,
        transfer: Transfer | None = None,
        *,
        fps: float | None = None,
        offset: float = 0.0,
    ) -> None:
        """Take the first frame. Whole numbers go from 0 to the type's largest, and are sRGB unless told otherwise.

        Raises:
            InputError: there is no frame, or it is no picture.
        """
        if times_us is None and fps is None:
            raise InputError("arrays carry no times; give `fps` or `times_us`")
        arrays = _each("frames", frames, "the name of a video or folder, or arrays")
        first = next(arrays, None)
        if first is None:
            raise InputError("there is no frame; expected arrays [H, W] or [H, W, 3]")
        first = _picture(first, 0)
        self._arrays = chain((first,), arrays)
        self._times = None if times_us is None else _each("times_us", times_us, "numbers of µs")
        self._dtype = first.dtype
        whole = first.dtype.kind == "u"
        steps = int(np.iinfo(first.dtype).max) if whole else None
        chosen = transfer or ("srgb" if whole else "linear")
        super().__init__("arrays", (first.shape[1], first.shape[0]), steps, chosen, Reading(fps=fps, offset=offset))

    def _read(self, index: int, out_rgb: FloatArray) -> int | None:
        array = next(self._arrays, None)
        if array is None:
            raise SourceEnded
        picture = _picture(array, index)
        if picture.shape[:2] != (self.height, self.width) or picture.dtype != self._dtype:
            raise InputError(
                f"frame {index} is an array of {picture.dtype} {list(picture.shape)}, expected {self._dtype} "
                f"{[self.height, self.width]} as the first"
            )
        colour = picture if picture.ndim == 2 else np.moveaxis(picture, 2, 0)
        np.divide(colour, np.float32(self.steps or 1), out=out_rgb, casting="unsafe")
        decode(out_rgb, self.transfer)
        if self._times is None:
            return None
        time_us = next(self._times, None)
        if time_us is None:
            raise InputError(f"there is no time for frame {index}; expected one for each frame")
        return self._later(time_us, index)

    def _later(self, given: Any, index: int) -> int:
        """Return the time that is given for a frame; raises InputError unless it is after the one before."""
        time_us = read_time_us(given, index)
        if time_us <= self._last_us:
            after = f"later than {self._last_us} µs of the one before" if index else "0 or later"
            seconds = " (seconds?)" if isinstance(given, Real) and given != time_us else ""
            raise InputError(f"`times_us` has {given} µs{seconds} for frame {index}, expected {after}")
        return time_us

    def close(self) -> None:
        """Release nothing: the arrays are the caller's."""


def _each(name: str, values: Any, expected: str) -> Iterator[Any]:
    try:
        if not isinstance(values, bytes):
            return iter(values)
    except TypeError:  # it is one value
        pass
    raise InputError(f"`{name}` must be {expected}, got {values!r:.200}")


def _picture(array: Any, index: int) -> npt.NDArray[Any]:
    try:
        picture = np.asarray(array)
    except (TypeError, ValueError, RuntimeError) as error:
        raise InputError(f"frame {index} cannot be read as an array ({error})") from None
    if not picture.dtype.isnative:
        picture = picture.astype(picture.dtype.newbyteorder("="))
    if picture.dtype.kind == "f" and picture.dtype != np.float32:
        picture = picture.astype(np.float32)
    if picture.dtype not in (np.uint8, np.uint16, np.float32) or not (
        picture.ndim == 2 or (picture.ndim == 3 and picture.shape[2] == 3)
    ):
        raise InputError(
            f"frame {index} is an array of {picture.dtype} {list(picture.shape)}, expected [H, W] or [H, W, 3] of "
            "uint8, uint16 or floating point"
        )
    return picture
