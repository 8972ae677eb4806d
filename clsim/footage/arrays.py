"""Frames that a program has in memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.footage import Transfer
from clsim.footage.source import Footage, Reading
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
        arrays: Iterator[Any] = iter(frames)
        first = next(arrays, None)
        if first is None:
            raise InputError("there is no frame; expected arrays [H, W] or [H, W, 3]")
        first = _picture(first, 0)
        self._arrays = chain((first,), arrays)
        self._times: Iterator[int] | None = None if times_us is None else iter(times_us)
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
        return int(time_us)

    def close(self) -> None:
        """Release nothing: the arrays are the caller's."""


def _picture(array: Any, index: int) -> npt.NDArray[Any]:
    picture = np.asarray(array)
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
