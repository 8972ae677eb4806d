"""Each option of the renderer changes what renders, which is built here without its kernels."""

from dataclasses import fields, replace
from functools import cache
from typing import Any

import pytest

from clsim.frames.patches import Patches
from clsim.render import RenderOptions, SceneData, View, view
from clsim.render.accel.geometry import Tree
from clsim.render.cache import light_cache_host, path_store
from clsim.scene import load_world
from tests.contents import contents, differing

PRIMARY = {"first_hit_rays": 4}
CACHED = {**PRIMARY, "light_cache": True}
ROWS: dict[str, tuple[dict[str, Any], Any]] = {
    "spp": ({}, 3),
    "fps": ({}, 50.0),
    "frames": ({}, 3),
    "max_depth": ({}, 3),
    "roulette_start": ({}, 3),
    "threads": ({}, 1),
    "tile_pixels": ({}, 100),
    "variances": ({}, True),
    "strategy": ({}, "bsdf"),
    "sampler": ({}, "sobol"),
    "follow_specular": ({"scene": "mirrors"}, False),
    "first_hit_rays": ({}, 4),
    "probe_spp": (PRIMARY, 2),
    "probe_every": (PRIMARY, 3),
    "light_cache": (PRIMARY, True),
    "stored_paths": ({**CACHED, "scene": "cornell"}, 7),
    "lamp_paths": ({**CACHED, "scene": "moving-light"}, 7),
    "follow_every": ({**CACHED, "scene": "moving-light"}, 7),
    "first_frame_error": (CACHED, 0.1),
    "lights_set": (CACHED, True),
    "light_hz": (CACHED, 30.0),
    "fires_at": (CACHED, (0.2, 0.3)),
    "duplicate_every": ({}, 3),
    "duplicate_in": ({}, Patches(3, ((0, 0),), 1)),
    "truth": ({}, ("flow",)),
    "tree": ({}, "warp"),
}
"""What is said before, and another value."""
ELSEWHERE = {
    "seed": "read for each frame: test_tracer.py",
    "noise": "read for each frame: test_tracer.py",
    "truth_every": "read for each frame: tests/live/test_truth_recorded.py",
    "device": "there may be no other: test_cuda_build.py",
}


class StandIn:
    """Holds what it is made of."""

    def __init__(self, *made_of: Any, **named: Any) -> None:
        self.made_of, self.named = made_of, named


@pytest.fixture
def without_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("build_kernel", "Tiles"):
        monkeypatch.setattr(view, name, StandIn)
    monkeypatch.setattr(light_cache_host, "LightCacheHost", StandIn)
    monkeypatch.setattr(path_store, "PathStore", StandIn)


@cache
def copied(scene: str, tree: Tree | None) -> SceneData:
    world = load_world("still" if scene == "mirrors" else scene, resolution=(32, 24))
    if scene == "mirrors":
        world = replace(world, materials=tuple(replace(each, kind="conductor") for each in world.materials))
    return SceneData(world, tree=tree)


def built(said: dict[str, Any]) -> Any:
    options = RenderOptions(**{key: each for key, each in said.items() if key != "scene"})
    return contents(View(copied(said.get("scene", "still"), options.tree), options), ("_options",))


def test_each_option_has_a_row() -> None:
    assert {*ROWS, *ELSEWHERE} == {field.name for field in fields(RenderOptions)}


@pytest.mark.parametrize("name", ROWS)
def test_an_option_changes_what_renders(name: str, without_kernels: None) -> None:
    said, value = ROWS[name]
    plain = built(said)
    assert not differing(plain, built(said)), "it is not like itself"
    assert differing(plain, built(said | {name: value})), "it changes nothing"
