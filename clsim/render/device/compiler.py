"""How kernels are compiled: with which options, at the same time, and with headers that are read once for all.

Kernels for a CPU include headers that take longer to read than a small kernel takes to compile. Warp precompiles them,
for each set of options, but also for each thread of each process. Here they are stored next to the kernels in Warp's
cache.
"""

from __future__ import annotations

import hashlib
import sys
import threading
from collections.abc import Callable, Sequence
from functools import cache, update_wrapper
from pathlib import Path
from typing import Any, Generic, ParamSpec, TypeVar

import warp as wp

P = ParamSpec("P")
T = TypeVar("T")
_DECLARING = threading.RLock()
_LAUNCHED = 256
"""Threads of a block on a GPU, where a launch does not say."""
_MISTAKEN = "recursion depth mismatch"
_TRIES = 5


def kernel_options() -> dict[str, Any]:
    """Return the compiler's options for kernels that trace rays.

    As if there were no NaN, 1.5 times as fast; and products are added without rounding them first, within a statement
    alone, so that a function's results do not depend on the kernel it is part of.
    """
    flags = f"{wp.config.cpu_compiler_flags} -menable-no-nans -ffp-contract=on -w"
    # The block of a CPU: for another one a kernel would be hashed first, and then once more for this.
    return {"cpu_compiler_flags": flags, "block_dim": 1}


def compile_together(kernels: Sequence[Any], device: Any) -> None:
    """Compile kernels for a device, or load them if that was done before: two at a time, in the order given.

    More at a time would precompile the same headers, each for itself.
    """
    modules = [kernel.module for kernel in kernels]
    # A block as launches ask for it; a CPU's has one thread all the same.
    parsing_again(
        lambda: wp.force_load(device, modules, block_dim=_LAUNCHED, max_workers=min(2, len(kernels))),
    )


def parsing_again(build: Callable[[], T]) -> T:
    """Return what a function returns that parses Python, as Warp does; it is called again where Python is mistaken.

    Before 3.13, Python counts how deep a syntax tree is for all threads together, and may find in one what another did.
    """
    for _ in range(_TRIES - 1):
        try:
            return build()
        except SystemError as error:
            if _MISTAKEN not in str(error):
                raise
    return build()


def one_at_a_time(build: Callable[P, T]) -> Built[P, T]:
    """Return a function that declares kernels: it remembers what it returned, and no two threads are in any at a time.

    Warp notes in one place for all threads what the kernel that is being declared is made of. Two at a time become
    kernels that run, and compute something else.
    """
    return Built(build)


class Built(Generic[P, T]):
    """See `one_at_a_time`."""

    def __init__(self, build: Callable[P, T]) -> None:
        """Take the function that declares them."""
        self._known = cache(build)
        self.cache_clear = self._known.cache_clear
        update_wrapper(self, build)

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> T:
        """Return the kernels for these arguments, which are hashable."""
        with _DECLARING:
            return parsing_again(lambda: self._known(*args, **kwargs))  # type: ignore[arg-type]


def keep_headers() -> None:
    """Let all threads and processes share the headers that Warp, which has started, precompiles.

    Warp has no setting for that. Where it does not look for the folder as this expects, all stays as it was.
    """
    runtime: Any = getattr(sys.modules.get("warp._src.context"), "runtime", None)
    if getattr(runtime, "llvm", None) is not None and hasattr(runtime, "get_clang_pch_dir"):
        runtime.get_clang_pch_dir = _folder


@cache
def _folder() -> str:
    """Return the folder for this compiler, this processor and this copy of Warp; it exists.

    The compiler puts files there whole, by renaming them, so that processes do not disturb each other.
    """
    headers = Path(wp.__file__).parent / "native"
    told = f"{wp.get_cpu_kernel_cache_key()} {headers} {(headers / 'builtin.h').stat().st_mtime_ns}"
    folder = Path(str(wp.config.kernel_cache_dir)) / f"wp_headers_{hashlib.sha256(told.encode()).hexdigest()[:16]}"
    folder.mkdir(parents=True, exist_ok=True)
    return str(folder)
