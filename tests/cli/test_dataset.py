"""``clsim dataset``: what it prints; the engine is a stand-in's."""

from __future__ import annotations

from clsim.datasets import engine


def test_what_scenes_ask_for_in_vain_is_printed(clsim, monkeypatch, tmp_path):
    done = engine.Progress(3, whole=3, warnings=["scene.toml: media are left out"])
    monkeypatch.setattr(engine, "make", lambda *_, **__: done)
    outcome = clsim("dataset", "flow", "--out", tmp_path / "set")
    assert outcome.status == 0
    assert "clsim: scene.toml: media are left out" in outcome.stderr.splitlines()
