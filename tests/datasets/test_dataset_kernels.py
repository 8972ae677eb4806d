"""Caches of kernels that workers share."""

from __future__ import annotations

import contextlib
import os
from concurrent.futures import CancelledError
from types import SimpleNamespace

import pytest

from clsim.datasets import engine
from clsim.datasets.kernels import KernelCaches, copy_missing
from clsim.datasets.spec import load_spec
from clsim.errors import InputError
from clsim.live.options import LiveOptions


def test_kernels_that_lack_are_copied_and_others_are_left_alone(tmp_path):
    one, other = tmp_path / "one", tmp_path / "other"
    for place, names in ((one, ("warp/1/a/k.o", "warp/1/b/k.o", "pocl/kcache/AB/k.so")), (other, ("warp/1/a/k.o",))):
        for name in names:
            (place / name).parent.mkdir(parents=True)
            (place / name).write_text(f"{place.name} {name}")
    for left in ("pocl/kcache/tempfile_x", "warp/1/b/.part-7-k.o", "history.sqlite"):
        (one / left).write_text("of no use to others")
    assert copy_missing(one, other) == 2
    assert sorted(str(each.relative_to(other)) for each in other.rglob("*") if each.is_file()) == [
        "pocl/kcache/AB/k.so", "warp/1/a/k.o", "warp/1/b/k.o",
    ]  # fmt: skip
    assert (other / "warp/1/a/k.o").read_text() == "other warp/1/a/k.o"
    assert (other / "warp/1/b/k.o").read_text() == "one warp/1/b/k.o"
    assert copy_missing(one, other) == 0
    assert copy_missing(tmp_path / "none", other) == 0


def test_a_cache_that_cannot_be_written_costs_no_sequence(tmp_path, monkeypatch):
    for variable in ("XDG_CACHE_HOME", "CLSIM_USER_CACHE", "POCL_MAX_PTHREAD_COUNT"):
        monkeypatch.setenv(variable, "")
    for variable in ("WARP_CACHE_PATH", "POCL_CACHE_DIR", "PYOPENCL_CACHE_DIR"):
        monkeypatch.setenv(variable, "elsewhere")
    (tmp_path / "clsim").write_text("no folder")
    monkeypatch.setenv("CLSIM_USER_CACHE", str(tmp_path))
    caches = KernelCaches("spec", 3)
    caches.setup(SimpleNamespace(local_directory=str(tmp_path / "worker")))
    assert os.environ["XDG_CACHE_HOME"] == str(tmp_path / "worker/kernels")
    assert not {"WARP_CACHE_PATH", "POCL_CACHE_DIR", "PYOPENCL_CACHE_DIR"} & {*os.environ}, "which lead elsewhere"
    assert os.environ["POCL_MAX_PTHREAD_COUNT"] == "3", "as many threads as a worker has"
    with caches.shared():
        made = tmp_path / "worker/kernels/warp/k.o"
        made.parent.mkdir(parents=True)
        made.write_text("kernel")
    with pytest.raises(ZeroDivisionError), caches.shared():
        _ = 1 / 0


def test_what_one_worker_compiles_is_there_for_the_next_of_the_specification(tmp_path, monkeypatch):
    for variable in ("XDG_CACHE_HOME", "POCL_MAX_PTHREAD_COUNT"):
        monkeypatch.setenv(variable, "")
    monkeypatch.setenv("CLSIM_USER_CACHE", str(tmp_path))
    for number, specification in enumerate(("flow", "flow", "other")):
        caches, kernel = KernelCaches(specification, 1), tmp_path / f"worker {number}" / "kernels/warp/k.o"
        caches.setup(SimpleNamespace(local_directory=str(kernel.parents[2])))
        with caches.shared():
            assert kernel.exists() == (number == 1)
            kernel.parent.mkdir(parents=True, exist_ok=True)
            kernel.write_text(specification)
        assert (tmp_path / "clsim/kernels" / specification / "warp/k.o").read_text() == specification


@pytest.mark.parametrize(
    ("workers", "scheduler", "processes", "threads"),
    [(None, None, 4, 2), (3, None, 3, 2), (16, None, 16, 1), (None, "tcp://a:1", None, 1), (2, "nobody", None, 1)],
)
def test_workers_share_the_cores_of_a_machine(monkeypatch, workers, scheduler, processes, threads):
    """Of eight; what cores a cluster has nobody knows here."""
    asked = []

    class Client(contextlib.nullcontext):
        def __init__(self, where, timeout=None):
            super().__init__(self)
            if where == "nobody":
                raise OSError("no such host")

        def register_plugin(self, plugin):
            asked.append(plugin._threads)

    def cluster(n_workers, **_):
        asked.append(n_workers)
        return contextlib.nullcontext()

    monkeypatch.setattr("distributed.Client", Client)
    monkeypatch.setattr("distributed.LocalCluster", cluster)
    monkeypatch.setattr("os.cpu_count", lambda: 8)
    told = pytest.raises(InputError, match="nobody: no scheduler of Dask answers \\(no such host\\)")
    told = told if scheduler == "nobody" else contextlib.nullcontext()
    with told, engine._client(load_spec("flow"), workers, scheduler) as (_, found):
        assert found == threads and asked == [*([processes] if scheduler is None else []), threads]


def test_what_is_compiled_ahead_are_two_frames_however_long_sequences_are(monkeypatch):
    """A specification may say it in seconds; both at once would be refused."""
    ran = []
    monkeypatch.setattr(engine, "run_task", lambda spec, *_: ran.append(spec))
    engine.run_briefly(load_spec("flow"), 0, 1)
    options = LiveOptions.from_dict(ran[0].sample(0).run | {"scene": "a.toml"})
    assert (options.frame_count, options.duration_s, ran[0].reject.needs) == (2, None, ())


def test_a_worker_that_dies_compiling_ahead_does_not_end_the_run():
    def compile_with(error):
        def result():
            raise error

        client = SimpleNamespace(submit=lambda *_, **__: SimpleNamespace(result=result))
        engine._compile(client, load_spec("flow"), 0, 1)

    compile_with(RuntimeError("it died ten times"))
    with pytest.raises(InputError, match="sequence 0: wrong"):
        compile_with(InputError("wrong"))
    with pytest.raises(engine.SchedulerLostError):
        compile_with(CancelledError())
