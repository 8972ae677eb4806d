"""Random numbers and sampling densities, as Warp functions.

Each sample of each pixel has a stream of its own: ``word(d) = mix64((key + d)·γ)`` for dimension d = 0, 1, …, where
the key is a 55-bit hash of (seed, pixel, sample) shifted left by 9. Multiplication by the odd γ and ``mix64`` are
bijections of 64-bit words, so two streams with different keys share no word at all, and words depend on every bit of
seed, pixel and sample. Dimensions are fixed (``DIMENSIONS_PER_BOUNCE`` each bounce), whatever branch a path takes:
frames rendered with common random numbers stay in step where only part of the picture changes.

``mix64`` is David Stafford's variant 13 of the MurmurHash3 finaliser, γ the golden-ratio increment of SplitMix64
(Steele, Lea, Flood, OOPSLA 2014).
"""

import warp as wp

from clsim.render.native import native_code

DIMENSION_BITS = 9
DIMENSIONS_PER_BOUNCE = 4
"""Pairs of uniform numbers set aside for each bounce: light, scattering, light and roulette, lobe and opacity."""
MAX_BOUNCES = 2**DIMENSION_BITS // DIMENSIONS_PER_BOUNCE - 1

CAMERA = wp.constant(0)
LENS = wp.constant(1)
TIME = wp.constant(2)
LIGHT = wp.constant(0)
SCATTER = wp.constant(1)
CHOICE = wp.constant(2)
LOBE = wp.constant(3)

_MASK64 = (1 << 64) - 1
_GAMMA = wp.constant(wp.uint64(0x9E3779B97F4A7C15))
_MIX_A = wp.constant(wp.uint64(0xBF58476D1CE4E5B9))
_MIX_B = wp.constant(wp.uint64(0x94D049BB133111EB))


def stream_state(seed: int, frame: int | None) -> int:
    """Return the hash of a seed, and of a frame's index where each has its own noise, as the kernel goes on with it."""
    state = _mix64(seed + 0x9E3779B97F4A7C15)
    return state if frame is None else _mix64(state + (frame + 1) * 0xD1342543DE82EF95)


def _mix64(x: int) -> int:
    """``mix64`` on the host."""
    x &= _MASK64
    x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9 & _MASK64
    x = (x ^ (x >> 27)) * 0x94D049BB133111EB & _MASK64
    return x ^ (x >> 31)


@wp.func
def mix64(x: wp.uint64) -> wp.uint64:
    """Return a bijective hash of a 64-bit word in which every input bit moves every output bit."""
    a = (x ^ (x >> wp.uint64(30))) * _MIX_A
    b = (a ^ (a >> wp.uint64(27))) * _MIX_B
    return b ^ (b >> wp.uint64(31))


@wp.func
def absorb(state: wp.uint64, value: int) -> wp.uint64:
    """Return the hash state after one more integer."""
    return mix64(state + wp.uint64(value + 1) * _GAMMA)


@wp.func
def stream_key(state: wp.uint64) -> wp.uint64:
    """Return the key of a stream: the hash with its low bits cleared to make room for the dimension."""
    return state << wp.uint64(9)


@wp.func
def stream_word(key: wp.uint64, dimension: int) -> wp.uint64:
    """Return the stream's 64-bit word for that dimension."""
    return mix64((key | wp.uint64(dimension)) * _GAMMA)


@wp.func
def uniform2(key: wp.uint64, dimension: int) -> wp.vec2:
    """Return the stream's pair of uniform numbers in [0, 1) for that dimension."""
    word = stream_word(key, dimension)
    # 24 bits each, the most a float32 in [0, 1) holds without rounding up to 1.
    high = float(wp.int32(word >> wp.uint64(40)))
    low = float(wp.int32((word >> wp.uint64(16)) & wp.uint64(0xFFFFFF)))
    return wp.vec2(high * (1.0 / 16777216.0), low * (1.0 / 16777216.0))


@wp.func
def uniform_of(word: wp.uint64, index: int) -> float:
    """Return a uniform number in [0, 1), one of as many as wanted for one word of the stream."""
    return float(wp.int32(absorb(word, index) >> wp.uint64(40))) * (1.0 / 16777216.0)


@wp.struct
class Stream:
    """A sampler's state, the random numbers of one sample: ``key`` for independent ones, the next two for Sobol's.

    ``row`` is the number of a stored path (`stored_paths.py`).
    """

    key: wp.uint64
    scrambling: wp.uint64
    reversed_index: wp.uint32
    row: int


@wp.func
def pair(stream: Stream, dimension: int) -> wp.vec2:
    """Return ``uniform2`` of the stream."""
    return uniform2(stream.key, dimension)


