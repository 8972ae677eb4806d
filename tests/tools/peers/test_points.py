"""Peers beside the sweep's points: measured once, scored alike, in the table."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from clsim.bench.tradeoff.settings import ESIM, Point, Rendering
from clsim.bench.tradeoff.sweep import TradeoffOptions
from clsim.errors import InputError
from clsim.scene import Lens, load_world
from tools.peers import manabe
from tools.peers.points import run_peers, saving, text

POINTS = tuple(Point(Rendering(2, "common", seed), ESIM) for seed in (0, 1))


def run(cache: Path, *peers: str) -> dict[str, Any]:
    options = TradeoffOptions(
        "cornell",
        cache,
        points=POINTS,
        seeds=(0, 1),
        reference_spp=64,
        reference_budget_s=0.0,
        resolution=(16, 12),
        frames=4,
        fps=20.0,
    )
    return run_peers(options, peers, lambda what, done, total: None)


@pytest.fixture
def few_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in (("FIRST", 8), ("STEP", 4), ("CAP", 16)):
        monkeypatch.setattr(manabe, name, value)


@pytest.mark.slow
def test_a_peer_is_set_beside_the_points(tmp_path: Path, few_samples: None, monkeypatch: pytest.MonkeyPatch) -> None:
    results = run(tmp_path, "manabe")
    first, second = results["peers"]
    assert (first["peer"], first["seed"], second["seed"]) == ("manabe", 0, 1)
    assert first["events"] != second["events"] and first["paths"] > 16 * 12 * (16 + 3 * 8)
    assert first["reference_events"] == results["reference"]["events"]["frame"]
    (row,) = results["peer_settings"]
    assert row["f1"] == pytest.approx((first["f1"] + second["f1"]) / 2) and row["strict_f1_sd"] > 0
    assert row["seeds"] == [0, 1]
    lines = text(results).splitlines()
    (line,) = [line for line in lines if line.startswith("| Manabe")]
    assert f"{row['strict_f1']:.3f} ± {row['strict_f1_sd']:.3f}" in line
    assert len({line.count("|") for line in lines if line[:1] == "|"}) == 1, "a ragged table"
    assert lines[-1].startswith(f"- {row['label']}: ")
    monkeypatch.setattr("tools.peers.points.Peer.measure", lambda *given: pytest.fail("measured again"))
    assert run(tmp_path, "manabe") == results


@pytest.mark.oracle
@pytest.mark.usefixtures("llvm_mitsuba")
def test_the_chain_is_a_peer(tmp_path: Path) -> None:
    (row,) = run(tmp_path, "chain")["peer_settings"]
    assert row["paths"] == 16 * 12 * 4 * 32 and row["true_events"] > 0
    assert row["cpu_s"] == pytest.approx(row["render_cpu_s"] + row["detect_cpu_s"])
    assert row["detect_cpu_s"] == pytest.approx(
        row["fits"] * row["cpu_s_per_fit"] + row["gates"] * row["cpu_s_per_gate"], rel=0.2
    )  # of means, so not exactly


def test_unknown_peers_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="`peers` must be one of chain, manabe, got 'v2e'"):
        run(tmp_path, "v2e")


def test_what_a_peer_cannot_render_is_told_before_anything_is_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as missing, pytest.raises(InputError, match="Mitsuba 3 is not installed"):
        missing.setitem(sys.modules, "mitsuba", None)
        run(tmp_path, "chain")
    world = load_world("cornell")
    glass = replace(world, materials=tuple(replace(each, kind="dielectric") for each in world.materials))
    wide = replace(world, camera=replace(world.camera, lens=Lens(model="fisheye")))
    monkeypatch.setattr("tools.peers.mitsuba_frames.load_mitsuba", lambda: "mitsuba")
    monkeypatch.setattr("clsim.bench.tradeoff.sweep.load_world", lambda *given, **more: glass)
    with pytest.raises(InputError, match="materials other than diffuse ones cannot be handed to Mitsuba"):
        run(tmp_path, "chain")
    monkeypatch.setattr("clsim.bench.tradeoff.sweep.load_world", lambda *given, **more: wide)
    with pytest.raises(InputError, match="a lens or an exposure time is not handed to Mitsuba"):
        run(tmp_path, "chain")
    assert not any(tmp_path.iterdir())


def test_savings_are_counted_at_equal_scores() -> None:
    rows = [
        {"label": "cheap", "f1": 0.9, "strict_f1": 0.6, "cpu_s": 1.0},
        {"label": "good", "f1": 0.8, "strict_f1": 0.7, "cpu_s": 3.0},
        {"label": "better", "f1": 0.9, "strict_f1": 0.9, "cpu_s": 2.0},
    ]
    peer = {"label": "slow", "f1": 0.8, "strict_f1": 0.7, "cpu_s": 50.0}
    assert saving(rows, peer) == {"baseline": "slow", "setting": "better", "factor": 25.0}
    assert saving(rows, peer | {"strict_f1": 0.5})["setting"] == "cheap"
    assert saving(rows, peer | {"f1": 1.0}) == {"baseline": "slow", "setting": None, "factor": None}
