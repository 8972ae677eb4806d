"""The engine: sequences as tasks of dask.distributed, on this machine or a cluster that runs; what is there is kept."""

from __future__ import annotations

import contextlib
import importlib.util
import itertools
import json
import logging
import math
import os
import shutil
import tempfile
import time
import uuid
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from clsim.datasets.job import Done, read_done, run_job, sequence_folder
from clsim.datasets.kernels import KernelCaches
from clsim.datasets.manifest import write_manifest
from clsim.datasets.preview import SHEET
from clsim.datasets.spec import Spec
from clsim.errors import Error, InputError

_ROUNDS = 3
"""How often what is missing is tried, after tasks that ended badly."""
_AHEAD = 4
"""Tasks for each worker that wait at the scheduler."""
_ASK_S = 2.0
"""How often the scheduler is asked how many workers there are: they come and go."""
_LOST = "the scheduler has gone; what is whole is kept, and the same command with a new one goes on"


class SchedulerLostError(Error):
    """The scheduler ended before all sequences were made; those that are whole are kept."""


@dataclass
class Progress:
    """How far a data set is.

    Attributes:
        total: sequences that it shall have.
        whole: those that are there.
        found: those that were there at the start.
        rejected: those of which no attempt was kept.
        new: those that this run made and kept.
        cpu_s: processor time of those made in this run.
        failures: what went wrong, by number of the sequence.
        warnings: what sequences ask for and do not get, each sentence once.
    """

    total: int
    whole: int = 0
    found: int = 0
    rejected: int = 0
    new: int = 0
    cpu_s: float = 0.0
    failures: dict[int, str] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)

    def add(self, done: Done) -> None:
        """Count a sequence that is there."""
        self.whole += 1
        self.rejected += not done.kept
        self.warnings += [sentence for sentence in done.warnings if sentence not in self.warnings]


def make(
    spec: Spec,
    out: Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    verify: bool = False,
    tell: Callable[[Progress], None] = lambda _: None,
) -> Progress:
    """Make what is missing of a data set in ``out``, and its manifest; returns what came of it.

    Args:
        spec: what it shall be.
        out: its folder; a cluster's workers must see it under the same name.
        workers: processes on this machine; None is one for every two cores.
        scheduler: address of a cluster's scheduler, instead.
        verify: compare the hashes of what is there, not its sizes alone.
        tell: called whenever something has changed.

    Raises:
        InputError: dask.distributed is missing, the scheduler cannot be reached, or the folder is of another kind.
        SchedulerLostError: it ended on the way.
    """
    check_engine()
    prepare(spec, out)
    progress = Progress(spec.count)
    missing = _missing(spec, out, verify, progress)
    tell(progress)
    if missing:
        with _client(spec, workers, scheduler) as (client, threads):
            _compile(client, spec, missing[0], threads)
            for _ in range(_ROUNDS):
                missing = _round(client, spec, out, missing, threads, progress, tell)
    write_manifest(out)
    return progress


def check_engine() -> None:
    """Raise InputError where a library is missing."""
    for module, name in (("distributed", "dask.distributed"), ("pyarrow", "pyarrow")):
        if importlib.util.find_spec(module) is None:
            raise InputError(f"data sets need {name}; install it with: pip install 'clsim[cluster]'")


def prepare(spec: Spec, out: Path) -> None:
    """Make the folder and write what it is of; raises InputError where it has sequences of another specification."""
    told = {"name": spec.name, "digest": spec.digest, "split": [name for name, _ in spec.parts]}
    about = out / "dataset.json"
    try:
        out.mkdir(parents=True, exist_ok=True)
        if about.is_file():
            found = json.loads(about.read_text(encoding="utf-8"))
            # Where no sequence was begun, as after a specification that was wrong, nothing could be mixed.
            if found.get("digest") != spec.digest and any(out.glob("sequences/*")):
                raise InputError(
                    f"{out}: holds a data set of another specification, seed or version of clsim; give a new folder"
                )
        elif any(each.name != SHEET for each in out.iterdir()):
            raise InputError(f"{out}: holds something else than a data set; give a new or empty folder")
        part = out / f".dataset.json.{os.getpid()}.part"
        part.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
        os.replace(part, about)
    except OSError as error:
        raise InputError(f"{out}: cannot be written ({error.strerror})") from None
    except (ValueError, AttributeError) as error:
        if isinstance(error, Error):
            raise
        raise InputError(f"{about}: is damaged; remove it if the folder is of this specification") from None


def _missing(spec: Spec, out: Path, verify: bool, progress: Progress) -> list[int]:
    missing = []
    for index in range(spec.count):
        done = read_done(sequence_folder(out, index), verify=verify)
        if done is None or done.job != spec.job_hash(index):
            missing.append(index)
            if done is not None or verify:
                shutil.rmtree(sequence_folder(out, index), ignore_errors=True)
        else:
            progress.add(done)
            progress.found += 1
    return missing


