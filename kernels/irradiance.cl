// Smoothed irradiance: what a surface receives varies slowly, what it reflects does not. Luminance is divided by albedo,
// averaged over neighbours of the same surface (a cross-bilateral window), and multiplied by the centre's albedo again.
//
// Shadows have edges that no depth and no normal shows. So the window's mean gives way to that of its inner 3x3 pixels,
// and that to the pixel itself, each by the share of the difference that noise does not explain:
// max(0, 1 - EXCESS * noise / energy), both measured in the 9x9 pixels around. Noise is the lesser of two estimates from
// second differences: those across second differences see no upright and no level edge (Immerkaer, CVIU 1996), the least
// of a pixel's four sees none that is straight for three pixels.
//
// Build macros: REACH (half the window's side), HAS_COVERAGE, HAS_SAMPLES, HAS_EMISSION, FINE_NOISE and COARSE_NOISE (the
// variance of both details where irradiance is noise of variance 1).
// exp2_fraction(f) = 2^f for |f| <= 1/2 comes from clsim/detect/irradiance.py as a polynomial.
//
// The packed image has these planes after mask and brightness (which is luminance here); all are 0 where the mask is.
#define P_E (FEATURE + 0)        // irradiance, up to a constant: (luminance - emission) / reflectance
#define P_USABLE (FEATURE + 1)   // 1 where it is known
#define P_NORMAL (FEATURE + 2)   // x, y, z
#define P_DEPTH (FEATURE + 5)
#define P_HIT (FEATURE + 6)      // 1 where depth and normal are known
#define P_REFLECTANCE (FEATURE + 7)
#define P_EMISSION (FEATURE + 8)

// The planes of a frame, in the order of `source`.
#define IN_ALBEDO 3
#define IN_NORMAL 6
#define IN_DEPTH 9
#define IN_COVERAGE 10
#define IN_EMISSION (10 + HAS_COVERAGE)
#define IN_SAMPLES (IN_EMISSION + HAS_EMISSION)
#define MEANS IN_SAMPLES   // planes that must be finite

#define LEAST_REFLECTANCE ((real)1e-3)   // darker surfaces tell nothing of the light
#define LOG2_E ((real)1.4426950408889634)
#define CUT (20 * LOG2_E)                // weights below exp(-20) are 0: one surface does not mix with another
#define NORMAL_SHARE (LOG2_E / (2 * (real)0.2 * (real)0.2))

// What `smooth` finds, an image like the packed one: borders of BORDER, 0 where nothing is known.
#define DETAIL_PLANES 3
#define D_MEAN 0     // the window's mean irradiance
#define D_COARSE 1   // inner 3x3 pixels less the window
#define D_REST 2     // the pixel less the window
// Sums over 2 * BOX_REACH + 1 pixels of a row, alike: squares of the coarse detail and of the fine one, which is the pixel
// less its inner 3x3, and the estimates of noise.
#define ENERGY_PLANES 4
#define N_COARSE 0
#define N_FINE 1
#define N_TWICE 2
#define N_LEAST 3
#define LEAST_OF_FOUR ((real)1.678)   // mean of the least square of four second differences of normal noise
#define BOX_REACH 4
#define EXCESS ((real)2)

#if VW == 1
typedef bits bitsv;
#define AS_BITSV AS_BITS
#define AS_REALV AS_REAL
#elif defined(DOUBLE)
#define AS_BITSV JOIN(as_long, VW)
#define AS_REALV JOIN(as_double, VW)
#else
#define AS_BITSV JOIN(as_int, VW)
#define AS_REALV JOIN(as_float, VW)
#endif
// Added to a number, it leaves the nearest integer in the lowest bits.
#define ROUNDER ((real)1.5 * ((bits)1 << MANTISSA))

static inline realv exp2_negative(realv q) {
    const realv t = -q, shifted = t + ROUNDER;
    return AS_REALV(AS_BITSV(exp2_fraction(t - (shifted - ROUNDER))) + (AS_BITSV(shifted) << MANTISSA));
}

