"""Labels beside points of a plot, kept clear of points and of each other."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

_ANGLES_DEG = (-45, 45, 135, -135, -90, 90, 0, 180, -20, 20, -160, 160, -70, 70, -110, 110)
_DISTANCES = (11, 20, 32, 46, 62, 80, 100)
"""Distances tried, from point to label [points]."""
_CLEAR_PX = 4.0
"""Room left around a point [pixels]."""


def place_labels(
    panel: Any, points: Sequence[tuple[float, float]], texts: Sequence[str], obstacles: Sequence[tuple[float, float]]
) -> None:
    """Write ``texts`` beside ``points`` on matplotlib axes that have been drawn once, a thin line leading to each.

    The nearest place is taken where a label lies inside the axes, covers no obstacle and no other label. A text that
    finds none is cut to its first line; where that finds none either, it is left out.
    """
    from matplotlib.transforms import Bbox

    dots = [panel.transData.transform(obstacle) for obstacle in obstacles]
    taken = [Bbox.from_extents(x - _CLEAR_PX, y - _CLEAR_PX, x + _CLEAR_PX, y + _CLEAR_PX) for x, y in dots]
    for point, text in zip(points, texts, strict=True):
        lengths = dict.fromkeys((text, text.partition("\n")[0]))
        for shown, distance in itertools.product(lengths, _DISTANCES):
            label, box = _first_free(panel, point, shown, distance, taken)
            if label is not None:
                taken.append(box)
                break


def _first_free(panel: Any, point: tuple[float, float], text: str, distance: float, taken: list[Any]) -> Any:
    from matplotlib.text import Text

    for angle in _ANGLES_DEG:
        dx, dy = math.cos(math.radians(angle)), math.sin(math.radians(angle))
        label = panel.annotate(
            text,
            point,
            (distance * dx, distance * dy),
            textcoords="offset points",
            ha="left" if dx > 0.3 else "right" if dx < -0.3 else "center",
            va="bottom" if dy > 0.3 else "top" if dy < -0.3 else "center",
            fontsize=8.5,
            zorder=5,
            arrowprops={"arrowstyle": "-", "color": "0.5", "linewidth": 0.6, "shrinkA": 0, "shrinkB": 3},
        )
        label.update_positions(panel.figure.canvas.get_renderer())
        box = Text.get_window_extent(label)  # the annotation's own would hold the line too
        inside = panel.bbox.contains(box.x0, box.y0) and panel.bbox.contains(box.x1, box.y1)
        if inside and not any(box.overlaps(other) for other in taken):
            return label, box
        label.remove()
    return None, None
