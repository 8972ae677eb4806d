"""``clsim bench tradeoff``: its files, and what it refuses."""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from clsim.bench.tradeoff import sweep as tradeoff
from clsim.bench.tradeoff.settings import BASE, ESIM, ICIP_2023, Point, Rendering
from clsim.cli.commands.bench_tradeoff import with_progress

POINTS = [
    Point(Rendering(2, "common", 0), ESIM),
    Point(Rendering(2, "common", 0), BASE),
    Point(Rendering(4, "independent", 0), ICIP_2023),
]


@pytest.mark.slow
def test_the_files_of_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clsim: Callable[..., Any]) -> None:
    monkeypatch.setattr(tradeoff, "quick_points", lambda seed: POINTS)
    files = {name: tmp_path / f"out.{name}" for name in ("csv", "plot", "markdown")}
    command = (
        "bench", "tradeoff", "two-boxes", "--quick", "--resolution", "16x12", "--frame-count", 4, "--fps", 20,
        "--reference-spp", 16, "--cache", tmp_path / "cache", *(x for n, f in files.items() for x in (f"--{n}", f)),
    )  # fmt: skip
    outcome = clsim(*command)
    assert outcome.status == 0 and "ceiling" in outcome.stdout
    again = clsim(*command, "--json")  # from the cache
    stored = json.loads(again.stdout)
    rows = list(csv.DictReader(files["csv"].open()))
    assert [row["gate"] for row in rows] == ["", "radiance", "delta-r"]
    assert [float(row["f1"]) for row in rows] == [point["f1"] for point in stored["points"]]
    assert float(rows[0]["ceiling_f1"]) == stored["ceiling"]["interpolated"]["f1"]
    markdown = files["markdown"].read_text()
    assert "(ICIP 2023)" in markdown and "ceiling, rule frame" in markdown and "| gate | radiance | esim |" in markdown
    tables = [[line.count("|") for line in part.splitlines()] for part in markdown.split("\n\n") if part[0] == "|"]
    assert len(tables) == 2 and all(len(set(counts)) == 1 for counts in tables), "ragged tables"
    assert files["plot"].read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_what_is_asked_for_is_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clsim: Callable[..., Any]
) -> None:
    asked = []

    def sweep(options: Any, report: Any) -> Any:
        asked.append(options)
        return SimpleNamespace(world=SimpleNamespace(notes=(), warnings=()), run=dict)

    monkeypatch.setattr(tradeoff, "Sweep", sweep)
    words = "--quick --reference-spp 16 --reference-budget 3 --resolution 16x12 --frame-count 4 --fps 20 --seeds 7"
    assert clsim("bench", "tradeoff", "two-boxes", *words.split(), "--cache", tmp_path, "--json").status == 0
    assert asked == [tradeoff.TradeoffOptions("two-boxes", tmp_path, True, 16, 3.0, (16, 12), 4, 20.0, (7,))]


def test_a_folder_that_is_not_there_is_told_before_anything_is_measured(
    tmp_path: Path, clsim: Callable[..., Any]
) -> None:
    outcome = clsim("bench", "tradeoff", "two-boxes", "--csv", tmp_path / "none" / "a.csv", "--cache", tmp_path / "c")
    assert outcome.status == 2 and "there is no folder" in outcome.stderr
    assert not (tmp_path / "c").exists()
    outcome = clsim("bench", "tradeoff", "two-boxes", "--seeds", "1,x")
    assert outcome.status == 2 and "--seeds must be whole numbers" in outcome.stderr


def test_that_nothing_can_be_drawn_is_told_before_anything_is_measured(
    tmp_path: Path, clsim: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    command = "bench", "tradeoff", "two-boxes", "--cache", tmp_path / "c", "--plot", tmp_path / "a.png"
    outcome = clsim(*command)
    assert outcome.status == 2 and "needs matplotlib" in outcome.stderr
    assert not (tmp_path / "c").exists()


def test_what_the_scene_asks_for_in_vain_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    world = SimpleNamespace(notes=(), warnings=("a.xml: media are left out",))
    sweep = SimpleNamespace(world=world, run=lambda: {"points": []})
    assert with_progress(None, lambda options, report: sweep) == {"points": []}
    assert "clsim: a.xml: media are left out" in capsys.readouterr().err
