// Weighted local regression: y ~ alpha + beta.(x - x_c) over each pixel's window (Moon et al., ToG 2014; Tsuji et al.,
// ICIP 2023, section 2.1).
//
// Build macros: REACH, STEP, TAPS = 2·REACH/STEP + 1 (samples of the window along one axis), TILE, EPANECHNIKOV.
// root(q) = exp(-q / (4 h^2)), the root of the Gaussian weight, comes from clsim/detect/wlr.py as a polynomial.
// Differences are taken from the centre pixel before anything is multiplied, so that large offsets (depth 1e6 + [0, 1])
// cost no digits.

// Products are summed for the staged columns v, v·dx, v·x_1 … v·x_F, v·y, where v is the root of the weight. Pixel y is
// constant along a row, so its moments come from row sums.
#define ONE 0
#define DX 1
#define COLUMN 2
#define Y (F + 2)
#define STAGED (F + 3)
#define BLOCKS ((STAGED + TILE - 1) / TILE)

typedef struct {
    __global const real *packed;      // all packed frames
    __global const real *extremes;    // and the extremes of their windows
    long packed_size, extremes_size;  // from one frame to the next
    int frames, slot, slots;          // frames of the history in use, the newest one's slot, slots in all
    int pitch, span, width, height;
    int any_invalid;
    real inverse_h, ridge, shrink;
} Input;

static inline __global const real *packed_of(const Input *in, int age) {
    return in->packed + in->packed_size * ((in->slot - age + in->slots) % in->slots);
}

static inline __global const real *extremes_of(const Input *in, int age) {
    return in->extremes + in->extremes_size * ((in->slot - age + in->slots) % in->slots);
}

// Where the VW pixels are: neighbours from (x[0], y[0]) on if dense, else each at its own place.
typedef struct { int x[VW], y[VW]; } Place;

static inline __attribute__((always_inline)) realv fetch(
    __global const real *image, long offset, long row_size, const Place *at, const int dense)
{
    if (dense) return LOAD(image + at->y[0] * row_size + at->x[0] + offset);
    realv v;
    for (int lane = 0; lane < VW; lane++) ((real *)&v)[lane] = image[at->y[lane] * row_size + at->x[lane] + offset];
    return v;
}

#define ROW (2 * REACH + 1)
#if VW == 1
#define ROW_ROOM ROW
#else
#define ROW_ROOM ((ROW + VW - 1) / VW * VW)
#endif

// One row of VW windows, pixel by pixel: out_row[i] has tap i of every window. `plane_row` points at the left ends for
// a pixel at (0, 0). Where pixels are scattered, each window's row is loaded whole and the block transposed in registers.
static inline __attribute__((always_inline)) void gather_row(
    __global const real *plane_row, long row_size, const Place *at, realv *out_row)
{
#if VW == 1
    for (int i = 0; i < ROW; i++) out_row[i] = plane_row[at->y[0] * row_size + at->x[0] + i];
#else
    for (int first = 0; first < ROW; first += VW) {
        realv a[VW], b[VW];
#pragma unroll
        for (int lane = 0; lane < VW; lane++) a[lane] = LOAD(plane_row + at->y[lane] * row_size + at->x[lane] + first);
#pragma unroll
        for (int stage = 1; stage < VW; stage *= 2) {
#pragma unroll
            for (int i = 0; i < VW / 2; i++) {
                b[2 * i].even = a[i].lo;
                b[2 * i].odd = a[i + VW / 2].lo;
                b[2 * i + 1].even = a[i].hi;
                b[2 * i + 1].odd = a[i + VW / 2].hi;
            }
#pragma unroll
            for (int i = 0; i < VW; i++) a[i] = b[i];
        }
#pragma unroll
        for (int i = 0; i < VW; i++) out_row[first + i] = a[i];
    }
#endif
}

