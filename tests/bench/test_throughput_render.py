"""The renderer's bench: its worlds, its figures."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from clsim.bench.throughput import render
from clsim.bench.throughput.render import measure_world, render_throughput
from clsim.bench.throughput.render_worlds import bumpy_room, cornell


def test_worlds_are_still_and_as_large_as_asked():
    for triangles in (20_000, 1_000_000):
        room = bumpy_room(triangles)
        total = sum(len(mesh.triangles) for mesh in room.meshes)
        assert abs(total / triangles - 1) < 0.03
    box = cornell(64)
    assert (box.camera.width, box.camera.height) == (64, 64)
    assert all(instance.motion.duration_s == 0 for instance in (*room.instances, *box.instances))


def test_the_room_is_closed_but_for_its_lamps():
    """All walls share their borders, so that every edge of a wall has its twin."""
    room = bumpy_room(5_000)
    corners = np.concatenate([mesh.vertices[mesh.triangles] for mesh in room.meshes[:6]]).round(4) + 0.0
    edges = np.concatenate([corners[:, [i, (i + 1) % 3]] for i in range(3)])
    lower = edges.min(axis=1) + edges.max(axis=1) * 1000  # one row an edge, whatever its direction
    _, counts = np.unique(lower.round(2), axis=0, return_counts=True)
    assert (counts % 2 == 0).mean() > 0.99


def test_lamps_shine_down():
    for lamp in bumpy_room(5_000).meshes[-2:]:
        a, b, c = np.moveaxis(lamp.vertices[lamp.triangles], 1, 0)
        assert (np.cross(b - a, c - a)[:, 1] < 0).all()


def test_works_take_turns_and_the_median_round_counts(monkeypatch):
    now, order = [0.0, 0.0], []
    clock = SimpleNamespace(perf_counter=lambda: now[0], process_time=lambda: now[1])
    monkeypatch.setattr(render, "time", clock)

    def work(name, seconds):
        def call():
            order.append(name)
            wall = next(seconds)
            now[:] = now[0] + wall, now[1] + wall / 10

        return call

    works = {"a": [work("a", iter([1.0, 9.0, 2.0]))], "b": [work("b", iter([4.0] * 6))] * 2}
    wall, cpu = render.take_turns(works, 3)
    assert wall == {"a": 2.0, "b": 8.0} and cpu == pytest.approx({"a": 0.2, "b": 0.8})
    assert "".join(order) == "abb" * 3


def check(figures: dict[str, Any]) -> None:
    radiance = figures["mean_radiance"]
    assert radiance["bvh16"] > 0 and abs(radiance["bvh16"] / radiance["warp"] - 1) < 0.02
    for tree in ("bvh16", "warp"):
        assert all(figures["rays_per_cpu_second"][tree][kind] > 0 for kind in ("primary", "bounce", "shadow"))
        # From a millisecond to a minute for the picture.
        for rate in ("paths_per_second", "paths_per_cpu_second"):
            assert 24 * 24 * 2 / 60 < figures[rate][tree] < 24 * 24 * 2 / 1e-6
    assert figures["build_s"] > 0


@pytest.mark.slow
def test_figures_are_there_and_both_trees_agree():
    figures = measure_world(bumpy_room(4_000, 24), spp=2, rounds=1, others={"another": lambda: time.sleep(0.2) or 0.5})
    check(figures)
    assert figures["mean_radiance"]["another"] == 0.5
    # Who sleeps takes time of the clock alone.
    by_clock, by_cpu = (figures[f"paths_per_{each}"]["another"] for each in ("second", "cpu_second"))
    assert 24 * 24 * 2 / 1.0 < by_clock <= 24 * 24 * 2 / 0.2 < by_cpu
    assert 40 < figures["bytes_per_triangle"] < 70


@pytest.mark.slow
def test_rates_are_of_all_rays_that_are_traced(monkeypatch):
    """Were each launch a second long, there would be as many rays a second as it has."""

    def turns(works, rounds):
        seconds = {name: float(len(calls)) for name, calls in works.items()}
        return seconds, seconds

    monkeypatch.setattr(render, "take_turns", turns)
    for rates in render._ray_rates(bumpy_room(4_000, 24), 1).values():
        assert rates == {"primary": 24 * 24, "bounce": render._RAYS, "shadow": render._RAYS}


@pytest.mark.slow
def test_all_worlds_are_measured():
    result = render_throughput(size=24, spp=2, rounds=1, triangles=4_000)
    assert set(result) == {"cornell", "bumpy-room"}
    for figures in result.values():
        check(figures)
    # A box of a few triangles is a list, which holds more of each than a tree does.
    assert 70 < result["cornell"]["bytes_per_triangle"] < 200
