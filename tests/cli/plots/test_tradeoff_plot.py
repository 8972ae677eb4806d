"""The plot of a sweep: its third panel."""

import pytest

from clsim.bench.tradeoff.settings import ESIM, Point, Rendering
from clsim.bench.tradeoff.sweep import TradeoffOptions, run_tradeoff
from clsim.cli.plots.tradeoff_plot import plot_tradeoff


@pytest.mark.slow
def test_equivalent_mismatch_stands_beside_what_cameras_have(tmp_path, monkeypatch):
    figure = pytest.importorskip("matplotlib.figure").Figure
    points = tuple(Point(Rendering(spp, "common", 0), ESIM) for spp in (2, 16))
    given = {"reference_spp": 16, "resolution": (16, 12), "frames": 4, "fps": 20.0, "reference_budget_s": 0.0}
    results = run_tradeoff(TradeoffOptions("two-boxes", tmp_path, points=points, **given), lambda *_: None)
    results["settings"][0]["equivalent_mismatch"] = None
    results["settings"][1]["equivalent_mismatch"] = 0.07
    drawn = []
    monkeypatch.setattr(figure, "savefig", lambda self, *_, **__: drawn.append(self))
    plot_tradeoff(results, tmp_path / "plot.png")
    panel = drawn[0].axes[2]
    heights = [set(line.get_ydata()) for line in panel.lines]
    assert {0.021} in heights and {0.03} in heights
    assert [line.get_xydata().tolist() for line in panel.lines if len(line.get_xydata()) == 1] == [
        [[results["settings"][1]["cpu_s"], 0.07]]
    ]
    bottom, top = panel.get_ylim()
    assert bottom > 0.4 > 0.01 > top, "less mismatch is up"
