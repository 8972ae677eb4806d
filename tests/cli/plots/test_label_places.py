"""Labels beside points: what is left of one that finds no room."""

import numpy as np
import pytest

from clsim.cli.plots.label_places import place_labels


def drawn(width_in):
    """Axes from 0 to 1."""
    pytest.importorskip("matplotlib")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, 3.0))
    FigureCanvasAgg(figure)
    panel = figure.subplots()
    panel.set(xlim=(0, 1), ylim=(0, 1))
    figure.canvas.draw()
    return panel


def test_labels_of_points_that_lie_close_do_not_cover_each_other():
    from matplotlib.text import Text

    panel, points = drawn(6.0), [(0.5, 0.5), (0.51, 0.5), (0.5, 0.51)]
    place_labels(panel, points, ["draft", "balanced", "accurate"], points)
    boxes = [Text.get_window_extent(label) for label in panel.texts]
    assert len(boxes) == 3
    assert not any(one.overlaps(other) for k, one in enumerate(boxes) for other in boxes[:k])


@pytest.mark.parametrize(
    ("width_in", "ring_px", "shown"),
    [
        (6.0, 0, ["draft\n1 path in every eighth frame"]),
        (6.0, 50, ["draft\n1 path in every eighth frame"]),  # it finds room farther away
        (2.0, 0, ["draft"]),
    ],
)
def test_a_label_without_room_is_cut_to_its_first_line(width_in, ring_px, shown):
    panel = drawn(width_in)
    angles = np.arange(16) * np.pi / 8
    ring = panel.transData.transform((0.5, 0.5)) + ring_px * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    obstacles = panel.transData.inverted().transform(ring)
    place_labels(panel, [(0.5, 0.5)], ["draft\n1 path in every eighth frame"], obstacles)
    assert [label.get_text() for label in panel.texts] == shown
