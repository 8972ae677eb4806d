"""Where a renderer's time goes: the share of each function in its kernels, inlined ones included.

python -m tools.speed.kernel_profile live two-boxes --resolution 346x260 --frame-count 60

It runs that command of clsim with one thread under ``perf``, with kernels that have line numbers, which are compiled
into a cache of their own. ``nm`` and ``llvm-symbolizer`` then tell the function of each sample, and those that called
it. Printed are the share of each kernel and, for the one with the most samples, that of each function by itself, and
with all it calls.
"""

from __future__ import annotations

import collections
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

_LINES = "-debug-info-kind=line-tables-only -dwarf-version=4"
_LEAST = 0.004
"""Functions below this share are left out."""


def run(arguments: list[str]) -> None:
    """Run clsim and then print, a line each, where the functions of Warp's kernels lie: address, size, file, offset."""
    import warp as wp

    wp.config.quiet = True
    wp.config.cpu_compiler_flags = f"{wp.config.cpu_compiler_flags or ''} {_LINES}".strip()
    wp.init()
    from warp._src.context import runtime

    loaded: list[tuple[str, bytes]] = []

    class Noting:
        """Warp's compiler, which notes what is loaded."""

        def __init__(self, library: object) -> None:
            self.library = library

        def __getattr__(self, name: str) -> object:
            call = getattr(self.library, name)
            if name != "wp_load_obj":
                return call

            def load(path: bytes, handle: bytes, *more: object) -> object:
                loaded.append((path.decode(), handle))
                return call(path, handle, *more)

            return load

    library, runtime.llvm = runtime.llvm, Noting(runtime.llvm)
    from clsim.cli.app import app

    try:
        app(arguments, standalone_mode=False)
    finally:
        with Path(os.environ["CLSIM_PROFILE"]).open("w") as out:
            for path, handle in loaded:
                functions = _functions(path)
                found = next((f for f in functions if library.wp_lookup(handle, f[2].encode())), None)
                if found is not None:
                    base = library.wp_lookup(handle, found[2].encode()) - found[0]
                    for offset, size, name in functions:
                        print(base + offset, size, path, offset, name, file=out)


def _functions(path: str) -> list[tuple[int, int, str]]:
    rows = [line.split() for line in _told("nm", "-S", "--defined-only", path).splitlines()]
    return [(int(row[0], 16), int(row[1], 16), row[3]) for row in rows if len(row) == 4 and row[2] in "tT"]


def _told(*command: str, given: str = "") -> str:
    return subprocess.run(command, input=given, capture_output=True, text=True, check=True).stdout


def _short(name: str) -> str:
    return re.sub(r"_\d+$", "", name.split("(")[0].split("__locals__")[-1])


def main(arguments: list[str]) -> None:
    """Profile a command of clsim."""
    with tempfile.TemporaryDirectory() as folder:
        data, where = f"{folder}/perf.data", f"{folder}/functions"
        environment = os.environ | {"CLSIM_PROFILE": where, "WARP_CACHE_PATH": f"{folder}/warp"}
        mine = [sys.executable, "-m", "tools.speed.kernel_profile", "--run", *arguments, "--threads", "1", "--json"]
        # The first run compiles.
        subprocess.run(mine, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True)
        recorded = ["perf", "record", "-q", "-o", data, "-F", "1000", *mine]
        subprocess.run(recorded, env=environment, stdout=subprocess.DEVNULL, check=True)
        sampled = [int(each, 16) for each in _told("perf", "script", "-i", data, "-F", "ip").split()]
        kernels: dict[tuple[str, str], collections.Counter[int]] = {}
        for line in Path(where).read_text().splitlines():
            start, size, path, offset, name = line.split()
            hits = collections.Counter(
                each - int(start) + int(offset) for each in sampled if 0 <= each - int(start) < int(size)
            )
            kernels[path, name] = hits
        _print_kernels(kernels, len(sampled))
        (path, _), hits = max(kernels.items(), key=lambda item: item[1].total())
        _print(path, hits, len(sampled))


def _print_kernels(kernels: dict[tuple[str, str], collections.Counter[int]], sampled: int) -> None:
    print(f"{'kernel':50}{'of all':>9}")
    for (_, name), hits in sorted(kernels.items(), key=lambda item: -item[1].total()):
        if hits.total() >= _LEAST * sampled:
            print(f"{_short(name):50}{hits.total() / sampled:9.1%}")


def _print(path: str, hits: collections.Counter[int], sampled: int) -> None:
    addresses = sorted(hits)
    symbolizer = ["llvm-symbolizer", f"--obj={path}", "--inlines", "--functions=short", "--output-style=JSON"]
    told = _told(*symbolizer, given="\n".join(map(hex, addresses))).splitlines()
    alone, within = collections.Counter[str](), collections.Counter[str]()
    for address, line in zip(addresses, told, strict=True):
        calls = [(_short(each["FunctionName"]), each["FileName"]) for each in json.loads(line)["Symbol"]]
        # What is Warp's own, such as a sum of vectors, counts for who asked.
        ours = next((name for name, file in calls if "/native/" not in file), calls[0][0])
        alone[ours] += hits[address]
        for each in {name for name, _ in calls}:
            within[each] += hits[address]
    total = hits.total()
    print(f"{total / sampled:.0%} of {sampled} samples (one a millisecond) are in {Path(path).name}")
    print(f"{'function':36}{'alone':>9}{'with all':>10}")
    for function, count in within.most_common():
        if count >= _LEAST * total:
            print(f"{function:36}{alone[function] / total:9.1%}{count / total:10.1%}")


if __name__ == "__main__":
    run(sys.argv[2:]) if sys.argv[1:2] == ["--run"] else main(sys.argv[1:])
