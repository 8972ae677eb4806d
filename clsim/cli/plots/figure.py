"""An empty matplotlib figure, which is an extra."""

from __future__ import annotations

from typing import Any

from clsim.errors import InputError


def new_figure(what: str, width_in: float, height_in: float) -> Any:
    """Return a figure to draw ``what`` on, which needs no screen.

    Raises:
        InputError: matplotlib is not installed.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise InputError(
            f"drawing {what} needs matplotlib, which is not installed; pip install 'clsim[plot]'"
        ) from None
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure
