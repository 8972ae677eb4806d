// Which pixels may fire, and the level of those that cannot.
//
// Work-item: a row, unless stated. out_flags: [H][span], one of SKIPPED, KEPT, SOLVED, FRESH; out_counts: [H][4], how
// many of each.

#include "detect/model.clh"
#include "detect/brightness.clh"
#include "detect/gate.clh"

// The level of every pixel is known (its log luminance, or a regression): those that reach a threshold may fire.
__kernel void gate_level(
    __global const real *packed, long start, __global const real *level, long level_row, long level_start, int pitch, int span,
    int width, __global const real *references, real on, real off, __global const real *before, __global real *out_level,
    __global uchar *out_flags, __global int *out_counts)
{
    const int y = get_global_id(0);
    packed += start + (size_t)(y + BORDER) * PLANES * pitch + BORDER;
    level += y * level_row + level_start;
    for (int x = 0; x < span; x += VW) {
        const size_t at = (size_t)y * span + x;
        const realv now = levels_of(LOAD(level + x));
        decide_level(
            LOAD(packed + x), LOAD(references + at), now, before + at, on, off, width - x, out_level + at, out_flags + at);
    }
    count_flags(out_flags + (size_t)y * span, width, out_counts + 4 * y);
}

#ifdef MODEL
// The closed form of the paper's test: dR = (beta.delta)^2 (Tsuji et al., ICIP 2023, proposition 1), counted from the
// reference; with RADIANCE also what box means show beyond the features, and features that leave their old range.
static inline void predict(
    __global const real *packed, __global const real *boxes, int pitch, int span, int inside, real share,
    __global const real *model, realv ref, real on, real off, __global const real *before, __global real *out_level,
    __global uchar *out_flags)
{
    const realv mask = LOAD(packed);
    realv moved = 0, solve = 0;
#ifdef RADIANCE
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
    decide(mask, ref, predicted, LOAD(before), before, solve, on, off, inside, out_level, out_flags);
}

__kernel void gate_model(
    __global const real *packed, long start, __global const real *boxes, int pitch, int span, int width, real share,
    __global const real *model, __global const real *references, real on, real off, __global const real *before,
    __global real *out_level, __global uchar *out_flags, __global int *out_counts)
{
    const int y = get_global_id(0);
    packed += start + (size_t)(y + BORDER) * PLANES * pitch + BORDER;
    model += (size_t)y * MODEL_PLANES * span;
#ifdef RADIANCE
    boxes += (size_t)y * BOX_PLANES * span;
#endif
    for (int x = 0; x < span; x += VW) {
        const size_t at = (size_t)y * span + x;
        predict(
            packed + x, boxes + x, pitch, span, width - x, share, model + x, LOAD(references + at), on, off, before + at,
            out_level + at, out_flags + at);
    }
    count_flags(out_flags + (size_t)y * span, width, out_counts + 4 * y);
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

// Work-item: LISTED rows. The pixels to solve, in raster order, as y·span + x.
__kernel void list_pixels(
    __global const uchar *flags, __global const int *counts, int height, int span, __global int *out_list)
{
    const int first = get_global_id(0) * LISTED, last = MIN(first + LISTED, height);
    int next = 0;
    for (int y = 0; y < first; y++) next += counts[4 * y + SOLVED] + counts[4 * y + FRESH];
    for (int y = first; y < last; y++) {
        int left = counts[4 * y + SOLVED] + counts[4 * y + FRESH];
        for (int x = 0; left > 0; x++) {
            if (flags[(size_t)y * span + x] < SOLVED) continue;
            out_list[next++] = y * span + x;
            left--;
        }
    }
}
