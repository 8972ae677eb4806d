"""Owen-scrambled Sobol points, as Warp functions.

Each pair of dimensions takes the first two dimensions of Sobol's sequence, the order of its points and their
coordinates scrambled independently ("padding"; Burley, Practical Hash-based Owen Scrambling, JCGT 9(4), 2020). The
second one's generator matrix is Pascal's triangle modulo 2, whose product with a number takes five steps. The hash in
which a bit depends on lower bits alone is Laine and Karras's (EGSR 2011) with the constants of Vegdahl ("Building a
Better LK Hash", 2021).
"""

from typing import Any

import warp as wp

from clsim.render.native import native_code
from clsim.render.sampling.sampling import Stream, mix64, pair, stream_word

_OTHER = wp.constant(wp.uint64(0x9E6C63D0876A9A62))


@wp.func_native(native_code("reverse_bits.h"))
def _reverse_bits(x: wp.uint32) -> wp.uint32: ...  # type: ignore[empty-body]


@wp.func
def reverse_bits(x: wp.uint32) -> wp.uint32:
    """Return the number with its first bit last."""
    return _reverse_bits(x)


@wp.func
def scramble_reversed(x: wp.uint32, seed: wp.uint32) -> wp.uint32:
    """Return Owen's nested uniform scrambling of a number whose bits stand in reverse order."""
    a = x ^ (x * wp.uint32(0x3D20ADEA))
    b = (a + seed) * ((seed >> wp.uint32(16)) | wp.uint32(1))
    c = b ^ (b * wp.uint32(0x05526C56))
    return c ^ (c * wp.uint32(0x53A22864))


@wp.func
def pascal(x: wp.uint32) -> wp.uint32:
    """Return the product of Pascal's triangle modulo 2 and a number's bits."""
    a = x ^ ((x >> wp.uint32(1)) & wp.uint32(0x55555555))
    b = a ^ ((a >> wp.uint32(2)) & wp.uint32(0x33333333))
    c = b ^ ((b >> wp.uint32(4)) & wp.uint32(0x0F0F0F0F))
    d = c ^ ((c >> wp.uint32(8)) & wp.uint32(0x00FF00FF))
    return d ^ (d >> wp.uint32(16))


@wp.func
def _unit(reversed_bits: wp.uint32) -> float:
    """Return the number in [0, 1), a multiple of 2⁻²⁴ as all random numbers are."""
    return float(wp.int32(reverse_bits(reversed_bits) >> wp.uint32(8))) * (1.0 / 16777216.0)


@wp.func
def sobol2(stream: Stream, dimension: int) -> wp.vec2:
    """Return the stream's pair of numbers for that dimension."""
    word = stream_word(stream.scrambling, dimension)
    other = mix64(word ^ _OTHER)
    index = reverse_bits(scramble_reversed(stream.reversed_index, wp.uint32(word)))
    return wp.vec2(
        _unit(scramble_reversed(index, wp.uint32(word >> wp.uint64(32)))),
        _unit(scramble_reversed(pascal(index), wp.uint32(other >> wp.uint64(32)))),
    )


def make_sampler(sobol: bool) -> Any:
    """Return the Warp function ``uniform2(stream, dimension)``."""
    return sobol2 if sobol else pair
