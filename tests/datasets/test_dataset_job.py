"""A sequence's folder: what is there, what is made again, what killed ones left; simulation is a stand-in's."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import platform
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import pytest

from clsim.datasets import engine, job
from clsim.datasets.engine import Progress, _missing, prepare
from clsim.datasets.job import Done, read_done, run_job, sequence_folder
from clsim.datasets.manifest import read_manifest
from clsim.datasets.measure import Figures
from clsim.datasets.spec import Limits, load_spec
from clsim.errors import InputError

_DATA = bytes(range(256)) * 5000  # more than a block


@pytest.fixture
def spec(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text('[scene]\nbase = "still"\n')
    return load_spec(str(path))


@pytest.fixture
def made(monkeypatch):
    """Which samples were simulated."""
    samples = []

    def run(spec, sample, part, threads):
        (part / "scene.toml").write_text("scene")
        (part / f"attempt-{len(samples)}.h5").write_bytes(_DATA)
        samples.append(sample)
        return Figures(2, 1, 3, 0.1, 7, 4, float(len(samples))), ("scene.toml: media are left out",)

    monkeypatch.setattr(job, "_run", run)
    return samples


def test_what_is_whole_is_not_made_again_unless_it_is_of_another_job(tmp_path, spec, made):
    first = run_job(spec, 3, str(tmp_path), None)
    assert run_job(spec, 3, str(tmp_path), None) == first == read_done(sequence_folder(tmp_path, 3), verify=True)
    assert len(made) == 1
    other = replace(spec, also=("a.csv",))
    assert run_job(other, 3, str(tmp_path), None).job != first.job
    assert len(made) == 2
    assert read_done(sequence_folder(tmp_path, 3)).job == other.job_hash(3)


def test_files_have_their_sizes_and_hashes(tmp_path, spec, made, monkeypatch):
    clocks = SimpleNamespace(perf_counter=iter((3.0, 103.0)).__next__, process_time=iter((5.0, 12.0)).__next__)
    monkeypatch.setattr(job, "time", clocks)
    done = run_job(spec, 0, str(tmp_path), None)
    assert done.files["attempt-0.h5"] == (len(_DATA), hashlib.sha256(_DATA).hexdigest())
    assert set(done.files) == {"attempt-0.h5", "scene.toml"}
    assert done.figures["events"] == 7 and done.cost == {"cpu_s": 7.0, "wall_s": 100.0}


def test_what_scenes_ask_for_in_vain_is_told_once(tmp_path, spec, made):
    told = run_job(spec, 0, str(tmp_path), None).warnings
    run_job(spec, 1, str(tmp_path), None)
    assert told == read_done(sequence_folder(tmp_path, 1)).warnings == ("scene.toml: media are left out",)
    progress = Progress(2)
    assert _missing(replace(spec, count=2), tmp_path, False, progress) == []
    assert progress.warnings == ["scene.toml: media are left out"]


def test_attempts_end_with_the_first_that_is_kept(tmp_path, spec, made):
    done = run_job(replace(spec, reject=Limits(4, events_per_pixel_s=(2.5, 9.0))), 0, str(tmp_path), None)
    assert done.kept and len(done.rejected) == 2
    assert done.rejected[1] == "attempt 1: events_per_pixel_s is 2, expected 2.5 to 9"
    assert set(done.files) == {"attempt-2.h5", "scene.toml"}
    assert len({sample.run["seed"] for sample in made}) == 3
    made.clear()
    usual = replace(spec, reject=Limits(events_per_pixel_s=(5.0, 9.0)))
    assert run_job(usual, 1, str(tmp_path), None).kept and len(made) == 5
    progress = Progress(1)
    progress.add(done)
    assert (progress.whole, progress.rejected) == (1, 0)


def test_none_is_kept_when_all_are_rejected(tmp_path, spec, made):
    done = run_job(replace(spec, reject=Limits(2, events_per_pixel_s=(99.0, 100.0))), 0, str(tmp_path), None)
    assert not done.kept and done.files == {} and done.figures == {}
    assert [each.name for each in sequence_folder(tmp_path, 0).iterdir()] == ["job.json"]


def test_folders_of_killed_processes_go_and_those_of_others_stay(tmp_path, spec, made):
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    place = tmp_path / "sequences"
    left, foreign, running = (
        place / f".000000.{node}.{pid}.part"
        for node, pid in ((platform.node(), ended.pid), ("elsewhere", ended.pid), (platform.node(), os.getppid()))
    )
    for each in (left, foreign, running):
        each.mkdir(parents=True)
    run_job(spec, 0, str(tmp_path), None)
    assert not left.exists() and foreign.exists() and running.exists()


@pytest.mark.parametrize("number", [errno.ENOTEMPTY, errno.EEXIST, errno.ENOSPC])
def test_of_two_that_make_a_sequence_at_a_time_the_second_gives_way(tmp_path, spec, made, monkeypatch, number):
    def rename(part, target):
        raise OSError(number, "as told")

    monkeypatch.setattr("os.rename", rename)
    if number == errno.ENOSPC:
        with pytest.raises(OSError, match="as told"):
            run_job(spec, 0, str(tmp_path), None)
    else:
        assert run_job(spec, 0, str(tmp_path), None).kept
    assert not any((tmp_path / "sequences").iterdir()), "nothing is left of it"


def test_a_torn_sequence_gives_way(tmp_path, spec, made):
    target = sequence_folder(tmp_path, 0)
    target.mkdir(parents=True)
    (target / "events.h5").write_bytes(b"torn")
    done = run_job(spec, 0, str(tmp_path), None)
    assert not (target / "events.h5").exists() and read_done(target, verify=True) == done


def test_what_is_there_is_counted_before_more_is_made(tmp_path, spec, made):
    picky = replace(spec, count=4, reject=Limits(1, events_per_pixel_s=(2.0, 9.0)))
    for index in (0, 1):  # the stand-in's first one is rejected
        run_job(picky, index, str(tmp_path), None)
    run_job(replace(spec, count=4), 2, str(tmp_path), None)  # of another specification
    progress = Progress(4)
    assert _missing(picky, tmp_path, False, progress) == [2, 3]
    assert (progress.whole, progress.found, progress.rejected) == (2, 2, 1)
    assert not sequence_folder(tmp_path, 2).exists()
    torn = sequence_folder(tmp_path, 1)
    (torn / "scene.toml").write_text("other")  # as long as it was
    assert _missing(picky, tmp_path, False, Progress(4)) == [2, 3] and torn.exists()
    assert _missing(picky, tmp_path, True, Progress(4)) == [1, 2, 3] and not torn.exists()


def test_what_ends_badly_is_tried_again_and_what_stays_bad_is_told(tmp_path, spec, monkeypatch):
    """Of a stand-in's workers: one dies now and then, one always; what is no scene would be none again."""

    def done(index, **more):
        return replace(Done(index, "", "", {}, {}, (), True, {"cpu_s": 2.0}), **more)

    will = {
        0: [done(0)],
        1: [RuntimeError("died"), done(1)],
        2: [InputError("no scene")],
        3: [RuntimeError(f"died {k}") for k in (1, 2, 3, 4)],
        4: [done(4, kept=False, rejected=("too dark", "too dark"))],
    } | {index: [done(index)] for index in range(5, 12)}
    ahead: list[set[int]] = [set()]

    class Running(list):
        add = list.append

        def __iter__(self):
            while self:
                yield self.pop(0)

    class Task:
        def __init__(self, run, spec, index, out, threads, key):
            self.index = index
            ahead.append(ahead[-1] | {index})

        def result(self):
            ahead.append(ahead[-1] - {self.index})
            found = will[self.index].pop(0)
            if isinstance(found, Exception):
                raise found
            return found

        def release(self):
            pass

    client = SimpleNamespace(submit=Task, scheduler_info=lambda n_workers: {"workers": {}})
    monkeypatch.setattr("distributed.as_completed", Running)
    monkeypatch.setattr(engine, "_client", lambda *given: contextlib.nullcontext((client, 1)))
    monkeypatch.setattr(engine, "_compile", lambda *given: None)
    progress = engine.make(replace(spec, count=12), tmp_path / "set")
    assert progress.failures == {2: "InputError: no scene", 3: "RuntimeError: died 3"}
    assert max(map(len, ahead)) == 4, "of a set of thousands few are sent ahead"
    assert {index: len(rest) for index, rest in will.items()} == {**dict.fromkeys(range(12), 0), 3: 1}
    assert (progress.whole, progress.found, progress.new, progress.rejected, progress.cpu_s) == (10, 0, 9, 1, 20.0)


