"""Rays against an 8-wide tree on a CPU: the nearest hit and any hit, as Warp functions in native code.

A node's eight boxes are tested at once with the compiler's vector types, and so are the triangles of a leaf, up to
eight. ``clsim.render.bvh8`` has the tree, and ``bvh8_list`` what is searched in place of a small one.

No ray slips between triangles that share an edge. The edge functions are those of Woop, Benthin, Wald (JCGT 2(1),
2013): equal vertices are translated and sheared to equal numbers, the two products of an edge function are rounded on
their own (no fused multiply-add), so that the two sides of an edge get values that differ in sign alone, and 0 counts
for both. Boxes are tested with a slack that is a bound on all roundings, of the box test and of the triangle test: each
is at most 2^-24 of the largest coordinate, and there are fewer than 16 of them (the bound takes the place of the factor
1 + 2γ of Ize, JCGT 2(2), 2013, and allows the fused form of the slab test).

Results are bits in integers: the code around is compiled as if there were no NaN, and an index may look like one.
"""

import warp as wp

from clsim.render.bvh8_list import ANY_IN_LIST, BLOCK_FLOATS, CLOSEST_IN_LIST

MAX_DEPTH = 20
"""Most nodes on a way from the root to a leaf, both ends included; the builder keeps to it (see ``bvh8``)."""
NODE_FLOATS = 56
"""A node: lower x, y, z and upper x, y, z of eight boxes each, then eight children."""
LEAF_TRIANGLES = 8
CORNER_FLOATS = 10
"""A triangle in its leaf: three corners and its number. A leaf has a row of each for all its triangles."""
FIRST_NUMBER = 0x3F000000
"""Added to a triangle's number, so that as a float, which reading a row too wide makes it, it is an ordinary one."""

# What both searches share. A child that is not negative is a node, in units of 32 bytes; of a negative one the
# complement is a leaf: eight times the first triangle, plus the number of triangles less one. A missing child is the
# leaf behind the last, without extent: a ray of NaN may go there, and must find memory.
# Casts are C's, because Warp defines int(x) and float(x) as macros.
_COMMON = """
    typedef float v8 __attribute__((ext_vector_type(8)));
    typedef float unaligned8 __attribute__((ext_vector_type(8), aligned(4)));
    typedef int lanes8 __attribute__((ext_vector_type(8)));
    typedef bool bits8 __attribute__((ext_vector_type(8)));

    const unsigned long long* tree = (const unsigned long long*)handle;
    const float* nodes = (const float*)tree[0];
    const float* corners = (const float*)tree[1];
    const float extent = *(const float*)&tree[2];
    const int blocks = (int)tree[3];

    const auto lesser = [](v8 a, v8 b) __attribute__((always_inline)) { return a < b ? a : b; };
    const auto greater = [](v8 a, v8 b) __attribute__((always_inline)) { return a > b ? a : b; };
    const auto mask = [](lanes8 a) __attribute__((always_inline)) {
        return (unsigned)__builtin_bit_cast(unsigned char, __builtin_convertvector(a, bits8));
    };
"""

