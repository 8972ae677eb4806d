"""Kill a data set's making at random moments, many times, and compare what comes of it with an undisturbed run.

python tools/accuracy/dataset_kills.py SPEC FOLDER [--count 20] [--kills 20] [--workers 2] [--apart] [--seed 0]

Kills with SIGKILL the client, in which the scheduler lives, or one of its workers. With --apart, the scheduler and the
workers' nannies are processes of their own, and are killed too. Prints a line for each kill. No sequence that was whole
at a kill may be made again, and in the end all files must be those of the undisturbed run.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import random
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import psutil

_RUN_S = 1800.0
_LOST = 1
"""Exit status of a client whose scheduler has gone."""


@dataclass
class Making:
    """A run of ``clsim dataset``; with ``apart``, on a scheduler and workers of their own.

    Attributes:
        spec: bundled name or file.
        folder: where to.
        workers: how many.
        count: sequences; None is the specification's.
        apart: whether they are processes of their own.
    """

    spec: str
    folder: Path
    workers: int
    count: int | None = None
    apart: bool = False
    _scheduler: subprocess.Popen[bytes] | None = field(default=None, repr=False)
    _nannies: list[subprocess.Popen[bytes]] = field(default_factory=list, repr=False)

    def start(self) -> None:
        """Start all processes."""
        command = ["clsim", "dataset", self.spec, "--out", str(self.folder)]
        command += [] if self.count is None else ["--count", str(self.count)]
        if self.apart:
            with socket.create_server(("127.0.0.1", 0)) as free:
                self._address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
            own = ["--host", "127.0.0.1", "--port", self._address.rpartition(":")[2], "--no-dashboard"]
            self._scheduler = _python("distributed.cli.dask_scheduler", *own)
            self._nannies = [self._nanny() for _ in range(self.workers)]
            self.client = _python(*command, "--scheduler", self._address)
        else:
            self.client = _python(*command, "--workers", str(self.workers))

    def _nanny(self) -> subprocess.Popen[bytes]:
        return _python("distributed.cli.dask_worker", self._address, "--nthreads", "1", "--no-dashboard")

    def victims(self) -> dict[str, list[psutil.Process]]:
        """Return the processes that may be killed, by what they are."""
        found = {"client" if self.apart else "client and scheduler": [psutil.Process(self.client.pid)]}
        parents = self._nannies if self.apart else [self.client]
        if self._scheduler is not None:
            found["scheduler"] = [psutil.Process(self._scheduler.pid)]
            found["nanny"] = [psutil.Process(each.pid) for each in parents]
        found["worker"] = [each for parent in parents for each in _spawned(parent.pid)]
        return {kind: processes for kind, processes in found.items() if processes}

    def replace_nannies(self) -> None:
        """Start others for those that were killed."""
        self._nannies = [each if each.poll() is None else self._nanny() for each in self._nannies]

    def end(self) -> int:
        """Wait for the client; then end what is left of the cluster. Returns the client's exit status."""
        status = self.client.wait(_RUN_S)
        for each in [*self._nannies, *([self._scheduler] if self._scheduler is not None else [])]:
            each.kill()
            each.wait()
        return status


def _python(module: str, *options: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", module, *options]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)


def _spawned(pid: int) -> list[psutil.Process]:
    """Return the workers under a process; Python's resource trackers are none."""
    found = []
    with contextlib.suppress(psutil.Error):
        for each in psutil.Process(pid).children(recursive=True):
            if "spawn_main" in " ".join(each.cmdline()):
                found.append(each)
    return found


def finish(making: Making) -> float:
    """Let a run end, and return how long it took [s]."""
    begun_s = time.monotonic()
    making.start()
    status = making.end()
    if status != 0:
        raise SystemExit(f"a run ended with status {status}")
    return time.monotonic() - begun_s


def kill_often(making: Making, kills: int, seed: int, longest_s: float) -> list[str]:
    """Kill so often, at most ``longest_s`` apart, then let it end; returns what was killed."""
    chance = random.Random(seed)
    killed: list[str] = []
    whole: dict[str, int] = {}
    while len(killed) < kills:
        making.start()
        for kind in _kill_until_it_ends(making, chance, longest_s, kills - len(killed)):
            killed.append(kind)
            whole = _still_whole(making.folder, whole)
            print(f"kill {len(killed)}: {kind}; {len(whole)} sequences are whole", flush=True)
        status = making.end()
        if status == 0 and len(killed) < kills:
            longest_s *= 0.7  # it was done before
            _still_whole(making.folder, whole)
            whole = {}
            for each in (making.folder / "sequences").iterdir():
                (each / "job.json").unlink()
        elif status not in (0, _LOST, -9):
            raise SystemExit(f"a run ended with status {status}")
    finish(making)
    _still_whole(making.folder, whole)
    return killed


def _kill_until_it_ends(making: Making, chance: random.Random, longest_s: float, most: int) -> Iterator[str]:
    for _ in range(most):
        with contextlib.suppress(subprocess.TimeoutExpired):
            making.client.wait(chance.uniform(min(1.0, longest_s), longest_s))
            return
        victims = making.victims()
        kind = chance.choice(sorted(victims))
        orphans = victims.get("worker", []) if kind != "worker" else []
        with contextlib.suppress(psutil.NoSuchProcess):
            chance.choice(victims[kind]).kill()
            yield kind
        if kind != "worker":
            # Workers end by themselves when their nanny has gone, and may still be writing; half of them are not let.
            for each in orphans:
                if chance.random() < 0.5:
                    with contextlib.suppress(psutil.NoSuchProcess):
                        each.kill()
        if kind == "nanny":
            making.replace_nannies()
        elif kind != "worker":
            return


def _still_whole(folder: Path, before: dict[str, int]) -> dict[str, int]:
    """Return when each whole sequence was made, by its name; those that were whole before must be the same ones."""
    found = {path.parent.name: path.stat().st_mtime_ns for path in folder.glob("sequences/*/job.json")}
    made_again = sorted(name for name, made_ns in before.items() if found.get(name) != made_ns)
    if made_again:
        raise SystemExit(f"lost or made again: sequences {', '.join(made_again)}")
    return found


def contents(folder: Path) -> dict[str, str]:
    """Return the hash of every file, by name; of job.json less its cost. The manifest has times, and stays out."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.name != "manifest.parquet":
            data = path.read_bytes()
            if path.name == "job.json":
                told = json.loads(data)
                del told["cost"]
                data = json.dumps(told).encode()
            found[str(path.relative_to(folder))] = hashlib.sha256(data).hexdigest()
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("spec")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--count", type=int)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--apart", action="store_true")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    undisturbed = Making(given.spec, given.folder / "undisturbed", given.workers, given.count)
    whole_s = finish(undisturbed)
    print(f"undisturbed: {whole_s:.0f} s", flush=True)
    killed = Making(given.spec, given.folder / "killed", given.workers, given.count, given.apart)
    begun_s = time.monotonic()
    kill_often(killed, given.kills, given.seed, whole_s / 2)
    print(f"killed {given.kills} times: {time.monotonic() - begun_s:.0f} s", flush=True)
    expected, found = contents(undisturbed.folder), contents(killed.folder)
    differ = sorted(name for name in expected | found if expected.get(name) != found.get(name))
    print(f"{len(expected)} files, {len(differ)} differ: {', '.join(differ[:5]) or 'none'}")
    raise SystemExit(bool(differ))


if __name__ == "__main__":
    main()
