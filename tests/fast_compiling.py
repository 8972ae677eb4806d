"""How kernels are compiled in half the time; beside nothing else, so that a program may import it at any time."""

from collections.abc import Sequence
from functools import cache
from typing import Any

_TYPES = [(name, n) for name in ("int", "long", "float", "double") for n in ("", 8, 16)]
_DECLARED = """
typedef unsigned char uchar; typedef unsigned short ushort; typedef unsigned int uint; typedef unsigned long ulong;
typedef __SIZE_TYPE__ size_t;
#define INT_MAX 0x7fffffff
#define LONG_MAX 0x7fffffffffffffffL
#define INFINITY __builtin_inff()
#define as_ulong(x) __builtin_astype((x), ulong)
#define PURE __attribute__((overloadable, const))
size_t PURE get_global_id(uint);
int PURE max(int, int); int PURE min(int, int); int PURE clamp(int, int, int);
""" + "\n".join(
    [
        *(f"typedef {name} {name}{n} __attribute__((ext_vector_type({n})));" for name, n in _TYPES if n),
        *(f"#define as_{name}{n}(x) __builtin_astype((x), {name}{n})" for name, n in _TYPES),
        *(
            f"{t} PURE {f}({t});"
            for t in ("float", "double")
            for f in ["ceil", "exp", "expm1", "fabs", "floor", "log", "log2", "sqrt"]
        ),
        *(f"{t} PURE {f}({t}, {t});" for t in ("float", "double") for f in ["copysign", "fmax", "fmin", "max", "min"]),
        *(f"{t} PURE clamp({t}, {t}, {t});" for t in ("float", "double")),
        "#undef PURE\n",
    ]
)
"""What kernels use of OpenCL, as PoCL's headers declare it."""


def compile_fast(config: Any) -> None:
    """Let Warp, whose ``config`` is given, compile in half the time; what a kernel computes does not hang on that."""
    config.optimization_level = 1
    # Warp's flags beside these would inline all that is called.
    config.cpu_compiler_flags = "-march=native -fno-vectorize -fno-slp-vectorize"


def declare_little(workplace: Any) -> None:
    """Let PoCL read what kernels use, and not the 18 000 lines that declare all else.

    Given is the module that builds programs.
    """
    build = workplace.built
    if build.__module__ == __name__:  # a worker of pytest's did so when it started
        return

    @cache
    def reads_headers(device: Any) -> bool:
        return "Portable Computing Language" in device.platform.name

    def built(context: Any, text: str, options: Sequence[str] = ()) -> Any:
        if not reads_headers(context.devices[0]):
            return build(context, text, options)
        return build(context, _DECLARED + text, [*options, "-D_OPENCL_H_"])

    workplace.built = built
