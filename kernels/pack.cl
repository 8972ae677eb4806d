// A frame's planes become one padded, row-interleaved image of mask, log luminance and features.
//
// Build macro: LIN_LOG (1: linear below a knee, on values 0…255, as v2e has it; 0: ln).

#ifdef DOUBLE
#define AS_BITS as_long
#define AS_REAL as_double
#define MANTISSA 52
#define ROOT_HALF 0x3fe6a09e667f3bcdL   // bits of sqrt(1/2)
#define TERMS 12
#else
#define AS_BITS as_int
#define AS_REAL as_float
#define MANTISSA 23
#define ROOT_HALF 0x3f3504f3
#define TERMS 5
#endif

// ln of a positive normal number: the builtin is a call that keeps loops from being vectorised. With y = m·2^e and
// m in [sqrt(1/2), sqrt(2)), ln m = 2 atanh(s) with s = (m - 1)/(m + 1), |s| < 0.172: a short series.
static inline real natural_log(real y) {
    const bits exponent = (AS_BITS(y) - ROOT_HALF) >> MANTISSA;
    const real m = AS_REAL(AS_BITS(y) - (exponent << MANTISSA));
    const real s = (m - 1) / (m + 1), square = s * s;
    real series = (real)1 / (2 * TERMS - 1);
#pragma unroll
    for (int k = TERMS - 2; k >= 0; k--) series = series * square + (real)1 / (2 * k + 1);
    return (real)exponent * (real)0.693147180559945309 + 2 * s * series;
}

static inline real response(real y, real floor_y) {
#if LIN_LOG
    const real value = 255 * y, slope = (real)(2.995732273553991 / 20);
    return value <= 20 ? value * slope : natural_log(value > 20 ? value : 20);
#else
    return natural_log(y > floor_y ? y : floor_y);
#endif
}

// One work-item packs one row, plane by plane in loops that compilers vectorise. `frame` holds planes of width·height
// floats; `source` names them: R, G, B, the F features, then `quiet` candidates that have been constant so far, then
// coverage if has_coverage.
// Per row: number of invalid pixels, and the extremes of each quiet candidate (of depth over hits only).
__kernel void pack(
    __global const float *restrict frame, __constant int *source, int width, int height, int pitch, int quiet,
    int quiet_depth, int has_coverage, real weight_r, real weight_g, real weight_b, real floor_y, long start,
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
    real valid = 0;
    for (int x = 0; x < width; x++) valid += mask[x];
    out_invalid[y] = width - (int)valid;

    __global const float *restrict r = row + source[0] * area, *restrict g = row + source[1] * area;
    __global const float *restrict b = row + source[2] * area;
    __global real *restrict brightness = mask + BRIGHTNESS * pitch;
    for (int x = 0; x < width; x++) {
        const real luminance = weight_r * r[x] + weight_g * g[x] + weight_b * b[x];
        const real level = response(luminance < BIG ? luminance : BIG, floor_y);
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
    for (int j = 0; j < quiet; j++) {
        __global const float *restrict in = row + source[3 + F + j] * area;
        float lo = INFINITY, hi = -INFINITY;
        for (int x = 0; x < width; x++) {
            if (mask[x] == 0 || (j == quiet_depth && has_coverage && !(coverage[x] > 0))) continue;
            lo = in[x] < lo ? in[x] : lo;
            hi = in[x] > hi ? in[x] : hi;
        }
        out_range[(y * quiet + j) * 2] = lo;
        out_range[(y * quiet + j) * 2 + 1] = hi;
    }
}
