"""Opens a USD file within limits, in a process of its own: ``python -I usd_trial.py FILE SYS_PATH CPU_S BYTES``."""

import contextlib
import json
import resource
import sys

STACK_BYTES = 1 << 22
"""Half of what a thread of Linux has: who opens the file next stands deeper in calls."""


def main(file: str, sys_path: str, cpu_s: str, size: str) -> None:
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
        Usd.Stage.Open(file)


if __name__ == "__main__":
    main(*sys.argv[1:])
