"""Arrays on a device."""

from typing import Any

import numpy as np
import warp as wp


def array(values: Any, dtype: Any, device: Any) -> Any:
    """Copy to the device; an empty array becomes one entry of zeros, since its fields are never read."""
    data = np.asarray(values)
    return wp.array(data, dtype=dtype, device=device) if data.size else wp.zeros(1, dtype=dtype, device=device)


def write(out: Any, values: Any) -> None:
    """Copy rows to the first of an array on a device, which may have more."""
    if len(values):
        wp.copy(out, wp.array(values, dtype=out.dtype, device=out.device), count=len(values))