_SEARCH = """
    float size = extent, longest = 0.0f;
    int kz = 0;
    for (int k = 0; k < 3; ++k) {
        const float o = __builtin_fabsf(origin[k]), d = __builtin_fabsf(direction[k]);
        size = o > size ? o : size;
        kz = d > longest ? k : kz;
        longest = d > longest ? d : longest;
    }
    const int kx = kz == 2 ? 0 : kz + 1, ky = kx == 2 ? 0 : kx + 1;

    int near_row[3], far_row[3];
    float inverse[3], near_shift[3], far_shift[3];
    for (int k = 0; k < 3; ++k) {
        // A ray along an axis never leaves the slabs of the others: a steep, finite slope says the same without NaN.
        const float least = 1.0e-18f * longest;
        const float d = __builtin_fabsf(direction[k]) < least ? __builtin_copysignf(least, direction[k]) : direction[k];
        const float r = 1.0f / d, slack = 0x1p-20f * size * __builtin_fabsf(r);
        inverse[k] = r;
        near_shift[k] = -origin[k] * r - slack;
        far_shift[k] = -origin[k] * r + slack;
        near_row[k] = r < 0.0f ? 8 * k + 24 : 8 * k;
        far_row[k] = r < 0.0f ? 8 * k : 8 * k + 24;
    }
    const float sz = inverse[kz], sx = direction[kx] * sz, sy = direction[ky] * sz;

    // Boxes that the ray meets between t_min and far, and where.
    const auto boxes = [&](const float* node, v8& enter) __attribute__((always_inline)) {
        const auto plane = [&](int row, int k, float shift) __attribute__((always_inline)) {
            return *(const v8*)(node + row) * v8(inverse[k]) + v8(shift);
        };
        const v8 x0 = plane(near_row[0], 0, near_shift[0]), x1 = plane(far_row[0], 0, far_shift[0]);
        const v8 y0 = plane(near_row[1], 1, near_shift[1]), y1 = plane(far_row[1], 1, far_shift[1]);
        const v8 z0 = plane(near_row[2], 2, near_shift[2]), z1 = plane(far_row[2], 2, far_shift[2]);
        enter = greater(greater(x0, y0), greater(z0, v8(t_min)));
        return mask(enter <= lesser(lesser(x1, y1), lesser(z1, v8(far))));
    };
    const auto fetch = [&](int child) __attribute__((always_inline)) {
        const float* p = child >= 0 ? nodes + 8 * (long long)child : corners + CORNER_FLOATS * (long long)(~child >> 3);
        for (int line = 0; line < 4; ++line) __builtin_prefetch(p + 16 * line);
    };
    // Triangles of a leaf that the ray meets between t_min and far, where, and the weights of vertices 0 and 1.
    const auto leaf = [&](int first, int count, v8& t, v8& u, v8& v) __attribute__((always_inline)) {
        const float* block = corners + CORNER_FLOATS * (long long)first;
        const int corner = 3 * count;
        const auto row = [&](int i, int k) __attribute__((always_inline)) {
            return v8(*(const unaligned8*)(block + k * count + i * corner)) - v8(origin[k]);
        };
        const auto shear = [](v8 a, float s, v8 z) __attribute__((always_inline)) {
            return __builtin_elementwise_fma(v8(-s), z, a);
        };
        const v8 az = row(0, kz), bz = row(1, kz), cz = row(2, kz);
        const v8 ax = shear(row(0, kx), sx, az), ay = shear(row(0, ky), sy, az);
        const v8 bx = shear(row(1, kx), sx, bz), by = shear(row(1, ky), sy, bz);
        const v8 cx = shear(row(2, kx), sx, cz), cy = shear(row(2, ky), sy, cz);
        v8 w;
        {
            #pragma clang fp contract(off)
            u = cx * by - cy * bx;
            v = ax * cy - ay * cx;
            w = bx * ay - by * ax;
        }
        const v8 sum = u + v + w;
        const lanes8 inside = (lesser(lesser(u, v), w) >= v8(0.0f)) | (greater(greater(u, v), w) <= v8(0.0f));
        unsigned met = mask(inside & (sum != v8(0.0f))) & ((1u << count) - 1u);
        if (met) {
            const v8 scale = v8(1.0f) / sum;
            t = (u * az + v * bz + w * cz) * (scale * v8(sz));
            u *= scale;
            v *= scale;
            met &= mask((t >= v8(t_min)) & (t <= v8(far)));
        }
        return met;
    };
"""