def test_a_specification_that_was_wrong_does_not_take_its_folder(tmp_path, spec, made):
    out, other = tmp_path / "set", replace(spec, also=("a.csv",))
    prepare(spec, out)
    prepare(other, out)
    assert json.loads((out / "dataset.json").read_text())["digest"] == other.digest
    run_job(other, 0, str(out), None)
    with pytest.raises(InputError, match="another specification, seed or version"):
        prepare(spec, out)


def test_a_folder_that_cannot_be_a_data_set_and_what_is_missing_are_told(tmp_path, spec, monkeypatch):
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "dataset.json").write_text("[")
    with pytest.raises(InputError, match=r"dataset.json: is damaged; remove it if the folder is of this specification"):
        prepare(spec, tmp_path / "set")
    with pytest.raises(InputError, match=r"cannot be written \(Not a directory\)"):
        prepare(spec, tmp_path / "a.toml" / "set")
    with pytest.raises(InputError, match=r"set: holds no data set, for manifest.parquet is missing"):
        read_manifest(tmp_path / "set")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"data sets need dask.distributed; install it with: pip install 'clsim\[clu"):
        engine.make(spec, tmp_path / "other")


@pytest.mark.parametrize("text", ["", "{}", "[]", "null", '{"files": 3}', '{"index": 1, "job": 2}', "\xff"])
def test_a_job_file_that_tells_nothing(tmp_path, text):
    (tmp_path / "job.json").write_text(text, encoding="latin-1")
    assert read_done(tmp_path) is None


