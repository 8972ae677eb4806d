"""`clsim.stream`: checked when called, complete however it ends."""

import gc
import importlib
import importlib.util
import inspect
import json
import pkgutil
import subprocess
import sys
import threading
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

import clsim
from clsim.errors import InputError
from clsim.live.options import LiveOptions
from clsim.live.outputs.queue_sink import QueueSink
from clsim.live.outputs.summary import Summary
from clsim.live.session import open_live

SMALL = {"resolution": (32, 24), "spp": 1, "fps": 60.0}


def threads() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name.startswith("clsim-")]


def test_all_options_of_a_live_run_are_keywords_with_the_same_defaults() -> None:
    known = {field.name: field.default for field in fields(LiveOptions)}
    parameters = inspect.signature(clsim.stream).parameters
    assert set(parameters) == set(known)
    assert all(parameters[name].default == known[name] for name in known.keys() - {"scene", "files"})


def test_the_simulators_keywords_are_those_of_a_stream() -> None:
    stream, simulator = (inspect.signature(each).parameters for each in (clsim.stream, clsim.Simulator))
    shared = set(simulator) - {"clock"}
    assert shared < set(stream)
    assert all(simulator[name].default == stream[name].default for name in shared)
    of_runs = {"duration_s", "frame_count", "loop", "outputs", "files", "pace", "governor", "ring"}
    of_files = {"frame_rate", "pose_rate", "imu_rate", "imu_noise"}
    assert set(stream) - shared == of_runs | of_files


def test_everything_is_checked_when_it_is_called(tmp_path: Path) -> None:
    for wrong in ({"fps": -1.0}, {"quality": "best"}, {"outputs": (str(tmp_path / "a.mov"),)}, {"opencl": "nothing"}):
        with pytest.raises(InputError):
            clsim.stream("still", **wrong)
    with pytest.raises(InputError):
        clsim.stream("stil")
    with pytest.raises(TypeError):
        clsim.stream("still", colour=1)


def test_a_run_tells_its_size_its_poses_and_what_it_did(tmp_path: Path) -> None:
    out = tmp_path / "a.npz"
    with clsim.stream("two-boxes", **SMALL, frame_count=4, history=2, outputs=(str(out),)) as run:
        assert (run.width, run.height, run.fps) == (32, 24, 60.0)
        assert run.warnings == ("`method` esim has no use for `history`",)
        assert isinstance(run.summary, Summary) and run.summary.frames == 0
        assert not threads(), "it begins with the first frame asked for"
        next(run)
        times, poses = run.poses
        assert (times.tolist(), poses.shape) == ([0], (1, 4, 4))
        found = sum(map(len, run))
        assert list(run) == []
    times, poses = run.poses
    assert times.tolist() == [0, 16667, 33333, 50000]
    motion = clsim.load_scene("two-boxes").camera.motion
    np.testing.assert_allclose(poses, [motion.pose(t * 1e-6) for t in times], atol=1e-12)
    assert (run.summary.frames, run.summary.events, run.summary.simulated_s) == (4, found, 0.05)
    assert run.summary.outputs[-1] == {"name": str(out)}
    about = json.loads((tmp_path / "a.npz.json").read_text())
    assert about["complete"] and about["summary"]["events"] == found
    assert not threads()


def test_poses_of_a_loop_begin_again() -> None:
    period_us = round(clsim.load_scene("two-boxes").duration_s * 1e6)
    with clsim.stream("two-boxes", resolution=(8, 6), fps=10.0, frame_count=30, loop=True, method="esim") as run:
        for _ in run:
            pass
    times, poses = run.poses
    motion = clsim.load_scene("two-boxes").camera.motion
    np.testing.assert_allclose(poses, [motion.pose(t % period_us * 1e-6) for t in times.tolist()], atol=1e-9)


@pytest.mark.parametrize("ends", ["block", "close", "garbage"])
def test_a_run_that_is_left_ends_and_completes_its_files(tmp_path: Path, ends: str) -> None:
    out = tmp_path / "a.txt"
    run = clsim.stream("two-boxes", **SMALL, loop=True, outputs=(str(out),))
    if ends == "block":
        with run:
            assert next(run) is not None
    else:
        assert next(run) is not None
        if ends == "close":
            run.close()
    if ends != "garbage":
        assert next(run, None) is None
        run.close()
    del run
    gc.collect()
    assert not threads()
    about = json.loads((tmp_path / "a.txt.json").read_text())
    assert about["complete"] is False and about["summary"]["frames"] >= 1


