// The triangles that a tree is built over.
const auto corner = [&](int triangle, int i) __attribute__((always_inline)) {
    const float* p = &vertices.data[indices.data[3 * (long long)triangle + i]][0];
    return v4{p[0], p[1], p[2], 0.0f};
};
// By their bits, as a compiler may take it that no number is NaN; those of magnitudes are in the order of these.
const auto bits_of = [](float x) __attribute__((always_inline)) {
    union { float value; unsigned int bits; } both;
    both.value = x;
    return both.bits & 0x7fffffffu;
};
const auto usable = [&](v4 p) __attribute__((always_inline)) {
    const unsigned int most = bits_of(FARTHEST);
    return bits_of(p.x) <= most && bits_of(p.y) <= most && bits_of(p.z) <= most;
};
// The corners of a triangle, and whether a ray may hit it.
const auto load = [&](int triangle, v4* p) __attribute__((always_inline)) {
    bool whole = true;
    for (int m = 0; m < 3; ++m) {
        p[m] = corner(triangle, m);
        whole = whole && usable(p[m]);
    }
    const v4 e = p[1] - p[0], f = p[2] - p[0];
    const v4 n = e.yzxw * f.zxyw - e.zxyw * f.yzxw;
    return whole && n.x * n.x + n.y * n.y + n.z * n.z > 0.0f;
};
