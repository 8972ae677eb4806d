"""The table of cosine lobes that look like what rough surfaces reflect; tools/accuracy/fit_reflections.py makes it."""

from __future__ import annotations

from functools import cache
from importlib.resources import files

import numpy as np
import numpy.typing as npt

SIZE = 32
"""Steps of √α from 0 to 1, and of √(1 − cos) of the direction in which light leaves."""
ENTRIES = 6
"""Four of the inverse matrix, and two shares of light (`bsdf/reflections.py`)."""
MODELS = ("separable", "correlated", "beckmann")
"""How microfacets are spread and hide each other: GGX's on each way by itself, or on both at once, and Beckmann's."""


@cache
def reflections() -> npt.NDArray[np.float32]:
    """Return the table ``[MODELS, SIZE, SIZE, ENTRIES]``: model, √α, direction."""
    with files("clsim.render.surfaces").joinpath("reflections.npz").open("rb") as file, np.load(file) as found:
        return np.stack([found[model] for model in MODELS])
