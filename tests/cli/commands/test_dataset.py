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


def test_workers_are_at_least_one_and_no_bar_is_drawn_elsewhere_than_on_a_terminal(clsim, monkeypatch, tmp_path):
    monkeypatch.setattr(engine, "make", lambda *_, tell, **__: tell(engine.Progress(2)) or engine.Progress(2, whole=2))
    words = "dataset", "flow", "--out", tmp_path / "set"
    assert clsim(*words).stderr.splitlines() == [f"clsim: 2 of 2 sequences are in {tmp_path / 'set'}, 2 of them new"]
    outcome = clsim(*words, "--workers", "-3")
    assert outcome.status == 2 and outcome.stderr.startswith("clsim: --workers must be greater than or equal to 1")
