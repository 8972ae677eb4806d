"""`clsim bench edge`."""

import json

import pytest
from typer.testing import CliRunner

from clsim.bench import edge
from clsim.cli.app import app


@pytest.mark.slow
def test_the_figures_of_all_edges_are_told(monkeypatch):
    monkeypatch.setattr(edge, "KINDS", ("geometric",))
    monkeypatch.setattr(edge, "QUALITIES", ("draft",))
    given = ["bench", "edge", "--resolution", "16x12", "--fps", "60"]
    rows = json.loads(CliRunner().invoke(app, [*given, "--json"]).stdout)
    assert [row["speed_px_s"] for row in rows] == [30.0, 300.0, 3000.0]
    assert all(row["matched"] > 0.8 * row["true_events"] > 50 for row in rows)
    table = CliRunner().invoke(app, given).stdout
    for row in rows:
        told = f"{row['error_px']:.4f}", f"{row['true_events']:,}", f"{100 * row['f1']:.1f} %"
        assert all(each in table for each in told)


def test_a_rate_without_end_is_told(clsim):
    outcome = clsim("bench", "edge", "--fps", "inf")
    assert outcome.status == 2 and outcome.stderr.startswith("clsim: --fps must be less than or equal to 1000000")