def test_a_scene_that_cannot_be_is_told_without_the_hidden_folder(tmp_path):
    (tmp_path / "a.toml").write_text("count = 1\n")
    with pytest.raises(InputError, match=r"^the scene that is drawn: camera: is missing"):
        run_job(load_spec(str(tmp_path / "a.toml")), 0, str(tmp_path / "set"), None)
    assert not any((tmp_path / "set" / "sequences").iterdir())


@pytest.mark.slow
def test_a_scene_that_asks_for_what_clsim_lacks_is_made_and_tells_so(tmp_path):
    """It is not refused: of thousands of scenes a few may ask for what is left out."""
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\ncurv 0 1 1 2 3\n")
    run = "frame_count = 2\nfps = 100\nresolution = [16, 12]\nquality = 'draft'"
    thing = "[[scene.objects]]\nname = 'left'\nfile = 'a.obj'"
    (tmp_path / "a.toml").write_text(f"[run]\n{run}\n[scene]\nbase = 'still'\n{thing}\n")
    done = run_job(load_spec(str(tmp_path / "a.toml")), 0, str(tmp_path / "set"), None)
    assert done.kept and done.warnings == ("a.obj: curves and curved surfaces are left out",)


def test_a_dry_runs_sheet_is_in_nobodys_way(tmp_path):
    out = tmp_path / "set"
    out.mkdir()
    (out / "contact-sheet.png").write_bytes(b"a picture")
    spec = load_spec("flow")
    prepare(spec, out)
    assert (out / "contact-sheet.png").is_file()
    assert json.loads((out / "dataset.json").read_text())["split"] == ["train", "val", "test"]
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "notes.txt").touch()
    with pytest.raises(InputError, match="something else"):
        prepare(spec, tmp_path / "notes")
