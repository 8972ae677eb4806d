"""Children that are forked from a process in which clsim has run, or has not."""

import gc
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import clsim
from clsim.errors import Error
from clsim.scene import load_world
from tests.simulator.stage import keyframed, scene, simulator

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")

PICTURE = np.full((8, 16), 0.5, np.float32)


def said_in_child(run: Callable[[], object]) -> str:
    """Return the message of the clsim.Error that a forked child ends with; anything else fails, waiting above all."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        signal.alarm(20)
        try:
            run()
            told = "nothing was wrong"
        except Error as error:
            told = str(error)
        except BaseException as error:
            told = repr(error)
        os.write(writer, told.encode())
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader) as end:
        told = end.read()
    assert os.waitpid(child, 0)[1] == 0, "the child waited"
    return told


REFUSED = "clsim has run in the process that this one was forked from"


@pytest.mark.filterwarnings("ignore:.*multi-threaded:DeprecationWarning")
def test_what_the_parent_has_run_is_refused_in_a_child_at_once(tmp_path: Path) -> None:
    out = tmp_path / "events.csv"
    with (
        simulator(tmp_path) as stage,
        clsim.stream(scene(tmp_path, keyframed()), frame_count=6, outputs=str(out)) as stream,
    ):
        stage.step(until_us=0)
        next(stream)
        view, frame = stage._camera_pipeline.view, stage.frame()
        assert view is not None
        for run in (
            lambda: next(clsim.stream("still")),
            lambda: clsim.Simulator("still"),
            lambda: stage.step(until_us=10_000),
            lambda: stage.frame(),
            lambda: next(stream),
            lambda: (view.forget_light(), view.fill(1, frame)),
            lambda: next(clsim.events_from([PICTURE, PICTURE], fps=100.0)),
        ):
            told = said_in_child(run)
            assert told.startswith(REFUSED) and "spawn" in told, told
        with ThreadPoolExecutor(1) as other:  # that works in it while the process is forked
            other.submit(stage._turn.scene.lock.acquire).result()
            assert said_in_child(lambda: stage.step(until_us=10_000)).startswith(REFUSED)
            other.submit(stage._turn.scene.lock.release).result()
        # What needs no device is done there, and what is the parent's is left alone.
        assert said_in_child(lambda: (load_world("still"), stage.close(), stream.close())) == "nothing was wrong"
        stage.step(until_us=10_000)
        events = sum(map(len, stream))
    assert events > 0 and stream.summary.events == len(clsim.open(str(out)).read()) == events


class Loop:
    """Is thrown away by the garbage collector alone, and then heard of."""

    thrown = 0

    def __init__(self) -> None:
        self.me = self

    def __del__(self) -> None:
        Loop.thrown += 1


@pytest.mark.filterwarnings("ignore:.*multi-threaded:DeprecationWarning")
def test_a_child_leaves_what_its_parent_has_yet_to_throw_away(tmp_path: Path) -> None:
    """It may be memory of OpenCL, whose threads stayed behind: the child would wait for them for ever."""

    def collect() -> None:
        gc.collect()
        raise Error(f"{Loop.thrown} thrown away")

    with simulator(tmp_path) as stage:
        stage.step(until_us=0)
        gc.disable()
        try:
            Loop()
            assert said_in_child(collect) == "0 thrown away"
        finally:
            gc.enable()
    gc.collect()
    assert Loop.thrown == 1


POOL = """
import multiprocessing
import clsim
import numpy as np


def count(brighter):
    pictures = [np.full((8, 16), level, np.float32) for level in (0.5, 0.5 * brighter)]
    return sum(map(len, clsim.events_from(pictures, fps=100.0)))


if __name__ == "__main__":
    clsim.load_scene("still")
    with multiprocessing.get_context("fork").Pool(2) as pool:
        print("forked", pool.map(count, [1.0, 1.3]))
    print("here", count(1.3))
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        print("spawned", pool.map(count, [1.0, 1.3]))
    with multiprocessing.get_context("fork").Pool(2) as pool:
        try:
            pool.map(count, [1.0, 1.3])
        except clsim.Error as error:
            print("forked late:", error)
"""


def test_pools_of_workers_run_or_say_why_they_do_not(tmp_path: Path) -> None:
    (tmp_path / "pool.py").write_text(POOL)
    run = subprocess.run([sys.executable, tmp_path / "pool.py"], capture_output=True, text=True, timeout=120)
    lines = run.stdout.splitlines()
    assert lines[:3] == ["forked [0, 128]", "here 128", "spawned [0, 128]"], run.stdout + run.stderr
    assert lines[3].startswith(f"forked late: {REFUSED}") and run.returncode == 0
