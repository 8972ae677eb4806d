// Writes the blocks of a list of few triangles; see bvh16_list.py.
const v4 from = {middle[0], middle[1], middle[2], 0.0f};
for (int i = 0; count == 0 && i < order.shape[0]; ++i) {
    v4 p[3];
    const bool whole = load(order.data[i], p);
    float* out = memory.data + BLOCK_FLOATS * (i / 8) + i % 8;
    for (int row = 0; row < ROWS; ++row) out[8 * row] = 0.0f;
    ((int*)out)[8 * 9] = FIRST_NUMBER + order.data[i];
    if (!whole) continue;
    double edge[3][3], normal[3], length2 = 0.0, offset = 0.0;
    for (int m = 0; m < 3; ++m) {
        const v4 q = p[(m + 1) % 3] - from, r = p[(m + 2) % 3] - from;
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
        offset += normal[k] * (p[0][k] - from[k]);
    }
    for (int k = 0; k < 3; ++k) {
        out[8 * (28 + k)] = (float)normal[k];
        out[8 * (32 + k)] = (float)(normal[k] / __builtin_sqrt(length2));
    }
    out[8 * 31] = (float)offset;
    for (int k = 0; k < 9; ++k) out[8 * 35] = __builtin_fmaxf(out[8 * 35], __builtin_fabsf(p[k / 3][k % 3]));
}
