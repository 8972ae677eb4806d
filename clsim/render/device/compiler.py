"""How kernels are compiled: with which options, at the same time, and with headers that are read once for all.

Kernels for a CPU include headers that take longer to read than a small kernel takes to compile. Warp precompiles them,
for each set of options, but also for each thread of each process. Here they are stored next to the kernels in Warp's
cache. Where they are not there yet, reading begins while kernels are declared.
"""

from __future__ import annotations

import contextlib
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
_precompiling: list[threading.Thread] = []


def kernel_options() -> dict[str, Any]:
    """Return the compiler's options for kernels that trace rays.

    As if there were no NaN, 1.5 times as fast; and products are added without rounding them first, within a statement
    alone, so that a function's results do not depend on the kernel it is part of.
    """
    how = "-menable-no-nans -ffp-contract=on"
    # Headers take two thirds of the time without numbers that no kernel here has; kernels, a tenth less without names.
    quickly = "-DWP_NO_BFLOAT16 -discard-value-names -w"
    flags = f"{wp.config.cpu_compiler_flags} {how} {quickly}"
    # The block of a CPU: for another one a kernel would be hashed first, and then once more for this.
    return {"cpu_compiler_flags": flags, "block_dim": 1}


def compile_together(kernels: Sequence[Any], device: Any) -> None:
    """Compile kernels for a device, or load them if that was done before: two at a time, in the order given."""
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
        runtime.get_clang_pch_dir = _folder_of_headers


@cache
def precompile_headers(device: str) -> None:
    """Begin to precompile the headers for a device, which is a CPU, in a thread of its own, unless they are there.

    What compiles a kernel meanwhile waits for them, and does not precompile its own.
    """
    if device == "cpu" and not any(_folder().glob("*.pch")):
        _precompiling.append(threading.Thread(target=_compile_nothing, name="headers"))
        _precompiling[0].start()


def _compile_nothing() -> None:
    """Compile an empty kernel, for which Warp precompiles the headers of all."""
    # What cannot be written here cannot be written for a kernel of the run either, which says so.
    with contextlib.suppress(Exception):
        wp.load_module(_declare_nothing().module, "cpu", block_dim=_LAUNCHED)


@one_at_a_time
def _declare_nothing() -> Any:
    @wp.kernel(module="unique", enable_backward=False, module_options=kernel_options())  # type: ignore[untyped-decorator]
    def nothing() -> None:
        pass

    return nothing


def _folder_of_headers() -> str:
    """Return the folder, once nothing is written there that was begun here."""
    for thread in _precompiling:
        if thread is not threading.current_thread():
            thread.join()
    return str(_folder())


@cache
def _folder() -> Path:
    """Return the folder for this compiler, this processor, this copy of Warp and these options; it exists.

    The compiler puts files there whole, by renaming them, so that processes do not disturb each other.
    """
    headers = Path(wp.__file__).parent / "native"
    options = kernel_options()["cpu_compiler_flags"], wp.config.optimization_level
    told = f"{wp.get_cpu_kernel_cache_key()} {headers} {(headers / 'builtin.h').stat().st_mtime_ns} {options}"
    folder = Path(str(wp.config.kernel_cache_dir)) / f"wp_headers_{hashlib.sha256(told.encode()).hexdigest()[:16]}"
    folder.mkdir(parents=True, exist_ok=True)
    return folder