_CLOSEST = """
    // An entry is where the ray enters, as bits, which sort as the numbers do from 0 on, and below them the child.
    unsigned long long stack[STACK];
    int top = 0, child = 0, nearest_count = 0;
    const float* nearest = nullptr;
    float nearest_u = 0.0f, nearest_v = 0.0f;
    for (;;) {
        if (child >= 0) {
            const float* node = nodes + 8 * (long long)child;
            const unsigned* children = (const unsigned*)(node + 48);
            alignas(32) unsigned enter[8];
            unsigned met = boxes(node, *(v8*)enter);
            if (met) {
                const auto entry = [&](int i) __attribute__((always_inline)) {
                    fetch((int)children[i]);
                    return (unsigned long long)enter[i] << 32 | children[i];
                };
                unsigned long long first = entry(__builtin_ctz(met));
                met &= met - 1;
                // The others go to the stack, the farthest first; the nearest is kept in hand.
                const int base = top;
                for (; met; met &= met - 1) {
                    const unsigned long long other = entry(__builtin_ctz(met));
                    const unsigned long long later = other > first ? other : first;
                    first = other > first ? first : other;
                    int at = top++;
                    for (; at > base && stack[at - 1] < later; --at) stack[at] = stack[at - 1];
                    stack[at] = later;
                }
                child = (int)first;
                continue;
            }
        } else {
            const int first = ~child >> 3, count = (~child & 7) + 1;
            alignas(32) float t[8], u[8], v[8];
            unsigned met = leaf(first, count, *(v8*)t, *(v8*)u, *(v8*)v);
            for (; met; met &= met - 1) {
                const int i = __builtin_ctz(met);
                if (t[i] < far) {
                    far = t[i];
                    nearest = corners + CORNER_FLOATS * (long long)first + i;
                    nearest_count = count;
                    nearest_u = u[i];
                    nearest_v = v[i];
                }
            }
        }
        const unsigned far_bits = __builtin_bit_cast(unsigned, far);
        do {
            if (top == 0) {
                wp::vec_t<16, int32_t> hit;
                hit[0] = -1;
                if (nearest) {
                    const int* row = (const int*)nearest;
                    hit[0] = row[9 * nearest_count] - FIRST_NUMBER;
                    hit[1] = __builtin_bit_cast(int, far);
                    hit[2] = __builtin_bit_cast(int, nearest_u);
                    hit[3] = __builtin_bit_cast(int, nearest_v);
                    float e[3], f[3];
                    for (int k = 0; k < 9; ++k) hit[4 + k] = row[k * nearest_count];
                    for (int k = 0; k < 3; ++k) {
                        const float a = nearest[k * nearest_count];
                        e[k] = nearest[(3 + k) * nearest_count] - a;
                        f[k] = nearest[(6 + k) * nearest_count] - a;
                    }
                    const float n[3] = {
                        e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]
                    };
                    const float length = __builtin_sqrtf(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
                    for (int k = 0; k < 3; ++k) hit[13 + k] = __builtin_bit_cast(int, n[k] / length);
                }
                return hit;
            }
            --top;
        } while ((unsigned)(stack[top] >> 32) > far_bits);
        child = (int)stack[top];
    }
"""

_ANY = """
    int stack[STACK];
    int top = 0, child = 0;
    for (;;) {
        if (child >= 0) {
            const float* node = nodes + 8 * (long long)child;
            const int* children = (const int*)(node + 48);
            v8 enter;
            for (unsigned met = boxes(node, enter); met; met &= met - 1) stack[top++] = children[__builtin_ctz(met)];
        } else {
            v8 t, u, v;
            if (leaf(~child >> 3, (~child & 7) + 1, t, u, v)) return true;
        }
        if (top == 0) return false;
        child = stack[--top];
    }
"""


def _native(snippet: str) -> str:
    sizes = {
        "STACK": 7 * MAX_DEPTH + 1,
        "BLOCK_FLOATS": BLOCK_FLOATS,
        "CORNER_FLOATS": CORNER_FLOATS,
        "FIRST_NUMBER": FIRST_NUMBER,
    }
    for name, value in sizes.items():
        snippet = snippet.replace(name, str(value))
    return snippet


TreeHit = wp.types.vector(length=16, dtype=wp.int32)


@wp.func_native(_native(_COMMON + CLOSEST_IN_LIST + _SEARCH + _CLOSEST))
def closest_in_tree(handle: wp.uint64, origin: wp.vec3, direction: wp.vec3, t_min: float, far: float) -> TreeHit:
    """Return triangle (−1: none) and bits: of t, the weights of vertices 0 and 1, the vertices and the unit normal.

    t is in [t_min, far), and t_min is not negative. The vertices are at hand here, and far away in memory for whoever
    needs them next.
    """
    ...


@wp.func_native(_native(_COMMON + ANY_IN_LIST + _SEARCH + _ANY))
def any_in_tree(handle: wp.uint64, origin: wp.vec3, direction: wp.vec3, t_min: float, far: float) -> bool:
    """Return whether the ray meets a triangle at a t in [t_min, far]."""
    ...
