"""Sizes of what detection keeps on a device; the comments of packed.clh say what they mean."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from clsim.opencl.workplace import Grid, Workplace

BORDER = 32
"""Columns and rows around a packed image (packed.clh)."""
FIRST_FEATURE = 2
"""Planes of a packed image before the features: mask and brightness (packed.clh)."""
CHUNK = 64
"""Pixels of a list that one work-item handles (gate.cl, models.cl)."""


@dataclass(frozen=True)
class Layout(Grid):
    """A grid of pixels, and what is packed of each.

    Attributes:
        features: feature planes besides pixel x and y.
        extra: planes of a packed image after the features: 1 if the variance of luminance is there.
    """

    features: int = 0
    extra: int = 0

    @property
    def pitch(self) -> int:
        """Columns of a packed image."""
        return self.span + 2 * BORDER

    @property
    def packed_shape(self) -> tuple[int, int, int]:
        """Shape of a packed frame."""
        return (self.height + 2 * BORDER, FIRST_FEATURE + self.features + self.extra, self.pitch)

    @property
    def packed_size(self) -> int:
        """Values of a packed frame."""
        rows, planes, pitch = self.packed_shape
        return rows * planes * pitch

    def planes_shape(self, planes: int) -> tuple[int, int, int]:
        """Shape of an image of several planes, without border."""
        return (self.height, planes, self.span)


Place: TypeAlias = Workplace[Layout]
"""Where detection works."""
