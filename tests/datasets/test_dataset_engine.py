"""The engine on a cluster of its own: whole, resumed, killed, rejected."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from clsim.datasets.engine import make
from clsim.datasets.job import run_job, sequence_folder
from clsim.datasets.load import Slices
from clsim.datasets.manifest import read_manifest
from clsim.datasets.spec import Limits, load_spec
from clsim.errors import InputError
from tools.accuracy.dataset_kills import Making, contents, kill_often

pytestmark = pytest.mark.slow
_TINY = str(Path(__file__).with_name("tiny.toml"))


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    out = tmp_path_factory.mktemp("undisturbed") / "set"
    done = make(load_spec(_TINY), out, workers=2)
    assert (done.whole, done.found, done.new, done.failures) == (4, 0, 4, {})
    return out


@pytest.mark.timeout(900)
@pytest.mark.parametrize("apart", [False, True], ids=["one client", "scheduler and nannies apart"])
def test_kills_lose_nothing_and_double_nothing(undisturbed, tmp_path, apart):
    making = Making(_TINY, tmp_path / "set", workers=2, apart=apart)
    killed = kill_often(making, kills=3, seed=1, longest_s=6.0)
    assert len(killed) == 3
    assert contents(tmp_path / "set") == contents(undisturbed)
    assert [row["index"] for row in read_manifest(tmp_path / "set")] == [0, 1, 2, 3]


def test_what_is_torn_is_mended_and_what_is_whole_is_kept(undisturbed):
    before = contents(undisturbed)
    kept = sequence_folder(undisturbed, 1) / "events.h5"
    made = kept.stat().st_mtime_ns
    (sequence_folder(undisturbed, 0) / "events.h5").write_bytes(b"torn")
    (sequence_folder(undisturbed, 2) / "job.json").unlink()
    told = []
    done = make(load_spec(_TINY), undisturbed, workers=1, tell=lambda progress: told.append(progress.whole))
    assert (done.whole, done.found, done.new) == (4, 2, 2)
    assert told[0] == 2 and told[-1] == 4
    assert kept.stat().st_mtime_ns == made
    assert contents(undisturbed) == before


def test_more_sequences_join_those_that_are_there(undisturbed):
    assert make(load_spec(_TINY, count=4), undisturbed).found == 4
    other = replace(load_spec(_TINY), seeds=replace(load_spec(_TINY).seeds, noise=9))
    with pytest.raises(InputError, match="another specification, seed or version"):
        make(other, undisturbed)


def test_sequences_outside_the_limits_are_told_with_reasons(tmp_path):
    spec = replace(load_spec(_TINY), reject=Limits(attempts=2, nearest_m=1000.0))
    done = run_job(spec, 0, str(tmp_path), None)
    assert not done.kept
    assert len(done.rejected) == 2
    assert "nearest_m is" in done.rejected[0] and "expected at least 1000" in done.rejected[0]
    told = make(replace(spec, count=1), tmp_path / "whole")
    assert (told.rejected, told.new) == (1, 0), "what was rejected is not new"
    folder = sequence_folder(tmp_path, 0)
    assert [each.name for each in folder.iterdir()] == ["job.json"]
    assert json.loads((folder / "job.json").read_text())["kept"] is False


def test_flow_is_learnt_from_events(tmp_path):
    """Truth and events belong together: a least-squares fit of flow on events errs on sequences that it never saw by
    less than a third of what the mean flow of those that it saw does (in squares)."""
    spec = load_spec(str(Path(__file__).with_name("moving.toml")))
    for index in range(spec.count):
        run_job(spec, index, str(tmp_path), None)
    one, other = (_mean_flows(tmp_path, split) for split in ("train", "test"))
    for (seen, seen_flow), (new, new_flow) in ((one, other), (other, one)):
        assert len(seen) >= 5
        weights = np.linalg.lstsq(seen, seen_flow, rcond=None)[0]
        error = np.square(new @ weights - new_flow).sum()
        assert error < 0.3 * np.square(seen_flow.mean(axis=0) - new_flow).sum()


def _mean_flows(folder, split):
    """Return, for each slice with enough events, the flow that they tell and the mean of the true one."""
    told, true = [], []
    for each in Slices(folder, split=split, truth=("flow", "flow_valid")):
        valid = each["flow_valid"] > 0
        if valid.any() and len(each["events"]) > 200:
            told.append(_sharpest(each["events"]))
            true.append(each["flow"][valid].mean(axis=0))
    return np.array(told), np.array(true)


def _sharpest(events):
    """The flow by which the image of warped events is sharpest (Gallego et al., CVPR 2018), by half pixels."""
    t = (events["t"] - events["t"][0]) / (events["t"][-1] - events["t"][0])
    sign = np.where(events["on"], 1.0, -1.0)
    best = (-1.0, 0.0, 0.0)
    for u in np.linspace(-6, 6, 25):
        for v in np.linspace(-6, 6, 25):
            x, y = np.rint(events["x"] - u * t).astype(int), np.rint(events["y"] - v * t).astype(int)
            inside = (x >= 0) & (x < 48) & (y >= 0) & (y < 36)
            image = np.zeros((36, 48))
            np.add.at(image, (y[inside], x[inside]), sign[inside])
            best = max(best, (image.var(), u, v))
    return best[1:]