// Work-item: a row, plane by plane in loops that compilers vectorise. `frame` holds planes of width·height floats.
// out_invalid: pixels of the row with values that are no numbers.
__kernel void demodulate(
    __global const float *restrict frame, __constant int *source, int width, int height, int pitch, real weight_r,
    real weight_g, real weight_b, real scale, __global real *restrict out_packed, __global int *restrict out_invalid)
{
    const int y = get_global_id(0);
    const size_t area = (size_t)width * height;
    __global const float *restrict row = frame + (size_t)y * width;
    __global real *restrict mask = out_packed + (size_t)(y + BORDER) * PLANES * pitch + BORDER;
    for (int x = 0; x < width; x++) mask[x] = 1;
    for (int j = 0; j < MEANS; j++) {
        __global const float *restrict in = row + source[j] * area;
        for (int x = 0; x < width; x++) mask[x] = in[x] - in[x] == 0 ? mask[x] : 0;
    }
    real valid = 0;
    for (int x = 0; x < width; x++) valid += mask[x];
    out_invalid[y] = width - (int)valid;

    __global const float *restrict r = row + source[0] * area, *restrict g = row + source[1] * area;
    __global const float *restrict b = row + source[2] * area;
    __global real *restrict luminance = mask + BRIGHTNESS * pitch;
    for (int x = 0; x < width; x++) {
        const real value = scale * (weight_r * r[x] + weight_g * g[x] + weight_b * b[x]);
        luminance[x] = mask[x] > 0 ? MIN(value, (real)BIG) : 0;
    }
    __global real *restrict emission = mask + P_EMISSION * pitch;
#if HAS_EMISSION
    __global const float *restrict shining = row + source[IN_EMISSION] * area;
    for (int x = 0; x < width; x++) emission[x] = mask[x] > 0 ? MIN(scale * shining[x], (real)BIG) : 0;
#endif
    __global real *restrict hit = mask + P_HIT * pitch;
#if HAS_COVERAGE
    __global const float *restrict coverage = row + source[IN_COVERAGE] * area;
    for (int x = 0; x < width; x++) hit[x] = coverage[x] > 0 ? mask[x] : 0;
#else
    for (int x = 0; x < width; x++) hit[x] = mask[x];
#endif
    r = row + source[IN_ALBEDO] * area, g = row + source[IN_ALBEDO + 1] * area, b = row + source[IN_ALBEDO + 2] * area;
    __global real *restrict reflectance = mask + P_REFLECTANCE * pitch;
    for (int x = 0; x < width; x++) {
        real albedo = weight_r * r[x] + weight_g * g[x] + weight_b * b[x];
#if HAS_COVERAGE
        albedo *= coverage[x];
#endif
        reflectance[x] = mask[x] > 0 ? MIN(albedo, (real)BIG) : 0;
    }
    __global real *restrict irradiance = mask + P_E * pitch, *restrict usable = mask + P_USABLE * pitch;
#if HAS_SAMPLES
    __global const float *restrict samples = row + source[IN_SAMPLES] * area;
#endif
    for (int x = 0; x < width; x++) {
        const real known = reflectance[x] > LEAST_REFLECTANCE ? (real)1 : (real)0;
        const real light = luminance[x] - emission[x];
        const real e = (light > 0 ? light : 0) / (known > 0 ? reflectance[x] : 1);
#if HAS_SAMPLES
        usable[x] = samples[x] > 0 ? known : 0;
#else
        usable[x] = known;
#endif
        irradiance[x] = usable[x] > 0 ? MIN(e, (real)LARGEST_LUMINANCE) : 0;
    }
    for (int j = 0; j < 4; j++) {
        __global const float *restrict in = row + source[IN_NORMAL + j] * area;
        __global real *restrict out = mask + (P_NORMAL + j) * pitch;
        for (int x = 0; x < width; x++) out[x] = hit[x] > 0 ? in[x] : 0;
    }
}

static inline realv size_of(realv v) { return v > 0 ? v : -v; }

// Half the difference of depth between the neighbours `step` values away, 0 unless both are known; its absolute value.
static inline realv depth_slope(__global const real *centre, long step, int pitch) {
    __global const real *before = centre - step, *after = centre + step;
    const realv both = LOAD(before + P_HIT * pitch) * LOAD(after + P_HIT * pitch);
    const realv rise = (real)0.5 * (LOAD(after + P_DEPTH * pitch) - LOAD(before + P_DEPTH * pitch));
    return both > 0 ? size_of(rise) : (realv)0;
}

