"""The scattering models and the numbers by which kernels know them: the one place where both meet."""

import warp as wp

from clsim.scene.world import Kind

NUMBERS: dict[Kind, int] = {
    "diffuse": 0,
    "conductor": 1,
    "dielectric": 2,
    "thin-dielectric": 3,
    "plastic": 4,
    "principled": 5,
    "disney": 6,
}
"""A new model takes the next number, so that the others keep theirs."""
KINDS = tuple(NUMBERS)

DIFFUSE = wp.constant(NUMBERS["diffuse"])
CONDUCTOR = wp.constant(NUMBERS["conductor"])
DIELECTRIC = wp.constant(NUMBERS["dielectric"])
THIN_DIELECTRIC = wp.constant(NUMBERS["thin-dielectric"])
PLASTIC = wp.constant(NUMBERS["plastic"])
PRINCIPLED = wp.constant(NUMBERS["principled"])
DISNEY = wp.constant(NUMBERS["disney"])
