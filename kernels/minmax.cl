// Extremes of each feature over each pixel's window, as two passes: along rows, then along columns.
//
// Only valid pixels count, and of depth only those that see something. Where none does, lo = BIG and hi = -BIG remain.

// Work-item: VW pixels of one row of one frame. out: [H][2F][span], lo then hi of each feature.
__kernel void minmax_rows(__global const real *packed, long start, int pitch, int span, __global real *out_rows)
{
    const int x = get_global_id(0) * VW, y = get_global_id(1);
    __global const real *in = packed + start + (size_t)(y + BORDER) * PLANES * pitch + BORDER + x;
    __global real *out = out_rows + (size_t)y * 2 * F * span + x;
    for (int j = 0; j < F; j++) {
        realv lo = BIG, hi = -BIG;
        for (int dx = -REACH; dx <= REACH; dx += STEP) {
            const realv mask = LOAD(in + MASK * pitch + dx), v = LOAD(in + (FEATURE + j) * pitch + dx);
            const realv low = mask > 0 ? v : (realv)BIG;
            realv high = mask > 0 ? v : (realv)-BIG;
            if (MISSES && j == DEPTH) high = high < (realv)BIG ? high : (realv)-BIG;
            lo = MIN(lo, low);
            hi = MAX(hi, high);
        }
        STORE(out + 2 * j * span, lo);
        STORE(out + (2 * j + 1) * span, hi);
    }
}

__kernel void minmax_columns(__global const real *rows, int height, int span, long start, __global real *out_extremes)
{
    const int x = get_global_id(0) * VW, y = get_global_id(1);
    const size_t pitch = (size_t)2 * F * span;
    for (int j = 0; j < F; j++) {
        realv lo = BIG, hi = -BIG;
        for (int dy = -REACH; dy <= REACH; dy += STEP) {
            if (y + dy < 0 || y + dy >= height) continue;
            __global const real *in = rows + (y + dy) * pitch + 2 * j * span + x;
            const realv low = LOAD(in), high = LOAD(in + span);
            lo = MIN(lo, low);
            hi = MAX(hi, high);
        }
        __global real *out = out_extremes + start + y * pitch + 2 * j * span + x;
        STORE(out, lo);
        STORE(out + span, hi);
    }
}