@wp.func
def tangent_frame(n: wp.vec3) -> wp.mat33:
    """Return a rotation whose columns are two tangents and the unit normal (Duff et al., JCGT 6(1), 2017)."""
    sign = wp.where(n[2] >= 0.0, 1.0, -1.0)
    a = -1.0 / (sign + n[2])
    b = n[0] * n[1] * a
    t = wp.vec3(1.0 + sign * n[0] * n[0] * a, sign * b, -sign * n[0])
    s = wp.vec3(b, sign + n[1] * n[1] * a, -n[1])
    return wp.matrix_from_cols(t, s, n)


@wp.func
def around(u: float) -> wp.vec2:
    """Return cosine and sine of ``u`` whole turns, at least 0 and at most a few, both to 1e-7.

    A library's functions are slower: they serve any angle, and what the caller knows must go to memory meanwhile.
    """
    quarters = 4.0 * u
    quarter = wp.floor(quarters + 0.5)
    x = (quarters - quarter) * (0.5 * wp.pi)
    x2 = x * x
    # Taylor's series; x is at most a quarter of π.
    sine = x * (1.0 + x2 * (-1.0 / 6.0 + x2 * (1.0 / 120.0 + x2 * (-1.0 / 5040.0 + x2 * (1.0 / 362880.0)))))
    cosine = 1.0 + x2 * (-0.5 + x2 * (1.0 / 24.0 + x2 * (-1.0 / 720.0 + x2 * (1.0 / 40320.0))))
    axis = wp.int32(quarter) & 3
    across = wp.where(axis % 2 == 1, sine, cosine)
    up = wp.where(axis % 2 == 1, cosine, sine)
    return wp.vec2(wp.where(axis == 1 or axis == 2, -across, across), wp.where(axis >= 2, -up, up))


@wp.func
def angle_of(sine: float, cosine: float) -> float:
    """Return the angle, 0 to π, of whose sine and cosine the ratio is told, to 3e-7; ``sine`` is at least 0.

    The polynomial is that of Cephes' ``atanf`` (Moshier 1989).
    """
    across = wp.abs(cosine)
    low = wp.min(sine, across)
    high = wp.max(sine, across)
    # Beyond an eighth of π from the nearest axis, by the angle to the diagonal.
    diagonal = low > 0.41421356 * high
    x = wp.where(diagonal, low - high, low) / wp.max(wp.where(diagonal, low + high, high), 1.0e-38)
    x2 = x * x
    found = x + x * x2 * (-0.333329491539 + x2 * (0.199777106478 + x2 * (-0.138776856032 + x2 * 0.0805374449538)))
    found = found + wp.where(diagonal, 0.25 * wp.pi, 0.0)
    found = wp.where(sine > across, 0.5 * wp.pi - found, found)
    return wp.where(cosine < 0.0, wp.pi - found, found)


@wp.func
def cosine_hemisphere(n: wp.vec3, u: wp.vec2) -> wp.vec3:
    """Return a unit direction about ``n`` with density cos θ / π per steradian (Malley's method)."""
    radius = wp.sqrt(u[0])
    turned = around(u[1])
    z = wp.sqrt(wp.max(1.0 - u[0], 0.0))
    # Its length is 1 to 2e-7 already; a division and a root less make paths 5 % faster.
    return tangent_frame(n) * wp.vec3(radius * turned[0], radius * turned[1], z)


@wp.func
def cone(axis: wp.vec3, one_minus_cos: float, u: wp.vec2) -> wp.vec3:
    """Return a unit direction uniform in the cone about ``axis``; 1 − cos of the half angle keeps thin cones exact."""
    h = u[0] * one_minus_cos
    sin_theta = wp.sqrt(wp.max(h * (2.0 - h), 0.0))
    turned = around(u[1])
    return wp.normalize(tangent_frame(axis) * wp.vec3(sin_theta * turned[0], sin_theta * turned[1], 1.0 - h))


@wp.func
def uniform_triangle(u: wp.vec2) -> wp.vec3:
    """Return barycentric weights uniform over a triangle."""
    r = wp.sqrt(u[0])
    return wp.vec3(1.0 - r, r * (1.0 - u[1]), r * u[1])


@wp.func
def power_heuristic(pdf: float, other: float) -> float:
    """Return the MIS weight of a sample drawn with density ``pdf`` (Veach 1997, eq. 9.13, β = 2)."""
    # Written with a ratio so that the squares of large densities do not overflow.
    ratio = other / pdf
    return 1.0 / (1.0 + ratio * ratio)


@wp.func
def luminance(c: wp.vec3) -> float:
    """Return the Rec. 709 luminance of a linear colour."""
    return 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]


@wp.func
def brightness(c: wp.vec3, weights: wp.vec3) -> float:
    """Return what a pixel sees of a linear colour, by its weights of R, G and B."""
    return weights[0] * c[0] + weights[1] * c[1] + weights[2] * c[2]


@wp.func_native(native_code("finite.h"))
def _finite(x: float) -> bool: ...  # type: ignore[empty-body]


@wp.func
def finite(v: wp.vec3) -> bool:
    """Whether no component is NaN or infinite, by the bits: kernels are compiled as if there were no NaN."""
    return _finite(v[0]) and _finite(v[1]) and _finite(v[2])