// Fits VW windows. out_fit: alpha, then beta of pixel x, pixel y and each feature.
static inline __attribute__((always_inline)) void fit(const Input *in, const Place *at, const int dense, realv *out_fit)
{
    const long row_size = (long)PLANES * in->pitch;
    const long border = BORDER * row_size + BORDER, centre_at = at->y[0] * row_size + at->x[0];
    realv centre[F + 1], scale[F + 1], hi_depth = 0;
    const realv y_centre = fetch(packed_of(in, 0), border + BRIGHTNESS * in->pitch, row_size, at, dense);
    for (int j = 0; j < F; j++) {
        realv lo = BIG, hi = -BIG;
        for (int age = 0; age < in->frames; age++) {
            const long place = 2 * j * in->span, size = (long)2 * F * in->span;
            const realv low = fetch(extremes_of(in, age), place, size, at, dense);
            const realv high = fetch(extremes_of(in, age), place + in->span, size, at, dense);
            lo = MIN(lo, low);
            hi = MAX(hi, high);
        }
        const realv some = lo > hi ? (realv)0 : (realv)1;
        lo = some > 0 ? lo : (realv)0;
        hi = some > 0 ? hi : (realv)0;
        const realv range = hi - lo, low = lo > 0 ? lo : -lo, high = hi > 0 ? hi : -hi;
        const realv limit = MAX(low, high) * (real)1e-6 + (real)SMALLEST;
        scale[j] = range > limit ? (real)1 / range : (realv)0;
        centre[j] = fetch(packed_of(in, 0), border + (FEATURE + j) * in->pitch, row_size, at, dense);
        if (MISSES && j == DEPTH) {
            centre[j] = MIN(centre[j], hi);
            hi_depth = hi;
        }
    }

    // Extent of the samples along x and y: the window, clipped at the image; counted where pixels are missing too.
    realv x_lo, x_hi, y_lo, y_hi;
    if (in->any_invalid) {
        realv column[TAPS];
        for (int i = 0; i < TAPS; i++) column[i] = 0;
        y_lo = x_lo = REACH;
        y_hi = x_hi = -REACH;
        for (int age = 0; age < in->frames; age++)
            for (int dy = -REACH; dy <= REACH; dy += STEP) {
                __global const real *row_start = packed_of(in, age) + border + dy * row_size - REACH;
                realv any = 0, gathered[ROW_ROOM];
                if (!dense) gather_row(row_start, row_size, at, gathered);
                for (int i = 0; i < TAPS; i++) {
                    const realv mask = dense ? LOAD(row_start + centre_at + i * STEP) : gathered[i * STEP];
                    any = MAX(any, mask);
                    column[i] = MAX(column[i], mask);
                }
                const realv row = (real)dy;
                y_lo = any > 0 ? MIN(y_lo, row) : y_lo;
                y_hi = any > 0 ? MAX(y_hi, row) : y_hi;
            }
        for (int i = 0; i < TAPS; i++) {
            const realv dx = (real)(i * STEP - REACH);
            x_lo = column[i] > 0 ? MIN(x_lo, dx) : x_lo;
            x_hi = column[i] > 0 ? MAX(x_hi, dx) : x_hi;
        }
    } else {
        for (int lane = 0; lane < VW; lane++) {
            const int left = at->x[lane] / STEP * STEP, right = (in->width - 1 - at->x[lane]) / STEP * STEP;
            const int up = at->y[lane] / STEP * STEP, down = (in->height - 1 - at->y[lane]) / STEP * STEP;
            ((real *)&x_lo)[lane] = -MIN(left, REACH);
            ((real *)&x_hi)[lane] = MIN(right, REACH);
            ((real *)&y_lo)[lane] = -MIN(up, REACH);
            ((real *)&y_hi)[lane] = MIN(down, REACH);
        }
    }
    const realv scale_x = x_hi > x_lo ? (real)1 / (x_hi - x_lo) : (realv)0;
    const realv scale_y = y_hi > y_lo ? (real)1 / (y_hi - y_lo) : (realv)0;

    realv sum[STAGED][STAGED], along_y[STAGED], yy = 0, noise = 0;
    for (int a = 0; a < STAGED; a++) {
        along_y[a] = 0;
        for (int b = 0; b < STAGED; b++) sum[a][b] = 0;
    }
    for (int age = 0; age < in->frames; age++)
        for (int dy = -REACH; dy <= REACH; dy += STEP) {
            __global const real *row_start = packed_of(in, age) + border + dy * row_size - REACH;
            realv staged[TAPS][STAGED], gathered[PLANES][ROW_ROOM];
            if (!dense)
                for (int j = 0; j < PLANES; j++) gather_row(row_start + j * in->pitch, row_size, at, gathered[j]);
#define TAP(plane) (dense ? LOAD(row_start + centre_at + (plane) * in->pitch + i * STEP) : gathered[plane][i * STEP])
            for (int i = 0; i < TAPS; i++) {
                const real dx = i * STEP - REACH;
                const realv mask = TAP(MASK);
                realv d[F + 1];
#pragma unroll
                for (int j = 0; j < F; j++) {
                    realv v = TAP(FEATURE + j);
                    if (MISSES && j == DEPTH) v = MIN(v, hi_depth);
                    d[j] = (v - centre[j]) * scale[j];
                }
#ifdef EPANECHNIKOV
                realv w = mask, t = scale_x * dx * in->inverse_h, k = (real)0.75 * (1 - t * t);
                w *= MAX(k, (realv)(real)1e-8);
                t = scale_y * (real)dy * in->inverse_h;
                k = (real)0.75 * (1 - t * t);
                w *= MAX(k, (realv)(real)1e-8);
                for (int j = 0; j < F; j++) {
                    t = d[j] * in->inverse_h;
                    k = (real)0.75 * (1 - t * t);
                    w *= MAX(k, (realv)(real)1e-8);
                }
                const realv v = sqrt(w);
#else
                realv q = scale_x * scale_x * (dx * dx) + scale_y * scale_y * (real)(dy * dy);
#pragma unroll
                for (int j = 0; j < F; j++) q += d[j] * d[j];
                // root() holds for q up to D only: pixels without values are taken to 0 first.
                q *= mask;
                const realv v = root(q) * mask;
#endif
#if SHRINK
                noise += v * v * TAP(VARIANCE);
#endif
                const realv y = TAP(BRIGHTNESS);
                staged[i][ONE] = v;
                staged[i][DX] = v * dx;
#pragma unroll
                for (int j = 0; j < F; j++) staged[i][COLUMN + j] = v * d[j];
                staged[i][Y] = v * (y - y_centre);
            }
#pragma unroll
            for (int ta = 0; ta < BLOCKS; ta++)
#pragma unroll
                for (int tb = ta; tb < BLOCKS; tb++) {
                    realv tile[TILE][TILE];
#pragma unroll
                    for (int a = 0; a < TILE; a++)
#pragma unroll
                        for (int b = 0; b < TILE; b++) tile[a][b] = 0;
                    for (int i = 0; i < TAPS; i++)
#pragma unroll
                        for (int a = 0; a < TILE; a++)
#pragma unroll
                            for (int b = 0; b < TILE; b++)
                                if (tb * TILE + b < STAGED && ta * TILE + a <= tb * TILE + b)
                                    tile[a][b] += staged[i][ta * TILE + a] * staged[i][tb * TILE + b];
#pragma unroll
                    for (int a = 0; a < TILE; a++)
#pragma unroll
                        for (int b = 0; b < TILE; b++)
                            if (tb * TILE + b < STAGED && ta * TILE + a <= tb * TILE + b) {
                                sum[ta * TILE + a][tb * TILE + b] += tile[a][b];
                                if (ta + a == 0) along_y[tb * TILE + b] += tile[a][b] * (real)dy;
                                if (ta + tb + a + b == 0) yy += tile[a][b] * (real)(dy * dy);
                            }
                }
        }

    // Means and second moments of pixel x, pixel y and the features, all scaled to the window.
    const realv total = sum[ONE][ONE] > 0 ? sum[ONE][ONE] : (realv)1;
    const realv share = (real)1 / total;
    realv mean[D], m[D][D], right[D];
    mean[0] = sum[ONE][DX] * share * scale_x;
    mean[1] = along_y[ONE] * share * scale_y;
    m[0][0] = sum[DX][DX] * share * scale_x * scale_x;
    m[1][0] = along_y[DX] * share * scale_x * scale_y;
    m[1][1] = yy * share * scale_y * scale_y;
    const realv y_mean = sum[ONE][Y] * share;
    right[0] = sum[DX][Y] * share * scale_x;
    right[1] = along_y[Y] * share * scale_y;
#pragma unroll
    for (int j = 0; j < F; j++) {
        mean[2 + j] = sum[ONE][COLUMN + j] * share;
        m[2 + j][0] = sum[DX][COLUMN + j] * share * scale_x;
        m[2 + j][1] = along_y[COLUMN + j] * share * scale_y;
        right[2 + j] = sum[COLUMN + j][Y] * share;
#pragma unroll
        for (int k = 0; k <= j; k++) m[2 + j][2 + k] = sum[COLUMN + k][COLUMN + j] * share;
    }
#pragma unroll
    for (int j = 0; j < D; j++) {
        right[j] -= mean[j] * y_mean;
#pragma unroll
        for (int k = 0; k <= j; k++) m[j][k] -= mean[j] * mean[k];
        // Rounding can leave a constant feature with a variance just below 0.
        m[j][j] = (m[j][j] > 0 ? m[j][j] : (realv)0) * (1 + in->ridge) + (real)1e-12;
    }
    // LDL^T without pivoting: the ridge keeps the matrix positive. A pivot of C + ridge cannot be below the ridge
    // itself; where rounding takes it there (ridges below 1e-6 in float32), nothing is known of that direction and it
    // is left out: divided by, its rounding would grow from pivot to pivot until it overflows.
    realv inverse[D], explained = 0;
#pragma unroll
    for (int j = 0; j < D; j++) {
        realv diagonal = m[j][j], row[D];
#pragma unroll
        for (int k = 0; k < j; k++) {
            row[k] = m[j][k];
#pragma unroll
            for (int l = 0; l < k; l++) row[k] -= row[l] * m[k][l];
        }
        const real share = (real)0.5 * in->ridge / (1 + in->ridge);
        const realv least = (diagonal - (real)1e-12) * MAX(share, (real)ROUNDING);
#pragma unroll
        for (int k = 0; k < j; k++) {
            m[j][k] = row[k] * inverse[k];
            diagonal -= row[k] * m[j][k];
            right[j] -= m[j][k] * right[k];
        }
        inverse[j] = diagonal > least ? (real)1 / diagonal : (realv)0;
        explained += right[j] * right[j] * inverse[j];
    }
#pragma unroll
    for (int j = D - 1; j >= 0; j--) {
        right[j] *= inverse[j];
#pragma unroll
        for (int k = j + 1; k < D; k++) right[j] -= m[k][j] * right[k];
    }
    realv alpha = y_mean;
#pragma unroll
    for (int j = 0; j < D; j++) alpha -= right[j] * mean[j];
#if SHRINK
    // With (C + ridge) beta = c, the residual is var(y) - beta.c - beta.ridge.beta.
    realv residual = sum[Y][Y] * share - y_mean * y_mean - explained;
#pragma unroll
    for (int j = 0; j < D; j++) {
        const realv ridge = (m[j][j] - (real)1e-12) * (in->ridge / (1 + in->ridge)) + (real)1e-12;
        residual -= right[j] * right[j] * ridge;
    }
    // The pixel's own value is 0 here: as far as the residual is more than noise, the fit gives way to it. Noise is NaN
    // where a pixel of the window has no variance; then the fit stays.
    noise *= in->shrink * share;
    alpha *= residual > noise ? noise / residual : (realv)1;
#endif
    out_fit[0] = alpha + y_centre;
    out_fit[1] = right[0] * scale_x;
    out_fit[2] = right[1] * scale_y;
#pragma unroll
    for (int j = 0; j < F; j++) out_fit[3 + j] = right[2 + j] * scale[j];
}

