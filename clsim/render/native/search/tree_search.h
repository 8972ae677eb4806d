// What the search for the nearest hit and that for any hit share: a node's boxes, a leaf's triangles.
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
    near_row[k] = r < 0.0f ? CHILDREN * (k + 3) : CHILDREN * k;
    far_row[k] = r < 0.0f ? CHILDREN * k : CHILDREN * (k + 3);
}
const float sz = inverse[kz], sx = direction[kx] * sz, sy = direction[ky] * sz;

// Boxes that the ray meets between t_min and far, and where.
const auto boxes = [&](const float* node, v16& enter) __attribute__((always_inline)) {
    const auto plane = [&](int first, int k, float shift) __attribute__((always_inline)) {
        return *(const v16*)(node + first) * v16(inverse[k]) + v16(shift);
    };
    const v16 x0 = plane(near_row[0], 0, near_shift[0]), x1 = plane(far_row[0], 0, far_shift[0]);
    const v16 y0 = plane(near_row[1], 1, near_shift[1]), y1 = plane(far_row[1], 1, far_shift[1]);
    const v16 z0 = plane(near_row[2], 2, near_shift[2]), z1 = plane(far_row[2], 2, far_shift[2]);
    enter = greater(greater(x0, y0), greater(z0, v16(t_min)));
    const lanes16 met = enter <= lesser(lesser(x1, y1), lesser(z1, v16(far)));
    return (unsigned)__builtin_bit_cast(unsigned short, __builtin_convertvector(met, bits16));
};
// The triangles of a leaf; 0 for a node.
const auto leaf_size = [](unsigned child) __attribute__((always_inline)) { return (int)(child & 15u); };
const auto place = [&](unsigned child) __attribute__((always_inline)) {
    return (const float*)((const char*)memory + 2 * (unsigned long long)(child & ~15u));
};
const auto fetch = [&](unsigned child) __attribute__((always_inline)) {
    const float* p = place(child);
    // As long as a node; a leaf is shorter.
    for (int line = 0; line < NODE_FLOATS / 16; ++line) __builtin_prefetch(p + 16 * line);
};
// Whether the plane of a triangle is met before t_min, in double precision.
const auto behind = [&](const float* triangle, int count) __attribute__((always_inline)) {
    double a[3], e[3], f[3];
    for (int k = 0; k < 3; ++k) {
        a[k] = triangle[k * count];
        e[k] = triangle[(3 + k) * count] - a[k];
        f[k] = triangle[(6 + k) * count] - a[k];
    }
    const double n[3] = {e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]};
    double way = 0.0, along = 0.0;
    for (int k = 0; k < 3; ++k) {
        way += n[k] * (a[k] - origin[k]);
        along += n[k] * direction[k];
    }
    return way * along < t_min * along * along;
};
// Triangles of a leaf that the ray meets between t_min and far, where, and the weights of vertices 0 and 1.
const auto leaf = [&](const float* block, int count, v8& t, v8& u, v8& v) __attribute__((always_inline)) {
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
        // Roundings may move t of a sliver, metres long and millimetres high, from behind the ray's origin before it.
        for (unsigned close = met & mask(t < v8(0x1p-10f * size)); close; close &= close - 1) {
            const int i = __builtin_ctz(close);
            if (behind(block + i, count)) met &= ~(1u << i);
        }
    }
    return met;
};
