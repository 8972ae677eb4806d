// The mean of an image over a pixel, with the bits of `image` at each of the places: what is rounded there is rounded
// here. Many places at a time: then they are found without branches, and their texels on the way from memory together.
// Where the places lie more than two texels apart, they read a coarser level, whose texels are means of these.
{
#pragma clang fp contract(off)
wp::vec_t<4, wp::float32> total(0.0f);
const float all = (float)places;
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
const unsigned* texels = textures.texels.data + row.first;
int wide = row.width, high = row.height;
if (row.levels > 0) {
    float side[2][2];
    for (int way = 0; way < 2; ++way) {
        float end[2][2];
        for (int last = 0; last < 2; ++last) {
            const float right = way == 0 ? (float)last : 0.5f, below = way == 0 ? 0.5f : (float)last;
            float both[3];
            for (int k = 0; k < 3; ++k) {
                const float top = across(footprint.top_left, footprint.top_right, k, right);
                const float bottom = across(footprint.bottom_left, footprint.bottom_right, k, right);
                both[k] = top + (bottom - top) * below;
            }
            end[last][0] = both[0] / both[2];
            end[last][1] = both[1] / both[2];
        }
        const float u = end[1][0] - end[0][0], v = end[1][1] - end[0][1];
        for (int k = 0; k < 2; ++k)
            side[way][k] = (row.uv_matrix.data[k][0] * u + row.uv_matrix.data[k][1] * v) * (float)(k == 0 ? wide : high);
    }
    const float turned = side[0][0] * side[1][1] - side[0][1] * side[1][0], area = turned < 0.0f ? -turned : turned;
    const float across2 = side[0][0] * side[0][0] + side[0][1] * side[0][1];
    const float down2 = side[1][0] * side[1][0] + side[1][1] * side[1][1];
    // Of a long strip the narrow side counts: nothing is blurred more than the places are apart.
    float apart = area / ::sqrtf((across2 > down2 ? across2 : down2) * all + 1e-20f);
    const unsigned* coarser = textures.coarse.data + row.coarse;
    for (int level = 0; level < row.levels && apart >= 2.0f; ++level) {
        texels = coarser;
        wide >>= 1;
        high >>= 1;
        coarser += wide * high;
        apart *= 0.5f;
    }
}
const float width = (float)wide, height = (float)high;
const bool is_bent = bend[0] + bend[1] + bend[2] > 0.0f;
float next = 0.5f;
for (int start = 0; start < places; start += AT_ONCE) {
    const int many = places - start < AT_ONCE ? places - start : AT_ONCE;
    float down[AT_ONCE], right_share[AT_ONCE], bottom_share[AT_ONCE];
    int at[AT_ONCE][4];
    for (int j = 0; j < many; ++j) {
        down[j] = next;
        next = next + GOLDEN;
        next = next - ::floorf(next);
    }
    for (int j = 0; j < many; ++j) {
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
        const int x0 = neighbour((int)left, wide, row.wrap_u), x1 = neighbour((int)left + 1, wide, row.wrap_u);
        const int y0 = neighbour((int)above, high, row.wrap_v);
        const int y1 = neighbour((int)above + 1, high, row.wrap_v);
        at[j][0] = y0 * wide + x0;
        at[j][1] = y0 * wide + x1;
        at[j][2] = y1 * wide + x0;
        at[j][3] = y1 * wide + x1;
    }
#if !defined(__CUDA_ARCH__)
    for (int j = 0; j < many; ++j)
        for (int i = 0; i < 4; i += 2) __builtin_prefetch(texels + at[j][i]);
#endif
    for (int j = 0; j < many; ++j) {
        float corner[4][4];
        for (int i = 0; i < 4; ++i) {
            const unsigned word = texels[at[j][i]];
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
            float value = upper * top_share + lower * bottom_share[j];
            if (is_bent && k < 3) value = value / (1.0f - bend[k] * value);
            total[k] += value / all;
        }
    }
}
return total;
}
