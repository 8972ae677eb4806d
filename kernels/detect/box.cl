// Box means of brightness and features over valid pixels, for the radiance gate.

#include "detect/model.clh"

// Work-item: VW pixels. Sums along the row; out: [H][BOX_PLANES + 1][span], the last plane counts valid pixels.
__kernel void box_rows(__global const real *packed, long start, int pitch, int span, int reach, __global real *out_rows)
{
    const int x = get_global_id(0) * VW, y = get_global_id(1);
    __global const real *in = packed + start + (size_t)(y + BORDER) * PLANES * pitch + BORDER + x;
    realv sum[BOX_PLANES + 1];
    for (int j = 0; j <= BOX_PLANES; j++) sum[j] = 0;
    for (int dx = -reach; dx <= reach; dx++) {
        const realv mask = LOAD(in + MASK * pitch + dx);
        sum[BOX_PLANES] += mask;
        sum[B_BRIGHTNESS] += LOAD(in + BRIGHTNESS * pitch + dx);
        sum[B_X] += mask * (real)dx;
        for (int j = 0; j < F; j++) {
            realv v = LOAD(in + (FEATURE + j) * pitch + dx);
            if (MISSES && j == DEPTH) {
                sum[B_MISS] += v < (realv)BIG ? (realv)0 : (realv)1;
                v = v < (realv)BIG ? v : (realv)0;
            }
            sum[B_FEATURE + j] += v;
        }
    }
    sum[B_Y] = sum[BOX_PLANES];
    __global real *out = out_rows + (size_t)y * (BOX_PLANES + 1) * span + x;
    for (int j = 0; j <= BOX_PLANES; j++) STORE(out + j * span, sum[j]);
}

__kernel void box_columns(__global const real *rows, int height, int span, int reach, __global real *out_means)
{
    const int x = get_global_id(0) * VW, y = get_global_id(1);
    const int first = MAX(-reach, -y), last = MIN(reach, height - 1 - y);
    const size_t pitch = (size_t)(BOX_PLANES + 1) * span;
    __global const real *in = rows + y * pitch + x;
    realv count = 0;
    for (int dy = first; dy <= last; dy++) count += LOAD(in + dy * (long)pitch + BOX_PLANES * span);
    const realv share = (real)1 / (count > 0 ? count : (realv)1);
    __global real *out = out_means + (size_t)y * BOX_PLANES * span + x;
    for (int j = 0; j < BOX_PLANES; j++) {
        realv sum = 0;
        for (int dy = first; dy <= last; dy++) {
            const realv v = LOAD(in + dy * (long)pitch + j * span);
            sum += j == B_Y ? v * (real)dy : v;
        }
        STORE(out + j * span, sum * share);
    }
}
