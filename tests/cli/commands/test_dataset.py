"""``clsim dataset``: what it prints; the engine is a stand-in's."""

from __future__ import annotations

import json
import re

import pytest

from clsim.datasets import engine, preview


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
    monkeypatch.setattr(
        engine, "make", lambda *_, tell, **__: tell(engine.Progress(2)) or engine.Progress(2, whole=2, new=2)
    )
    words = "dataset", "flow", "--out", tmp_path / "set"
    assert clsim(*words).stderr.splitlines() == [f"clsim: 2 of 2 sequences are in {tmp_path / 'set'}, 2 of them new"]
    outcome = clsim(*words, "--workers", "-3")
    assert outcome.status == 2 and outcome.stderr.startswith("clsim: --workers must be greater than or equal to 1")


def test_what_was_rejected_is_not_among_what_is_there(clsim, monkeypatch, tmp_path):
    """Two of four were there, of which one was rejected, as was one of the two that this run made."""
    done = engine.Progress(4, whole=4, found=2, rejected=2, new=1)
    monkeypatch.setattr(engine, "make", lambda *_, **__: done)
    told = clsim("dataset", "flow", "--out", tmp_path / "set").stderr.splitlines()
    assert told[0] == f"clsim: 2 of 4 sequences are in {tmp_path / 'set'}, 1 of them new"
    assert told[1].startswith("clsim: 2 were rejected at each attempt")


def test_what_is_asked_for_reaches_the_engine(clsim, monkeypatch, tmp_path):
    asked = []

    def make(spec, out, *, tell, **more):
        asked.append((spec.count, out, more))
        return engine.Progress(spec.count, whole=spec.count)

    monkeypatch.setattr(engine, "make", make)
    words = ("--count", "3", "--workers", "2", "--scheduler", "tcp://a:1", "--verify", "--out", tmp_path / "set")
    assert clsim("dataset", "flow", *words).status == 0
    assert asked == [(3, tmp_path / "set", {"workers": 2, "scheduler": "tcp://a:1", "verify": True})]


def test_a_data_set_with_a_sequence_that_failed_is_a_failure(clsim, monkeypatch, tmp_path):
    monkeypatch.setattr(engine, "make", lambda *_, **__: engine.Progress(2, whole=1, failures={1: "it broke"}))
    outcome = clsim("dataset", "flow", "--out", tmp_path / "set", "--shards", "webdataset")
    assert outcome.status == 1 and "clsim: sequence 1 failed: it broke" in outcome.stderr


def test_the_cost_of_a_few_sequences_is_told_in_seconds_and_megabytes():
    few = preview.Preview("a.png", 3, 0.00093, 0.03, 0.0037, 0, ()).sentences
    assert few[0] == "3 samples are on a.png"
    assert "about 3.3 seconds of CPU time, 1.8 minutes on this machine, and 3.7 MB;" in few[1]
    many = preview.Preview("a.png", 1, 412.0, 1.4, 1530.0, 2, ()).sentences
    assert many[0] == "1 sample is on a.png; attempts that were not kept: 2"
    assert "about 410 hours of CPU time, 84 minutes on this machine, and 1,500 GB;" in many[1]


def test_a_look_ahead_is_for_as_many_workers_as_are_asked_for(clsim, monkeypatch, tmp_path):
    asked = []

    def look(spec, out, workers):
        asked.append((spec.count, out, workers))
        return preview.Preview("a.png", 1, 0.0, 0.0, 0.0, 0, ())

    monkeypatch.setattr(preview, "preview", look)
    words = ("--dry-run", "--count", "7", "--workers", "2", "--json")
    assert json.loads(clsim("dataset", "flow", "--out", tmp_path / "set", *words).stdout)["sheet"] == "a.png"
    assert asked == [(7, tmp_path / "set", 2)]


@pytest.mark.parametrize("count", range(9))
def test_each_warning_is_printed_or_counted(clsim, monkeypatch, tmp_path, count):
    done = engine.Progress(9, whole=9, warnings=[f"lamp {k} flickers" for k in range(count)])
    monkeypatch.setattr(engine, "make", lambda *_, **__: done)
    told = clsim("dataset", "flow", "--out", tmp_path / "set").stderr
    more = re.findall(r"(\d+) more warnings? (?:is|are) in", told)
    assert told.count("flickers") + sum(map(int, more)) == count
    assert ("1 more warning is in" in told) == (more == ["1"])
