"""Opens a USD file within limits, in a process of its own: ``python -I trial.py FILE SYS_PATH CPU_S BYTES CODE``.

Where the file refers to one that is neither a folder nor an ordinary file, it exits with that code, and the name is on
standard output.
"""

import contextlib
import json
import os
import resource
import sys
from typing import Any

STACK_BYTES = 1 << 22
"""Half of what a thread of Linux has: who opens the file next stands deeper in calls."""


def main(file: str, sys_path: str, cpu_s: str, size: str, not_ordinary: str) -> None:
    """Open a file; the process ends by a signal or an error where that takes too much."""
    sys.path[:] = json.loads(sys_path)
    for kind, most in (
        (resource.RLIMIT_CPU, int(cpu_s)),
        (resource.RLIMIT_AS, int(size)),
        (resource.RLIMIT_STACK, STACK_BYTES),
        (resource.RLIMIT_CORE, 0),
    ):
        hard = resource.getrlimit(kind)[1]
        limit = most if hard == resource.RLIM_INFINITY else min(most, hard)
        with contextlib.suppress(ValueError):  # macOS has no bound on memory
            resource.setrlimit(kind, (limit, hard))
    from pxr import Tf, Usd

    with contextlib.suppress(Tf.ErrorException):  # who opens it next tells the user
        layers = _layers(file, int(not_ordinary))
        Usd.Stage.Open(file)
        del layers


def _layers(file: str, not_ordinary: int) -> list[Any]:
    """Return a file's layers, which are not read again while they are kept; exit where one would be waited for."""
    from pxr import Sdf, Tf, UsdUtils

    waiting, known, layers = [file], set(), []
    while waiting:
        name = waiting.pop()
        outer = name.partition("[")[0]  # of what lies in a package
        if os.path.exists(outer) and not (os.path.isfile(outer) or os.path.isdir(outer)):
            print(outer, end="", flush=True)
            os._exit(not_ordinary)
        if name not in known:
            known.add(name)
            with contextlib.suppress(Tf.ErrorException):
                layer = Sdf.Layer.FindOrOpen(name)
                layers.append(layer)
                # Beside what composes a stage, value clips, which are opened only when a time is asked for.
                named = {each for kind in UsdUtils.ExtractExternalReferences(name) for each in kind} if layer else ()
                waiting += [Sdf.ComputeAssetPathRelativeToLayer(layer, each) for each in named if each]
    return layers


if __name__ == "__main__":
    main(*sys.argv[1:])