def test_ctrl_c_ends_the_run_and_completes_its_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = clsim.stream("two-boxes", **SMALL, loop=True, outputs=(str(tmp_path / "a.npz"),))
    next(run)

    def interrupted(timeout_s: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(run._queue, "get", interrupted)
    with pytest.raises(KeyboardInterrupt):
        next(run)
    assert not threads() and next(run, None) is None
    about = json.loads((tmp_path / "a.npz.json").read_text())
    assert about["complete"] is False
    assert len(clsim.open(tmp_path / "a.npz").read()) == about["summary"]["events"]


def test_a_run_that_never_began_leaves_its_file_readable(tmp_path: Path) -> None:
    with clsim.stream("still", **SMALL, outputs=(str(tmp_path / "a.npz"),)):
        pass
    assert len(clsim.open(tmp_path / "a.npz").read()) == 0
    assert not (tmp_path / "a.npz.json").exists()


def test_a_sidecar_that_cannot_be_written_leaves_no_output_open(tmp_path: Path) -> None:
    (tmp_path / "a.npz.json").mkdir()
    run = clsim.stream("still", **SMALL, outputs=(str(tmp_path / "a.npz"),))
    with pytest.raises(InputError, match=r"a\.npz\.json"):
        next(run)
    assert len(clsim.open(tmp_path / "a.npz").read()) == 0
    assert not threads()
    session = open_live(LiveOptions("still", resolution=(16, 12), outputs=(str(tmp_path / "a.npz"),)))
    with pytest.raises(InputError, match=r"a\.npz\.json"):
        session.start()
    assert all(output.closed for output in session.pipeline.outputs)


def test_importing_the_package_imports_nothing_heavy() -> None:
    script = (
        "import sys, clsim; dir(clsim); print(sorted({'numpy', 'warp', 'pyopencl', 'clsim.live'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", script], capture_output=True, text=True).stdout == "[]\n"


def test_all_errors_derive_from_one() -> None:
    for module in pkgutil.walk_packages(clsim.__path__, "clsim."):
        if ".bench" in module.name or ".cli" in module.name or module.name.endswith("__main__"):
            continue
        if module.name == "clsim.datasets.pytorch" and importlib.util.find_spec("torch") is None:
            continue
        for kind in vars(importlib.import_module(module.name)).values():
            if isinstance(kind, type) and issubclass(kind, Exception) and kind.__module__.startswith("clsim"):
                assert issubclass(kind, (clsim.Error, Warning)), kind


def test_what_the_package_shows() -> None:
    assert {"stream", "open", "write", "load_scene", "Simulator", "World", "Error", "InputError"} <= set(dir(clsim))
    for name in dir(clsim):
        assert getattr(clsim, name) is not None
    with pytest.raises(AttributeError, match="has no attribute 'strem'"):
        clsim.strem  # noqa: B018


def test_a_world_is_streamed_as_the_file_that_it_was_loaded_from():
    """The same events as of the name, and none of the options that belong to files."""
    options = {"fps": 60, "frame_count": 4, "quality": "draft"}
    with clsim.stream("two-boxes", resolution=(24, 18), **options) as named:
        expected = np.concatenate([batch["t"] for batch in named])
    world = clsim.load_scene("two-boxes", resolution=(24, 18))
    with clsim.stream(world, **options) as made:
        found = np.concatenate([batch["t"] for batch in made])
    assert len(found) and np.array_equal(found, expected)
    with pytest.raises(InputError, match="`resolution` is for scenes that are loaded"):
        clsim.stream(world, resolution=(24, 18))


def test_what_tells_of_a_run_names_no_file_for_a_world(tmp_path):
    world = clsim.load_scene("two-boxes", resolution=(24, 18))
    with clsim.stream(world, frame_count=2, quality="draft", outputs=str(tmp_path / "a.npz")) as made:
        list(made)
    assert json.loads((tmp_path / "a.npz.json").read_text())["options"]["scene"] is None


def test_batches_that_wait_are_not_those_that_are_written_next() -> None:
    """A sink's caller may reuse its array."""
    queue, events = QueueSink(4), np.zeros(3, clsim.EVENT_DTYPE)
    for time_us in (10, 20):
        events["t"] = time_us
        queue.write(events, time_us)
    for time_us in (10, 20):
        found, end_us = queue.get(1.0)
        assert found["t"].tolist() == [time_us] * 3 and end_us == time_us


def test_threads_may_read_one_stream_in_turn() -> None:
    """They ran into each other where one had not begun the run yet."""
    together = threading.Barrier(4)

    def read(run: Iterable[np.ndarray]) -> list[int]:
        together.wait()
        return [len(events) for events in run]

    with clsim.stream("two-boxes", **SMALL, frame_count=12) as run, ThreadPoolExecutor(4) as pool:
        found = [count for counts in pool.map(read, [run] * 4) for count in counts]
    assert sorted(found) == sorted(map(len, clsim.stream("two-boxes", **SMALL, frame_count=12))) and len(found) == 12
