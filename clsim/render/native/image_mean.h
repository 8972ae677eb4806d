// The mean of an image over a pixel, with the bits of `image` at each of the places: what is rounded there is rounded
// here. Many places at a time: then they are found without branches, and their texels on the way from memory together.
{
#pragma clang fp contract(off)
wp::vec_t<4, wp::float32> total(0.0f);
const float width = (float)row.width, height = (float)row.height, all = (float)places;
const auto fold = [](float x, int mode) {
    float folded = x < 0.0f ? 0.0f : x > 1.0f ? 1.0f : x;
    if (mode == REPEAT) folded = x - ::floorf(x);
    if (mode == MIRROR) {
        folded = x - 2.0f * ::floorf(0.5f * x);
        folded = folded > 1.0f ? 2.0f - folded : folded;
    }
    return folded;
};
const auto neighbour = [](int i, int n, int mode) {
    const int inside = i < 0 ? 0 : i > n - 1 ? n - 1 : i;
    return mode == REPEAT && inside != i ? n - 1 - inside : inside;
};
const auto across = [](const wp::vec_t<3, wp::float32>& from, const wp::vec_t<3, wp::float32>& to, int k, float x) {
    return from[k] + (to[k] - from[k]) * x;
};
float next = 0.5f;
for (int start = 0; start < places; start += AT_ONCE) {
    float down[AT_ONCE], right_share[AT_ONCE], bottom_share[AT_ONCE];
    int at[AT_ONCE][4];
    for (int j = 0; j < AT_ONCE; ++j) {
        down[j] = next;
        next = next + GOLDEN;
        next = next - ::floorf(next);
    }
    for (int j = 0; j < AT_ONCE; ++j) {
        const float right = ((float)(start + j) + 0.5f) / all;
        float both[3];
        for (int k = 0; k < 3; ++k) {
            const float top = across(footprint.top_left, footprint.top_right, k, right);
            const float bottom = across(footprint.bottom_left, footprint.bottom_right, k, right);
            both[k] = top + (bottom - top) * down[j];
        }
        const float u = both[0] / both[2], v = both[1] / both[2];
        float st[2];
        for (int k = 0; k < 2; ++k)
            st[k] = row.uv_matrix.data[k][0] * u + row.uv_matrix.data[k][1] * v + row.uv_matrix.data[k][2];
        const float x = fold(st[0], row.wrap_u) * width - 0.5f, y = (1.0f - fold(st[1], row.wrap_v)) * height - 0.5f;
        const float left = ::floorf(x), above = ::floorf(y);
        right_share[j] = x - left;
        bottom_share[j] = y - above;
        const int x0 = neighbour((int)left, row.width, row.wrap_u), x1 = neighbour((int)left + 1, row.width, row.wrap_u);
        const int y0 = neighbour((int)above, row.height, row.wrap_v);
        const int y1 = neighbour((int)above + 1, row.height, row.wrap_v);
        at[j][0] = row.first + y0 * row.width + x0;
        at[j][1] = row.first + y0 * row.width + x1;
        at[j][2] = row.first + y1 * row.width + x0;
        at[j][3] = row.first + y1 * row.width + x1;
    }
#if !defined(__CUDA_ARCH__)
    for (int j = 0; j < AT_ONCE; ++j)
        for (int i = 0; i < 4; i += 2) __builtin_prefetch(textures.texels.data + at[j][i]);
#endif
    for (int j = 0; j < AT_ONCE && start + j < places; ++j) {
        float corner[4][4];
        for (int i = 0; i < 4; ++i) {
            const unsigned word = textures.texels.data[at[j][i]];
            const float* plain = textures.decoding.data;
            const float* coded = plain + row.decoding;
            corner[i][0] = coded[word & 255];
            corner[i][1] = coded[word >> 8 & 255];
            corner[i][2] = coded[word >> 16 & 255];
            corner[i][3] = plain[word >> 24];
        }
        const float left_share = 1.0f - right_share[j], top_share = 1.0f - bottom_share[j];
        for (int k = 0; k < 4; ++k) {
            const float upper = corner[0][k] * left_share + corner[1][k] * right_share[j];
            const float lower = corner[2][k] * left_share + corner[3][k] * right_share[j];
            total[k] += (upper * top_share + lower * bottom_share[j]) / all;
        }
    }
}
return total;
}
