"""A cache of kernels for each worker: compilers that share one have been seen to crash each other."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any

_VARIABLE = "XDG_CACHE_HOME"
"""Warp, PoCL and pyopencl all keep their kernels below it."""
_OWN = ("WARP_CACHE_PATH", "POCL_CACHE_DIR", "PYOPENCL_CACHE_DIR")
"""Variables that would lead them elsewhere."""


class KernelCaches:
    """A plugin of Dask's workers: sets each one's cache before anything is compiled, filled from the warm one."""

    name = "clsim-kernels"

    def __init__(self, folder: str, threads: int) -> None:
        """Keep the caches in ``folder``; OpenCL gets so many ``threads`` in each worker."""
        self._folder, self._threads = folder, threads

    def setup(self, worker: Any) -> None:
        """Point this process at its own cache."""
        for variable in _OWN:
            os.environ.pop(variable, None)
        own = Path(self._folder) / f"worker-{worker.name}".replace("/", "_").replace(":", "_")
        os.environ[_VARIABLE] = str(own)
        os.environ["POCL_MAX_PTHREAD_COUNT"] = str(self._threads)
        take_warm(self._folder)


def take_warm(folder: str) -> bool:
    """Fill this process's cache anew from the warm one; False where there is none yet."""
    own, warm = Path(os.environ[_VARIABLE]), Path(folder) / "warm"
    # What a killed worker left may be torn.
    shutil.rmtree(own, ignore_errors=True)
    own.mkdir(parents=True, exist_ok=True)
    if not warm.is_dir():
        return False
    shutil.copytree(warm, own, dirs_exist_ok=True)
    return True


def keep_warm(folder: str) -> None:
    """Keep what this process has compiled for the others."""
    part, warm = Path(folder) / f".warm.{os.getpid()}.part", Path(folder) / "warm"
    shutil.rmtree(part, ignore_errors=True)
    shutil.copytree(os.environ[_VARIABLE], part)
    shutil.rmtree(warm, ignore_errors=True)
    os.rename(part, warm)
