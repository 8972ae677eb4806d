// A frame's planes become one padded, row-interleaved image of mask, log luminance and features.
//
// Build macro: LIN_LOG (1: linear below a knee, on values 0…255, as v2e has it; 0: ln).

static real response(real y, real floor_y) {
#if LIN_LOG
    const real value = 255 * y, slope = (real)(2.995732273553991 / 20);
    return value <= 20 ? value * slope : log(value);
#else
    return log(y > floor_y ? y : floor_y);
#endif
}

static int finite(float v) { return v - v == 0; }

// One work-item packs one row. `frame` holds planes of width·height floats; `source` names them: R, G, B, the F
// features, then `quiet` candidates that have been constant so far, then coverage if has_coverage.
// Per row: number of invalid pixels, and the extremes of each quiet candidate (of depth over hits only).
__kernel void pack(
    __global const float *frame, __constant int *source, int width, int height, int pitch, int quiet, int quiet_depth,
    int has_coverage, real weight_r, real weight_g, real weight_b, real floor_y, long start,
    __global real *out_packed, __global int *out_invalid, __global float *out_range)
{
    const int y = get_global_id(0);
    const size_t area = (size_t)width * height;
    __global const float *row = frame + (size_t)y * width;
    __global real *out = out_packed + start + (size_t)(y + BORDER) * PLANES * pitch + BORDER;
    __global const float *r = row + source[0] * area, *g = row + source[1] * area, *b = row + source[2] * area;
    __global const float *coverage = row + source[has_coverage ? 3 + F + quiet : 0] * area;
    int invalid = 0;
    for (int x = 0; x < width; x++) {
        int valid = finite(r[x]) && finite(g[x]) && finite(b[x]);
        for (int j = 0; j < F; j++) valid = valid && finite(row[source[3 + j] * area + x]);
        for (int j = 0; j < quiet; j++) valid = valid && finite(row[source[3 + F + j] * area + x]);
        if (has_coverage) valid = valid && finite(coverage[x]);
        const int hit = !has_coverage || coverage[x] > 0;
        invalid += !valid;
        const real luminance = weight_r * r[x] + weight_g * g[x] + weight_b * b[x];
        out[x] = valid;
        out[pitch + x] = valid ? response(luminance < BIG ? luminance : BIG, floor_y) : 0;
        for (int j = 0; j < F; j++) {
            real v = row[source[3 + j] * area + x];
            // The depth of a miss is its window's largest: a mark that every minimum with that depth removes.
            if (MISSES && j == DEPTH && !hit) v = BIG;
            out[(FEATURE + j) * pitch + x] = valid ? v : 0;
        }
    }
    out_invalid[y] = invalid;
    for (int j = 0; j < quiet; j++) {
        __global const float *plane = row + source[3 + F + j] * area;
        float lo = INFINITY, hi = -INFINITY;
        for (int x = 0; x < width; x++) {
            if (out[x] == 0 || (j == quiet_depth && has_coverage && !(coverage[x] > 0))) continue;
            lo = plane[x] < lo ? plane[x] : lo;
            hi = plane[x] > hi ? plane[x] : hi;
        }
        out_range[(y * quiet + j) * 2] = lo;
        out_range[(y * quiet + j) * 2 + 1] = hi;
    }
}