// VW neighbours; out_error only if asked for.
static inline __attribute__((always_inline)) void smooth(
    __global const real *packed, int pitch, int span, const int with_error, __global real *out_details,
    __global real *out_error)
{
    const int x = get_global_id(0) * VW, y = get_global_id(1);
    const long row_size = (long)PLANES * pitch;
    __global const real *centre = packed + (y + BORDER) * row_size + BORDER + x;
    const realv e_centre = LOAD(centre + P_E * pitch), depth = LOAD(centre + P_DEPTH * pitch);
    const realv nx = LOAD(centre + P_NORMAL * pitch), ny = LOAD(centre + (P_NORMAL + 1) * pitch);
    const realv nz = LOAD(centre + (P_NORMAL + 2) * pitch);

    // How much depth may differ at each distance, inverted; sqrt(log2(e) / 2) makes its square an exponent of 2.
    const realv slope_x = depth_slope(centre, 1, pitch), slope_y = depth_slope(centre, row_size, pitch);
    const realv least = (real)0.02 * size_of(depth) + (real)1e-6;
    realv sharpness[REACH + 1][REACH + 1];
    for (int dy = 0; dy <= REACH; dy++)
#pragma unroll
        for (int dx = 0; dx <= REACH; dx++)
            sharpness[dy][dx] = (real)0.84932180028801907 / (least + slope_x * (real)dx + slope_y * (real)dy);

    const real share = LOG2_E * 2 / (REACH * REACH);   // the window's sigma is half its reach
    realv total = 0, sum = 0, inner_total = 0, inner_sum = 0, squares = 0, spread = 0;
    for (int dy = -REACH; dy <= REACH; dy++) {
        __global const real *row = centre + dy * row_size - REACH;
        const int row_distance = dy < 0 ? -dy : dy;
#pragma unroll
        for (int i = 0; i <= 2 * REACH; i++) {
            const int dx = i - REACH;
            const realv a = LOAD(row + P_NORMAL * pitch + i) - nx, b = LOAD(row + (P_NORMAL + 1) * pitch + i) - ny;
            const realv c = LOAD(row + (P_NORMAL + 2) * pitch + i) - nz;
            const realv d = (LOAD(row + P_DEPTH * pitch + i) - depth) * sharpness[row_distance][dx < 0 ? -dx : dx];
            const realv q = NORMAL_SHARE * (a * a + b * b + c * c) + d * d + share * (real)(dx * dx + dy * dy);
            const realv near = q < CUT ? LOAD(row + P_USABLE * pitch + i) : (realv)0;   // not if q is no number
            const realv w = near * exp2_negative(q < CUT ? q : (realv)CUT);
            const realv off = LOAD(row + P_E * pitch + i) - e_centre;
            total += w;
            sum += w * off;
            if (row_distance <= 1 && dx >= -1 && dx <= 1) {
                inner_total += w;
                inner_sum += w * off;
            }
            if (with_error) {
                squares += w * w;
                spread += w * off * off;
            }
        }
    }
    const realv each = (real)1 / (total > 0 ? total : (realv)1), mean = sum * each;
    const realv inner = inner_sum / (inner_total > 0 ? inner_total : (realv)1);
    const realv usable = LOAD(centre + P_USABLE * pitch), e = total > 0 ? e_centre + mean : (realv)0;
    __global real *out = out_details + (y + BORDER) * (long)DETAIL_PLANES * pitch + BORDER + x;
    STORE(out + D_MEAN * pitch, e);
    STORE(out + D_COARSE * pitch, usable * (inner - mean));
    STORE(out + D_REST * pitch, usable * -mean);
    if (with_error) {
        const realv reflectance = LOAD(centre + P_REFLECTANCE * pitch), emission = LOAD(centre + P_EMISSION * pitch);
        const realv shown = emission + e * reflectance;
        realv variance = spread * each - mean * mean;
        variance = variance > 0 ? variance : (realv)0;
        const realv others = total * total / (squares > 0 ? squares : (realv)1) - 1;
        variance /= others > 1 ? others : (realv)1;
        realv deviation;
        for (int lane = 0; lane < VW; lane++) ((real *)&deviation)[lane] = sqrt(((real *)&variance)[lane]);
        const realv error = deviation * reflectance / (shown > 0 ? shown : (realv)1);
        STORE(out_error + (size_t)y * span + x, reflectance > LEAST_REFLECTANCE ? error : (realv)0);
    }
}

// Work-item: VW neighbours. out_details: [H + 2 BORDER][DETAIL_PLANES][pitch]; out_error: [H][span].
__kernel void smooth_plain(__global const real *packed, int pitch, int span, __global real *out_details)
{
    smooth(packed, pitch, span, 0, out_details, out_details);
}

__kernel void smooth_with_error(
    __global const real *packed, int pitch, int span, __global real *out_details, __global real *out_error)
{
    smooth(packed, pitch, span, 1, out_details, out_error);
}

