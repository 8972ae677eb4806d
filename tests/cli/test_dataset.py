"""``clsim dataset``: what it prints; the engine is a stand-in's."""

from __future__ import annotations

from clsim.datasets import engine


def test_what_scenes_ask_for_in_vain_is_printed(clsim, monkeypatch, tmp_path):
    done = engine.Progress(3, whole=3, warnings=["scene.toml: media are left out"])
    monkeypatch.setattr(engine, "make", lambda *_, **__: done)
    outcome = clsim("dataset", "flow", "--out", tmp_path / "set")
    assert outcome.status == 0
    assert "clsim: scene.toml: media are left out" in outcome.stderr.splitlines()


def test_of_a_thousand_warnings_the_first_are_printed(clsim, monkeypatch, tmp_path):
    done = engine.Progress(1000, whole=1000, warnings=[f"lamp {k} flickers" for k in range(1000)])
    monkeypatch.setattr(engine, "make", lambda *_, **__: done)
    told = clsim("dataset", "flow", "--out", tmp_path / "set").stderr
    assert "lamp 4 flickers" in told and "lamp 5 flickers" not in told
    assert "clsim: 995 more warnings are in the job.json of the sequences" in told
