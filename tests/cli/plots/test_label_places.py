"""Labels beside points: what is left of one that finds no room."""

import pytest

from clsim.cli.plots.label_places import place_labels


@pytest.mark.parametrize(("width_in", "shown"), [(6.0, ["draft\n1 path in every eighth frame"]), (2.0, ["draft"])])
def test_a_label_without_room_is_cut_to_its_first_line(width_in, shown):
    pytest.importorskip("matplotlib")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, 3.0))
    FigureCanvasAgg(figure)
    panel = figure.subplots()
    panel.set(xlim=(0, 1), ylim=(0, 1))
    figure.canvas.draw()
    place_labels(panel, [(0.5, 0.5)], ["draft\n1 path in every eighth frame"], [(0.5, 0.5)])
    assert [label.get_text() for label in panel.texts] == shown
