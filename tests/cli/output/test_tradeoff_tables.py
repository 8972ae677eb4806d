"""The tables of a sweep: each number stands under its own heading."""

from __future__ import annotations

import csv
from typing import Any

import pytest

from clsim.cli.output.tradeoff_tables import FRONT_HEAD, _knob_row, csv_text, front_row, front_table, table

SCORES: dict[str, Any] = {
    "f1": 0.11, "strict_f1": 0.22, "f1_within_1ms": 0.33, "equivalent_mismatch": 0.044, "precision": 0.55,
    "recall": 0.66, "dt_median_us": 770.0,
}  # fmt: skip
ROW: dict[str, Any] = SCORES | {
    "label": "8 spp", "cpu_s": 1.5, "detect_cpu_s": 0.5, "startup_cpu_s": 9.0, "cpu_us_per_pixel_second": 1234.0,
    "paths": 6.5e6, "front_f1": True, "front_strict_f1": True, "icip_2023": False, "event_rule": "frame",
}  # fmt: skip
SHOWN = {
    "F1": "0.110", "strict F1": "0.220", "F1 within 1 ms": "0.330", "equivalent mismatch": "4.4 %",
    "precision": "0.550", "recall": "0.660", "median Δt": "0.77 ms",
}  # fmt: skip


def test_each_number_stands_under_its_heading() -> None:
    cells = dict(zip(FRONT_HEAD, front_row(ROW), strict=True))
    assert cells == SHOWN | {
        "Setting": "8 spp", "CPU s": "1.5", "of it detection": "0.5", "to start": "9",
        "CPU µs per pixel and simulated s": "1,234", "million paths": "6.5", "front": "F1 and strict",
    }  # fmt: skip


def test_scores_of_a_ceiling_stand_under_the_same_headings() -> None:
    head, rows = front_table({"settings": [ROW], "ceiling": {"frame": SCORES, "linear-light": SCORES}})
    assert len(rows) == 2, "a rule that no setting has is not shown"
    cells = dict(zip(head, rows[-1], strict=True))
    assert cells["Setting"] == "ceiling, rule frame" and {name: cells[name] for name in SHOWN} == SHOWN


@pytest.mark.parametrize("lacking", ["equivalent_mismatch", "cpu_us_per_pixel_second", "dt_median_us", "startup_cpu_s"])
def test_what_is_not_known_moves_no_other_number(lacking: str) -> None:
    row = {name: value for name, value in ROW.items() if name != lacking} | (
        {"dt_median_us": None} if lacking == "dt_median_us" else {}
    )
    changed = [before for before, after in zip(front_row(ROW), front_row(row), strict=True) if after != before]
    assert len(changed) == 1 and "–" in front_row(row)


def test_a_point_in_a_table_of_all_stands_beside_the_ceiling_of_its_own_rule() -> None:
    ceiling = {"frame": {"f1": 0.9, "strict_f1": 0.8}, "interpolated": {"f1": 0.7, "strict_f1": 0.6}}
    points = [{"event_rule": rule, "f1": 0.5} for rule in ceiling]
    rows = csv.DictReader(csv_text({"scene": "a", "ceiling": ceiling, "points": points}).splitlines())
    assert [(row["ceiling_f1"], row["ceiling_strict_f1"]) for row in rows] == [("0.9", "0.8"), ("0.7", "0.6")]


def test_markdown_has_a_rule_for_each_column() -> None:
    lines = table(FRONT_HEAD, [front_row(ROW)]).splitlines()
    assert {line.count("|") for line in lines} == {len(FRONT_HEAD) + 1}


def test_a_turned_knob_is_told_with_what_it_costs_and_brings() -> None:
    turned = ROW | {"cpu_s": 6.0, "detect_cpu_s": 0.25, "f1": 0.31, "strict_f1": 0.12, "stride": 2}
    told = ("stride", "1", "2", "× 4.00", "× 0.50", "+0.200", "-0.100")
    assert _knob_row("stride", ROW | {"stride": 1}, turned) == told
