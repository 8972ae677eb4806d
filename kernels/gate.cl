// Which pixels may fire, and the level of those that cannot.
//
// Work-item: VW pixels. out_flags: [H][span], one of SKIPPED, KEPT, SOLVED, FRESH.

#include "model.clh"
#include "brightness.clh"

static inline void decide(
    realv mask, realv ref, realv predicted, realv now, __global const real *before, realv solve, real on, real off,
    int inside, __global real *out_level, __global uchar *out_flags)
{
    realv low = ref - off, high = ref + on;
    realv level = predicted > high ? high : predicted;
    level = level < low ? low : level;
    const realv ready = ref == ref ? (realv)1 : (realv)0;
    const realv flag = mask > 0 ? (ready > 0 ? (realv)KEPT + solve : (realv)FRESH) : (realv)SKIPPED;
    level = flag == (realv)KEPT ? level : now;
    STORE(out_level, flag == (realv)SKIPPED ? LOAD(before) : level);
    for (int lane = 0; lane < VW; lane++) out_flags[lane] = lane < inside ? (uchar)((real *)&flag)[lane] : SKIPPED;
}

// The level of every pixel is known (its log luminance, or a regression): those that reach a threshold may fire.
__kernel void gate_level(
    __global const real *packed, long start, __global const real *level, long level_row, long level_start, int pitch, int span,
    int width, __global const real *references, real on, real off, __global const real *before, __global real *out_level,
    __global uchar *out_flags)
{
    const int x = get_global_id(0) * VW, y = get_global_id(1);
    const size_t at = (size_t)y * span + x;
    const realv mask = LOAD(packed + start + (size_t)(y + BORDER) * PLANES * pitch + BORDER + x);
    const realv now = levels_of(LOAD(level + y * level_row + level_start + x));
    const realv ref = LOAD(references + at), change = now - ref;
    const realv solve = change >= on ? (realv)1 : (change <= -off ? (realv)1 : (realv)0);
    decide(mask, ref, now, now, before + at, solve, on, off, width - x, out_level + at, out_flags + at);
}

#ifdef MODEL
// The closed form of the paper's test: dR = (beta.delta)^2 (Tsuji et al., ICIP 2023, proposition 1), counted from the
// reference; with RADIANCE also what box means show beyond the features, and features that leave their old range.
__kernel void gate_model(
    __global const real *packed, long start, __global const real *boxes, int pitch, int span, int width, real share,
    __global const real *model, __global const real *references, real on, real off, __global const real *before,
    __global real *out_level, __global uchar *out_flags)
{
    const int x = get_global_id(0) * VW, y = get_global_id(1);
    packed += start + (size_t)(y + BORDER) * PLANES * pitch + BORDER + x;
    const realv mask = LOAD(packed);
    model += (size_t)y * MODEL_PLANES * span + x;
    const size_t at = (size_t)y * span + x;
    const realv ref = LOAD(references + at);
    realv moved = 0, solve = 0;
#ifdef RADIANCE
    boxes += (size_t)y * BOX_PLANES * span + x;
    realv unexplained = LOAD(boxes + B_BRIGHTNESS * span) - LOAD(model + M_BOX * span);
    unexplained -= LOAD(model + M_SLOPE * span) * LOAD(boxes + B_X * span);
    unexplained -= LOAD(model + (M_SLOPE + 1) * span) * LOAD(boxes + B_Y * span);
#endif
#pragma unroll
    for (int j = 0; j < F; j++) {
        const realv slope = LOAD(model + (M_SLOPE + 2 + j) * span), centre = LOAD(model + (M_CENTRE + j) * span);
        realv v = LOAD(packed + (FEATURE + j) * pitch);
        // A miss takes the old window's largest depth, as it did in the regression.
        if (MISSES && j == DEPTH) v = v < (realv)BIG ? v : LOAD(model + (M_HI + j) * span);
        moved += slope * (v - centre);
#ifdef RADIANCE
        const realv lo = LOAD(model + (M_LO + j) * span), hi = LOAD(model + (M_HI + j) * span);
        realv mean = LOAD(boxes + (B_FEATURE + j) * span);
        if (MISSES && j == DEPTH) mean += LOAD(boxes + B_MISS * span) * hi;
        unexplained -= slope * (mean - centre);
        const realv low = lo > 0 ? lo : -lo, high = hi > 0 ? hi : -hi;
        const realv margin = (real)1e-3 * MAX(low, high);
        solve = v < lo - margin ? (realv)1 : (v > hi + margin ? (realv)1 : solve);
#endif
    }
    moved += LOAD(model + M_ALPHA * span);
    realv predicted = levels_of(moved);
    realv change = predicted - ref;
    solve = change > on ? (realv)1 : (change < -off ? (realv)1 : solve);
#ifdef RADIANCE
    predicted = levels_of(moved + unexplained);
    change = predicted - ref;
    solve = change > share * on ? (realv)1 : (change < -share * off ? (realv)1 : solve);
#endif
    // Those that may fire get their level once it is regressed.
    decide(mask, ref, predicted, LOAD(before + at), before + at, solve, on, off, width - x, out_level + at, out_flags + at);
}

// Work-item: CHUNK pixels of the list, which take the level that was regressed for them. fit: [H][1 + D][span].
__kernel void take_levels(
    __global const int *list, int count, __global const real *fit, int span, __global real *out_level)
{
    const int first = get_global_id(0) * CHUNK, last = MIN(first + CHUNK, count);
    for (int i = first; i < last; i++) {
        const int x = list[i] % span, y = list[i] / span;
        out_level[list[i]] = level_of(fit[(size_t)y * (1 + D) * span + x]);
    }
}
#endif

// Work-item: one row. How many of its pixels are in each class: [H][4].
__kernel void count_flags(__global const uchar *flags, int width, int span, __global int *out_counts)
{
    const int y = get_global_id(0);
    int kept = 0, solved = 0, fresh = 0;
    for (int x = 0; x < width; x++) {
        const uchar flag = flags[(size_t)y * span + x];
        kept += flag == KEPT;
        solved += flag == SOLVED;
        fresh += flag == FRESH;
    }
    out_counts[4 * y] = width - kept - solved - fresh;
    out_counts[4 * y + KEPT] = kept;
    out_counts[4 * y + SOLVED] = solved;
    out_counts[4 * y + FRESH] = fresh;
}

// Work-item: one row. The pixels to solve, in raster order, as y·span + x; counts: as count_flags finds them.
__kernel void list_pixels(
    __global const uchar *flags, __global const int *counts, int width, int span, __global int *out_list)
{
    const int y = get_global_id(0);
    if (counts[4 * y + SOLVED] + counts[4 * y + FRESH] == 0) return;
    int next = 0;
    for (int row = 0; row < y; row++) next += counts[4 * row + SOLVED] + counts[4 * row + FRESH];
    for (int x = 0; x < width; x++)
        if (flags[(size_t)y * span + x] >= SOLVED) out_list[next++] = y * span + x;
}