// Work-item: a row. out_energies: [H][ENERGY_PLANES][pitch]; out_sums: [H + 2 BORDER][ENERGY_PLANES][pitch].
__kernel void sum_energies(
    __global const real *packed, __global const real *details, int width, int pitch,
    __global real *restrict out_energies, __global real *restrict out_sums)
{
    const int y = get_global_id(0);
    const long row_size = (long)DETAIL_PLANES * pitch;
    __global const real *usable = packed + ((y + BORDER) * (long)PLANES + P_USABLE) * pitch + BORDER;
    __global const real *coarse = details + (y + BORDER) * row_size + D_COARSE * pitch + BORDER;
    __global const real *here = coarse + (D_REST - D_COARSE) * pitch;
    __global const real *above = here - row_size, *below = here + row_size;
    __global real *restrict energy = out_energies + (long)y * ENERGY_PLANES * pitch + BORDER;
    for (int x = 0; x < width; x++) {
        const real fine = here[x] - coarse[x], centre = 2 * here[x];
        const real sides = here[x - 1] + here[x + 1], ends = above[x] + below[x];
        const real rising = above[x + 1] + below[x - 1], falling = above[x - 1] + below[x + 1];
        const real twice = rising + falling + 2 * centre - 2 * (sides + ends);
        const real across = (sides - centre) * (sides - centre), down = (ends - centre) * (ends - centre);
        const real up = (rising - centre) * (rising - centre), off = (falling - centre) * (falling - centre);
        const real straight = MIN(across, down), slanted = MIN(up, off);
        energy[x + N_COARSE * pitch] = coarse[x] * coarse[x];
        energy[x + N_FINE * pitch] = fine * fine;
        energy[x + N_TWICE * pitch] = usable[x] * twice * twice * ((real)1 / 36);
        energy[x + N_LEAST * pitch] = usable[x] * MIN(straight, slanted) * (1 / LEAST_OF_FOUR);
    }
    __global real *restrict out = out_sums + (y + BORDER) * (long)ENERGY_PLANES * pitch + BORDER;
    for (int j = 0; j < ENERGY_PLANES; j++)
        for (int x = 0; x < width; x++) {
            __global const real *in = energy + j * pitch + x;
            real sum = 0;
#pragma unroll
            for (int dx = -BOX_REACH; dx <= BOX_REACH; dx++) sum += in[dx];
            out[j * pitch + x] = sum;
        }
}

// The share of a detail that is more than noise.
static inline realv share_of(realv energy, realv noise) {
    const realv share = 1 - EXCESS * noise / (energy > (real)SMALLEST ? energy : (realv)(real)SMALLEST);
    return share > 0 ? share : (realv)0;
}

// Work-item: VW neighbours. out_level: [H][span].
__kernel void level_of_details(
    __global const real *packed, __global const real *details, __global const real *sums, int pitch, int span,
    __global real *out_level)
{
    const int x = get_global_id(0) * VW, y = get_global_id(1);
    realv energy[ENERGY_PLANES];
    for (int j = 0; j < ENERGY_PLANES; j++) {
        __global const real *in = sums + ((y + BORDER) * (long)ENERGY_PLANES + j) * pitch + BORDER + x;
        energy[j] = 0;
        for (int dy = -BOX_REACH; dy <= BOX_REACH; dy++) energy[j] += LOAD(in + dy * (long)ENERGY_PLANES * pitch);
    }
    __global const real *detail = details + (y + BORDER) * (long)DETAIL_PLANES * pitch + BORDER + x;
    const realv noise = MIN(energy[N_TWICE], energy[N_LEAST]);
    const realv coarse_share = share_of(energy[N_COARSE], (real)COARSE_NOISE * noise);
    const realv fine_share = share_of(energy[N_FINE], (real)FINE_NOISE * noise);
    const realv coarse = LOAD(detail + D_COARSE * pitch), fine = LOAD(detail + D_REST * pitch) - coarse;
    const realv e = LOAD(detail + D_MEAN * pitch) + coarse_share * (coarse + fine_share * fine);
    __global const real *centre = packed + (y + BORDER) * (long)PLANES * pitch + BORDER + x;
    const realv reflectance = LOAD(centre + P_REFLECTANCE * pitch), emission = LOAD(centre + P_EMISSION * pitch);
    const realv shown = reflectance > LEAST_REFLECTANCE ? emission + e * reflectance : LOAD(centre + BRIGHTNESS * pitch);
    realv level;
    for (int lane = 0; lane < VW; lane++) {
        const real value = ((real *)&shown)[lane];
        ((real *)&level)[lane] = response(value < (real)BIG ? value : (real)BIG, (real)FLOOR_Y);
    }
    STORE(out_level + (size_t)y * span + x, level);
}