@contextlib.contextmanager
def _client(spec: Spec, workers: int | None, scheduler: str | None) -> Iterator[tuple[Any, int]]:
    """Yield a client, and the threads that each sequence may use."""
    import dask
    from distributed import Client, LocalCluster
    from distributed.utils import silence_logging_cmgr

    cores = os.cpu_count() or 1
    count = workers or max(1, cores // 2)
    threads = max(1, cores // count)
    settings = {
        # Workers that die are replaced; a sequence that kills one after the other is given up by the rounds.
        "distributed.scheduler.allowed-failures": 10,
        "distributed.worker.multiprocessing-method": "spawn",
        "distributed.admin.large-graph-warning-threshold": "100MB",
    }
    with contextlib.ExitStack() as stack:
        stack.enter_context(dask.config.set(settings))
        stack.enter_context(silence_logging_cmgr(logging.CRITICAL))  # a lost connection is told in one sentence
        if scheduler is None:
            cluster = stack.enter_context(
                LocalCluster(
                    n_workers=count, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1",
                    silence_logs=logging.CRITICAL,
                )
            )  # fmt: skip
            client = stack.enter_context(Client(cluster))
        else:
            try:
                client = stack.enter_context(Client(scheduler, timeout="10s"))
            except (OSError, ValueError, TimeoutError) as error:
                raise InputError(f"{scheduler}: no scheduler of Dask answers ({error})") from None
            threads = 1
        client.register_plugin(_plugin(spec.name, threads))
        yield client, threads


def _plugin(specification: str, threads: int) -> Any:
    from distributed.diagnostics.plugin import WorkerPlugin

    class Plugin(KernelCaches, WorkerPlugin):
        pass

    return Plugin(specification, threads)


def _compile(client: Any, spec: Spec, index: int, threads: int) -> None:
    """Let one worker, as soon as there is one, compile what the first sequence needs; the others then find it."""
    try:
        client.submit(run_briefly, spec, index, threads, pure=False).result()
    except InputError as error:
        raise InputError(f"sequence {index}: {error}") from None
    except CancelledError:
        raise SchedulerLostError(_LOST) from None
    except Exception:  # a worker that died, say: the rounds try again, and tell what remains
        return


def run_briefly(spec: Spec, index: int, threads: int) -> None:
    """Run two frames of a sequence on a worker, in a folder of no importance."""
    short = replace(spec, run=spec.run | {"frame_count": 2, "duration_s": None}, reject=type(spec.reject)(attempts=1))
    with tempfile.TemporaryDirectory(prefix="clsim-warm-") as folder:
        run_task(short, index, folder, threads)


def run_task(spec: Spec, index: int, out: str, threads: int) -> Done:
    """Make a sequence on a worker of Dask, with kernels that all workers share."""
    from distributed import get_worker

    caches: Any = get_worker().plugins[KernelCaches.name]
    with caches.shared():
        return run_job(spec, index, out, threads)


def _round(
    client: Any, spec: Spec, out: Path, missing: list[int], threads: int, progress: Progress,
    tell: Callable[[Progress], None],
) -> list[int]:  # fmt: skip
    """Make the missing ones, a few ahead of the workers that there are by then; returns those to try again."""
    from distributed import as_completed

    waiting = iter(missing)
    of: dict[Any, int] = {}
    again: list[int] = []
    running = as_completed()
    workers, asked_s = 0, -math.inf

    def submit() -> None:
        nonlocal workers, asked_s
        if time.monotonic() - asked_s > _ASK_S:
            workers, asked_s = len(client.scheduler_info(n_workers=-1)["workers"]), time.monotonic()
        for index in itertools.islice(waiting, max(0, _AHEAD * max(1, workers) - len(of))):
            key = f"clsim-{spec.job_hash(index)}-{uuid.uuid4()}"  # tasks of one key are made once
            future = client.submit(run_task, spec, index, str(out), threads, key=key)
            of[future] = index
            running.add(future)

    submit()
    for future in running:
        index = of.pop(future)
        try:
            done: Done = future.result()
        except CancelledError:
            raise SchedulerLostError(_LOST) from None
        except Exception as error:  # of ours, of Dask's (a worker died too often), or a defect: all are told
            progress.failures[index] = f"{type(error).__name__}: {error}"
            if not isinstance(error, InputError):  # which would come again
                again.append(index)
        else:
            progress.failures.pop(index, None)
            progress.add(done)
            progress.new += done.kept
            progress.cpu_s += done.cost["cpu_s"]
        tell(progress)
        future.release()
        submit()
    return again
