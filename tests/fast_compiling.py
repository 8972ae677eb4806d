"""How kernels are compiled in half the time; beside nothing else, so that a program may import it at any time."""

from typing import Any


def compile_fast(config: Any) -> None:
    """Let Warp, whose ``config`` is given, compile in half the time; what a kernel computes does not hang on that."""
    config.optimization_level = 1
    # Warp's flags beside these would inline all that is called.
    config.cpu_compiler_flags = "-march=native -fno-vectorize -fno-slp-vectorize"