#define INPUT_ARGUMENTS                                                                                                \
    __global const real *packed, long packed_size, __global const real *extremes, long extremes_size, int frames,      \
    int slot, int slots, int pitch, int span, int width, int height, int any_invalid, real inverse_h, real ridge, \
    real shrink
#define INPUT                                                                                                          \
    {packed, extremes, packed_size, extremes_size, frames, slot, slots, pitch, span, width, height, any_invalid,       \
     inverse_h, ridge, shrink}

// Work-item: VW neighbours. out_fit: [H][1 + D][span].
__kernel void wlr_dense(INPUT_ARGUMENTS, __global real *out_fit)
{
    const Input in = INPUT;
    Place at;
    for (int lane = 0; lane < VW; lane++) {
        at.x[lane] = get_global_id(0) * VW + lane;
        at.y[lane] = get_global_id(1);
    }
    realv result[1 + D];
    fit(&in, &at, 1, result);
    __global real *out = out_fit + (long)at.y[0] * (1 + D) * span + at.x[0];
    for (int j = 0; j <= D; j++) STORE(out + j * span, result[j]);
}

// Work-item: VW pixels of a list of y·span + x.
__kernel void wlr_sparse(INPUT_ARGUMENTS, __global const int *list, int count, __global real *out_fit)
{
    const Input in = INPUT;
    Place at;
    const int first = get_global_id(0) * VW;
    for (int lane = 0; lane < VW; lane++) {
        const int pixel = list[MIN(first + lane, count - 1)];
        at.x[lane] = pixel % span;
        at.y[lane] = pixel / span;
    }
    realv result[1 + D];
    fit(&in, &at, 0, result);
    for (int lane = 0; lane < VW; lane++) {
        if (first + lane >= count) break;
        __global real *out = out_fit + (long)at.y[lane] * (1 + D) * span + at.x[lane];
        for (int j = 0; j <= D; j++) out[j * span] = ((real *)&result[j])[lane];
    }
}
