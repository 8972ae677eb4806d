"""Arrays on a device."""

from typing import Any

import numpy as np
import warp as wp

from clsim.render.device.large_pages import LARGE, spread


def array(values: Any, dtype: Any, device: Any) -> Any:
    """Copy to the device; an empty array becomes one entry of zeros, since its fields are never read."""
    data = np.asarray(values)
    if not data.size:
        return wp.zeros(1, dtype=dtype, device=device)
    if wp.get_device(device).is_cpu and data.nbytes >= LARGE:
        own = spread(data.shape, wp.empty(0, dtype=dtype, device=device).numpy().dtype)
        own[...] = data
        return wp.array(own, dtype=dtype, device=device, copy=False)
    return wp.array(data, dtype=dtype, device=device)


def table(kind: Any, shape: int | tuple[int, ...]) -> Any:
    """Return zeros on the host, as numpy knows rows of a struct."""
    return np.zeros(shape, kind.numpy_dtype())


def write(out: Any, values: Any) -> None:
    """Copy rows to the first of an array on a device, which may have more."""
    if len(values):
        wp.copy(out, wp.array(values, dtype=out.dtype, device=out.device), count=len(values))
