// Rays against a list of few triangles, eight of them (a block) at once; see bvh16_list.py.
// Products with the ray of the edges opposite to vertices 0 and 1, over the sum of all three, are the weights.
const float start[3] = {origin[0] - middle[0], origin[1] - middle[1], origin[2] - middle[2]};
const float moment[3] = {start[1] * direction[2] - start[2] * direction[1],
    start[2] * direction[0] - start[0] * direction[2], start[0] * direction[1] - start[1] * direction[0]};
const auto list = [&](int block, v8 end, v8& t, v8& u, v8& v) __attribute__((always_inline)) {
    const auto row = [&](int i) __attribute__((always_inline)) {
        return *(const v8*)(memory + BLOCK_FLOATS * block + 8 * i);
    };
    const auto plus = [](v8 sum, float a, v8 b) __attribute__((always_inline)) {
        return __builtin_elementwise_fma(v8(a), b, sum);
    };
    const auto side = [&](int i) __attribute__((always_inline)) {
        v8 sum = v8(moment[0]) * row(i), other = v8(direction[0]) * row(i + 3);
        for (int k = 1; k < 3; ++k) sum = plus(sum, moment[k], row(i + k));
        for (int k = 1; k < 3; ++k) other = plus(other, direction[k], row(i + 3 + k));
        sum = sum + other;
        return sum;
    };
    u = side(10);
    v = side(16);
    const v8 w = side(22), sum = u + v + w;
    const lanes8 inside = (lesser(lesser(u, v), w) >= v8(0.0f)) | (greater(greater(u, v), w) <= v8(0.0f));
    const v8 scale = v8(1.0f) / sum;
    t = row(31);
    for (int k = 0; k < 3; ++k) t = plus(t, -start[k], row(28 + k));
    t *= scale;
    u *= scale;
    v *= scale;
    return inside & (sum != v8(0.0f)) & (t >= v8(t_min)) & (t < end);
};
