"""The plot of a sweep: its third panel."""

import pytest

from clsim.bench.tradeoff.settings import ESIM, Point, Rendering
from clsim.bench.tradeoff.sweep import TradeoffOptions, run_tradeoff
from clsim.cli.plots.tradeoff_plot import _legend, _mark, _short, plot_tradeoff

PLAIN = {"spp": 8, "probe_spp": None, "probe_every": 1, "sampler": "pcg", "first_hit_rays": 0, "gate": None}
PLAIN |= {"method": "esim", "window": None, "history": None, "stride": None, "arithmetic": "float32"}


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({}, "8 spp ESIM"),
        ({"probe_spp": 1, "probe_every": 4}, "1–8 spp each 4 ESIM"),
        ({"sampler": "sobol"}, "8 spp sobol ESIM"),
        ({"first_hit_rays": 32}, "8 spp + 32 rays ESIM"),
        ({"window": 5, "history": 2, "stride": 3, "arithmetic": "float64"}, "8 spp ESIM K5 T2 /3 f64"),
        ({"window": 7, "method": "irradiance", "history": 1, "stride": 1}, "8 spp"),
    ],
)
def test_a_point_is_labelled_by_what_is_not_usual(changed, words):
    assert _short(PLAIN | changed) == words


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
    low, high = drawn[0].axes[0].get_ylim()
    assert all(low < row[score] < high for row in results["settings"] for score in ("f1", "strict_f1"))
    panel = drawn[0].axes[2]
    heights = [set(line.get_ydata()) for line in panel.lines]
    assert {0.021} in heights and {0.03} in heights
    assert [line.get_xydata().tolist() for line in panel.lines if len(line.get_xydata()) == 1] == [
        [[results["settings"][1]["cpu_s"], 0.07]]
    ]
    bottom, top = panel.get_ylim()
    assert bottom > 0.4 > 0.01 > top, "less mismatch is up"


def test_points_look_as_the_legend_says():
    """Colour and filling tell the noise, or adaptive sampling; the shape tells the method."""
    lines, figures = pytest.importorskip("matplotlib.lines"), pytest.importorskip("matplotlib.figure")
    panel = figures.Figure().subplots()
    ways = {"common random numbers": ("common", "uniform"), "independent random numbers": ("independent", "uniform")}
    ways |= {"adaptive sampling": ("common", "adaptive")}
    told = {"event_rule": "frame", "icip_2023": False, "cpu_s": 1.0, "f1": 0.5}
    rows = [PLAIN | told | {"noise": noise, "sampling": sampling} for noise, sampling in ways.values()]
    rows.append(PLAIN | told | {"noise": "common", "sampling": "uniform", "method": "wlr-esim"})
    legend = {each.get_label(): each for each in _legend({"settings": rows})}
    for row, label in zip(rows, [*ways, "common random numbers"], strict=True):
        _mark(panel, row, "f1", faint=False)
        point = next(each for each in reversed(panel.lines) if isinstance(each, lines.Line2D))
        assert point.get_color() == legend[label].get_color(), label
        assert point.get_markerfacecolor() == legend[label].get_markerfacecolor(), label
        shape = "WLR everywhere" if row["method"] == "wlr-esim" else "ESIM"
        assert point.get_marker() == legend[shape].get_marker()
