"""`clsim bench throughput`."""

from __future__ import annotations

import json

from clsim.bench.throughput import scene as throughput_scene
from clsim.cli.commands.bench import _flat


def test_scenes_are_measured_and_what_is_missing_is_told(clsim, monkeypatch, tmp_path):
    (tmp_path / "there.toml").write_text("[camera]\nposition = [0, 0, 9]\n[[objects]]\nshape = 'box'\n")
    monkeypatch.setattr(throughput_scene, "scene_throughput", lambda world: {"paths_per_cpu_second": {"clsim": 7.0}})
    given = [str(tmp_path / name) for name in ("there.toml", "missing.toml")]
    outcome = clsim("bench", "throughput", "--scene", given[0], "--scene", given[1], "--scene", "cornell", "--json")
    assert outcome.status == 0
    assert json.loads(outcome.stdout) == {
        scene: {"paths_per_cpu_second": {"clsim": 7.0}} for scene in (given[0], "cornell")
    }
    dark, missing = outcome.stderr.splitlines()
    assert dark.startswith("clsim: there: the scene has no light")
    assert missing == f"{given[1]}: left out, for there is no such file"


def test_missing_scenes_alone_are_an_error(clsim, tmp_path):
    outcome = clsim("bench", "throughput", "--scene", str(tmp_path / "missing.toml"))
    assert outcome.status == 2 and "none of these scenes is there" in outcome.stderr


def test_a_figure_is_told_with_the_names_of_all_that_it_is_of():
    assert dict(_flat({"lanes": 8, "render": {"cornell": {"build_s": 0.5}}})) == {
        "lanes": 8,
        "render.cornell.build_s": 0.5,
    }
