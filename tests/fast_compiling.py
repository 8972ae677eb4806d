"""How kernels are compiled in half the time; beside nothing else, so that a program may import it at any time."""

from collections.abc import Sequence
from functools import cache
from typing import Any

_DECLARED = """
typedef unsigned char uchar;
typedef unsigned short ushort;
typedef unsigned int uint;
typedef unsigned long ulong;
typedef __SIZE_TYPE__ size_t;
#define VECTOR(type, n) typedef type type##n __attribute__((ext_vector_type(n)))
VECTOR(int, 8); VECTOR(int, 16); VECTOR(long, 8); VECTOR(long, 16);
VECTOR(float, 8); VECTOR(float, 16); VECTOR(double, 8); VECTOR(double, 16);
#define INT_MAX 0x7fffffff
#define LONG_MAX 0x7fffffffffffffffL
#define INFINITY __builtin_inff()
#define as_int8(x) __builtin_astype((x), int8)
#define as_int16(x) __builtin_astype((x), int16)
#define as_long(x) __builtin_astype((x), long)
#define as_long8(x) __builtin_astype((x), long8)
#define as_long16(x) __builtin_astype((x), long16)
#define as_ulong(x) __builtin_astype((x), ulong)
#define as_float8(x) __builtin_astype((x), float8)
#define as_float16(x) __builtin_astype((x), float16)
#define as_double(x) __builtin_astype((x), double)
#define as_double8(x) __builtin_astype((x), double8)
#define as_double16(x) __builtin_astype((x), double16)
#define PURE __attribute__((overloadable, const))
size_t PURE get_global_id(uint);
#define ONE(name) float PURE name(float); double PURE name(double)
#define TWO(name) float PURE name(float, float); double PURE name(double, double)
ONE(ceil); ONE(exp); ONE(expm1); ONE(fabs); ONE(floor); ONE(log); ONE(log2); ONE(sqrt); ONE(sinh);
TWO(copysign); TWO(fmax); TWO(fmin); TWO(max); TWO(min);
int PURE max(int, int); int PURE min(int, int); int PURE clamp(int, int, int);
float PURE clamp(float, float, float); double PURE clamp(double, double, double);
#undef VECTOR
#undef PURE
#undef ONE
#undef TWO
"""
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
