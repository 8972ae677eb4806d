"""A cache of kernels for each worker: compilers that share one have been seen to crash each other.

What one worker has compiled is kept in the user's cache, in a folder for each specification, and all others take it
from there before their next sequence. Files come into that folder whole, and are never changed.
"""

from __future__ import annotations

import contextlib
import os
import platform
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from clsim.caches import cache_folder

_VARIABLE = "XDG_CACHE_HOME"
"""Warp and PoCL both keep their kernels below it."""
_OWN = ("WARP_CACHE_PATH", "POCL_CACHE_DIR", "PYOPENCL_CACHE_DIR")
"""Variables that would lead them elsewhere."""
_USERS = "CLSIM_USER_CACHE"
"""Where the user's cache is, for a worker whose caches were moved."""
_COMPILERS = ("warp", "pocl")
_UNFINISHED = ("tempfile_", ".part-")


class KernelCaches:
    """A plugin of Dask's workers: gives each a cache of its own before anything is compiled."""

    name = "clsim-kernels"

    def __init__(self, specification: str, threads: int) -> None:
        """Share kernels among all workers at a ``specification``; OpenCL gets so many ``threads`` in each."""
        self._specification, self._threads = specification, threads

    def setup(self, worker: Any) -> None:
        """Point this process at its own cache, in a folder that Dask removes when the process has ended."""
        users = os.environ.setdefault(_USERS, str(cache_folder().parent))
        for variable in _OWN:
            os.environ.pop(variable, None)
        self._shared = Path(users) / "clsim" / "kernels" / self._specification
        self._own = Path(worker.local_directory) / "kernels"
        os.environ[_VARIABLE] = str(self._own)
        os.environ["POCL_MAX_PTHREAD_COUNT"] = str(self._threads)

    @contextlib.contextmanager
    def shared(self) -> Iterator[None]:
        """Take what others have compiled; give them afterwards what was compiled here.

        Where the user's cache cannot be read or written, all is compiled here.
        """
        with contextlib.suppress(OSError):
            copy_missing(self._shared, self._own)
        try:
            yield
        finally:
            with contextlib.suppress(OSError):
                copy_missing(self._own, self._shared)


def copy_missing(source: Path, target: Path) -> int:
    """Copy the kernels that ``target`` lacks, each file whole or not at all; returns how many files were copied."""
    copied = 0
    for compiler in _COMPILERS:
        for folder, _, names in os.walk(source / compiler):
            place = target / Path(folder).relative_to(source)
            there = set(os.listdir(place)) if place.is_dir() else set()
            for name in sorted(set(names) - there):
                if name.startswith(_UNFINISHED):
                    continue
                place.mkdir(parents=True, exist_ok=True)
                part = place / f".part-{platform.node()}-{os.getpid()}-{name}"
                shutil.copyfile(Path(folder) / name, part)
                os.replace(part, place / name)
                copied += 1
    return copied
