// A frame's planes become one padded, row-interleaved image of mask, brightness, features and, with SHRINK, variance.

#include "detect/packed.clh"
#include "detect/brightness.clh"

// One work-item packs one row, plane by plane in loops that compilers vectorise. `frame` holds planes of width·height
// floats; `source` names them: R, G, B, the F features, then `quiet` candidates that have been constant so far, then
// coverage if has_coverage.
// `weights` are what pixels see of R, G and B: all alike or, with MOSAIC, the four of each square, row by row.
// Per row: number of invalid pixels, and the extremes of each quiet candidate; depth is none where pixels may see nothing.
__kernel void pack(
    __global const float *restrict frame, __constant int *source, int width, int height, int pitch, int quiet,
    int has_coverage, __constant real *weights, int variance_plane,
    real variance_scale, long start,
    __global real *restrict out_packed, __global int *restrict out_invalid, __global float *restrict out_range)
{
    const int y = get_global_id(0), planes = 3 + F + quiet + has_coverage;
    const size_t area = (size_t)width * height;
    __global const float *restrict row = frame + (size_t)y * width;
    __global real *restrict mask = out_packed + start + (size_t)(y + BORDER) * PLANES * pitch + BORDER;
    __global const float *restrict coverage = row + source[has_coverage ? planes - 1 : 0] * area;
    for (int x = 0; x < width; x++) mask[x] = 1;
    for (int j = 0; j < planes; j++) {
        __global const float *restrict in = row + source[j] * area;
        for (int x = 0; x < width; x++) mask[x] = in[x] - in[x] == 0 ? mask[x] : 0;
    }
    int invalid = 0;
    for (int x = 0; x < width; x++) invalid += mask[x] == 0;
    out_invalid[y] = invalid;

    __global const float *restrict r = row + source[0] * area, *restrict g = row + source[1] * area;
    __global const float *restrict b = row + source[2] * area;
    __global real *restrict brightness = mask + BRIGHTNESS * pitch;
    __constant real *in_row = weights + MOSAIC * 6 * (y % 2);
    for (int x = 0; x < width; x++) {
        __constant real *of = in_row + MOSAIC * 3 * (x % 2);
        const real luminance = of[0] * r[x] + of[1] * g[x] + of[2] * b[x];
#if LINEAR
        const real level = MIN(luminance, (real)LARGEST_LUMINANCE);
#else
        const real level = response(luminance < BIG ? luminance : BIG, (real)FLOOR_Y);
#endif
        brightness[x] = mask[x] > 0 ? level : 0;
    }
    for (int j = 0; j < F; j++) {
        __global const float *restrict in = row + source[3 + j] * area;
        __global real *restrict out = mask + (FEATURE + j) * pitch;
        for (int x = 0; x < width; x++) out[x] = mask[x] > 0 ? in[x] : 0;
        // The depth of a miss is its window's largest: a mark that every minimum with that depth removes.
        if (MISSES && j == DEPTH)
            for (int x = 0; x < width; x++) out[x] = mask[x] > 0 && !(coverage[x] > 0) ? BIG : out[x];
    }
#if SHRINK
    __global const float *restrict in = row + variance_plane * area;
    __global real *restrict variance = mask + VARIANCE * pitch;
    for (int x = 0; x < width; x++) variance[x] = mask[x] > 0 ? in[x] * variance_scale : 0;
#endif
    for (int j = 0; j < quiet; j++) {
        __global const float *restrict in = row + source[3 + F + j] * area;
        float lo = INFINITY, hi = -INFINITY;
        for (int x = 0; x < width; x++) {
            if (mask[x] == 0) continue;
            lo = in[x] < lo ? in[x] : lo;
            hi = in[x] > hi ? in[x] : hi;
        }
        out_range[(y * quiet + j) * 2] = lo;
        out_range[(y * quiet + j) * 2 + 1] = hi;
    }
}
