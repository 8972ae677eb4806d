"""Kill a data set's making at random moments, many times, and compare what comes of it with an undisturbed run.

python tools/dataset_kills.py SPEC FOLDER [--kills 20] [--workers 2] [--seed 0]

The client, in which the scheduler lives, or one of its workers is killed with SIGKILL. Prints a line for each kill.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil

_RUN_S = 600.0


def start(spec: str, folder: Path, workers: int) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "clsim", "dataset", spec, "--out", str(folder), "--workers", str(workers)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)


def workers_of(client: subprocess.Popen[bytes]) -> list[psutil.Process]:
    """Return the processes that make sequences: spawned, and none of Python's resource trackers."""
    found = []
    try:
        for each in psutil.Process(client.pid).children(recursive=True):
            if "spawn_main" in " ".join(each.cmdline()):
                found.append(each)
    except psutil.Error:
        pass
    return found


def finish(spec: str, folder: Path, workers: int) -> float:
    """Let a run end, and return how long it took [s]."""
    begun_s = time.monotonic()
    client = start(spec, folder, workers)
    if client.wait(_RUN_S) != 0:
        raise SystemExit(f"a run ended with status {client.returncode}")
    return time.monotonic() - begun_s


def kill_often(spec: str, folder: Path, kills: int, workers: int, seed: int, longest_s: float) -> list[str]:
    """Kill so often, then let it end; returns who was killed."""
    chance = random.Random(seed)
    killed: list[str] = []
    while len(killed) < kills:
        client = start(spec, folder, workers)
        time.sleep(chance.uniform(1.0, longest_s))
        victims = workers_of(client)
        if client.poll() is not None:
            if client.returncode != 0:
                raise SystemExit(f"a run ended with status {client.returncode}")
            longest_s *= 0.7  # it was done before
            for each in (folder / "sequences").iterdir():
                (each / "job.json").unlink()
            continue
        if victims and chance.random() < 0.5:
            victim = chance.choice(victims)
            try:
                victim.kill()
            except psutil.Error:
                continue
            killed.append("a worker")
            time.sleep(chance.uniform(0.0, longest_s / 2))
        if client.poll() is None and len(killed) < kills:
            os.kill(client.pid, signal.SIGKILL)
            killed.append("client and scheduler")
        client.wait()
        for each in victims:  # those that the client leaves end by themselves, and may still be writing
            if chance.random() < 0.5:
                try:
                    each.kill()
                except psutil.Error:
                    continue
        whole = len(list(folder.glob("sequences/*/job.json")))
        print(f"kill {len(killed)}: {killed[-1]}; {whole} sequences are whole", flush=True)
    finish(spec, folder, workers)
    return killed


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
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    whole_s = finish(given.spec, given.folder / "undisturbed", given.workers)
    print(f"undisturbed: {whole_s:.0f} s", flush=True)
    kill_often(given.spec, given.folder / "killed", given.kills, given.workers, given.seed, whole_s)
    expected, found = contents(given.folder / "undisturbed"), contents(given.folder / "killed")
    differ = sorted(name for name in expected | found if expected.get(name) != found.get(name))
    print(f"{len(expected)} files, {len(differ)} differ: {', '.join(differ[:5]) or 'none'}")
    raise SystemExit(bool(differ))


if __name__ == "__main__":
    main()
