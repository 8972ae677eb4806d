"""The plot of a sweep: its third panel."""

import pytest

from clsim.bench.tradeoff.settings import ESIM, Point, Rendering
from clsim.bench.tradeoff.sweep import TradeoffOptions, run_tradeoff
from clsim.cli.plots.tradeoff_plot import _short, plot_tradeoff

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
    panel = drawn[0].axes[2]
    heights = [set(line.get_ydata()) for line in panel.lines]
    assert {0.021} in heights and {0.03} in heights
    assert [line.get_xydata().tolist() for line in panel.lines if len(line.get_xydata()) == 1] == [
        [[results["settings"][1]["cpu_s"], 0.07]]
    ]
    bottom, top = panel.get_ylim()
    assert bottom > 0.4 > 0.01 > top, "less mismatch is up"
