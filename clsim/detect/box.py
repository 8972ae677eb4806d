"""Host side of box.cl: box means of brightness and features, for the radiance gate."""

from __future__ import annotations

import numpy as np

from clsim.detect.layout import Place
from clsim.opencl.workplace import Buffer


class Boxes:
    """Means over the square around each pixel.

    Attributes:
        means: ``[H, F + 4, span]``, as model.clh has them.
    """

    def __init__(self, place: Place, side: int) -> None:
        """Build the kernels for squares of ``side`` pixels, odd."""
        self._place, self._reach = place, side // 2
        layout = place.layout
        planes = layout.features + 4
        self._along_rows, self._along_columns = place.kernels("detect/box", ("box_rows", "box_columns"))
        self._row_sums = place.allocate(layout.planes_shape(planes + 1))
        self.means = place.allocate(layout.planes_shape(planes))

    def average(self, packed: Buffer, start: int) -> None:
        """Take the means of the packed frame that starts at ``start``."""
        layout, launch = self._place.layout, self._place.launch
        launch(
            self._along_rows, layout.vectors, packed, np.int64(start), layout.pitch, layout.span, self._reach,
            self._row_sums,
        )  # fmt: skip
        launch(self._along_columns, layout.vectors, self._row_sums, layout.height, layout.span, self._reach, self.means)
