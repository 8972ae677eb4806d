"""Meshes of few triangles: no tree, but a list whose triangles are all tested, eight at once, without a branch.

The edge functions are the products of the Plücker coordinates of the ray and of the edges (Jones, Ray Tracing News
13(1), 2000), the latter made beforehand. Those of an edge that two triangles share differ in sign alone, to the last
bit, and so do their products, and 0 counts for both: no ray slips between the two. Where more than two triangles meet,
roundings may disagree: of rays aimed right at a vertex, some in ten thousand pass.

A block is eight triangles: a row of eight for each of the numbers below.
"""

LIST_TRIANGLES = 64
"""The most triangles of a list. In boxes within a box, rays that bounce are as fast in a tree from 100 on, and those of
the camera from 50 on."""
ROWS = 35
"""Three vertices (9), the triangle's number, edge and moment of the edges opposite to the vertices (18), the normal
times twice the area (3) and its product with a vertex, and the unit normal (3)."""
BLOCK_FLOATS = 8 * ROWS

_BLOCK = """
    // Products with the ray of the edges opposite to vertices 0 and 1, over the sum of all three, are the weights.
    const float moment[3] = {origin[1] * direction[2] - origin[2] * direction[1],
        origin[2] * direction[0] - origin[0] * direction[2], origin[0] * direction[1] - origin[1] * direction[0]};
    const auto list = [&](int block, v8 end, v8& t, v8& u, v8& v) __attribute__((always_inline)) {
        const auto row = [&](int i) __attribute__((always_inline)) {
            return *(const v8*)(corners + BLOCK_FLOATS * block + 8 * i);
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
        for (int k = 0; k < 3; ++k) t = plus(t, -origin[k], row(28 + k));
        t *= scale;
        u *= scale;
        v *= scale;
        return inside & (sum != v8(0.0f)) & (t >= v8(t_min)) & (t < end);
    };
"""

CLOSEST_IN_LIST = (
    """
    if (blocks) {
    """
    + _BLOCK
    + """
        alignas(32) float us[8], vs[8];
        alignas(32) int places[8];
        v8 best = v8(far), best_u = v8(0.0f), best_v = v8(0.0f);
        lanes8 place = lanes8(0);
        for (int block = 0; block < blocks; ++block) {
            v8 t, u, v;
            const lanes8 met = list(block, best, t, u, v);
            best = met ? t : best;
            best_u = met ? u : best_u;
            best_v = met ? v : best_v;
            place = met ? lanes8(block) : place;
        }
        *(v8*)us = best_u;
        *(v8*)vs = best_v;
        *(lanes8*)places = place;
        // As integers, which sort as the numbers do from 0 on, and sooner.
        const lanes8 order = __builtin_bit_cast(lanes8, best);
        const int least = __builtin_reduce_min(order);
        const float nearest = __builtin_bit_cast(float, least);
        wp::vec_t<16, int32_t> hit;
        hit[0] = -1;
        if (nearest < far) {
            const int lane = __builtin_ctz(mask(order == lanes8(least))) & 7;
            const int* row = (const int*)(corners + BLOCK_FLOATS * places[lane] + lane);
            hit[0] = row[8 * 9] - FIRST_NUMBER;
            hit[1] = least;
            hit[2] = __builtin_bit_cast(int, us[lane]);
            hit[3] = __builtin_bit_cast(int, vs[lane]);
            for (int k = 0; k < 9; ++k) hit[4 + k] = row[8 * k];
            for (int k = 0; k < 3; ++k) hit[13 + k] = row[8 * (32 + k)];
        }
        return hit;
    }
"""
)

ANY_IN_LIST = (
    """
    if (blocks) {
    """
    + _BLOCK
    + """
        lanes8 any = lanes8(0);
        for (int block = 0; block < blocks; ++block) {
            v8 t, u, v;
            any |= list(block, v8(far), t, u, v);
        }
        return mask(any) != 0;
    }
"""
)

FIT_LIST = """
    for (int i = 0; count == 0 && i < order.shape[0]; ++i) {
        v4 p[3];
        const bool whole = load(order.data[i], p);
        float* out = corners.data + BLOCK_FLOATS * (i / 8) + i % 8;
        for (int row = 0; row < ROWS; ++row) out[8 * row] = 0.0f;
        ((int*)out)[8 * 9] = FIRST_NUMBER + order.data[i];
        if (!whole) continue;
        double edge[3][3], normal[3], length2 = 0.0, offset = 0.0;
        for (int m = 0; m < 3; ++m) {
            const v4 q = p[(m + 1) % 3], r = p[(m + 2) % 3];
            for (int k = 0; k < 3; ++k) {
                const int y = (k + 1) % 3, z = (k + 2) % 3;
                edge[m][k] = (double)r[k] - q[k];
                out[8 * (3 * m + k)] = p[m][k];
                out[8 * (10 + 6 * m + k)] = r[k] - q[k];
                // Products of floats are exact in double precision, so that the order of the two matters to none.
                out[8 * (13 + 6 * m + k)] = (float)((double)q[y] * r[z] - (double)q[z] * r[y]);
            }
        }
        for (int k = 0; k < 3; ++k) {
            const int y = (k + 1) % 3, z = (k + 2) % 3;
            normal[k] = edge[1][y] * edge[2][z] - edge[1][z] * edge[2][y];
            length2 += normal[k] * normal[k];
            offset += normal[k] * p[0][k];
        }
        for (int k = 0; k < 3; ++k) {
            out[8 * (28 + k)] = (float)normal[k];
            out[8 * (32 + k)] = (float)(normal[k] / __builtin_sqrt(length2));
        }
        out[8 * 31] = (float)offset;
    }
"""
