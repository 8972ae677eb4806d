"""How kernels are compiled: with which options, at the same time, and with headers that are read once for all.

Kernels for a CPU include headers that take longer to read than a small kernel takes to compile. Warp precompiles them,
for each set of options, but also for each thread of each process anew. Here they are kept beside the kernels in Warp's
cache.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import warp as wp

_LAUNCHED = 256
"""Threads of a block on a GPU, where a launch does not say."""


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
    wp.force_load(device, modules, block_dim=_LAUNCHED, max_workers=min(2, len(kernels)))


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
