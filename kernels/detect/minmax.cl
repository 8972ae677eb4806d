// Extremes of each feature over each pixel's window, as two passes: along columns, then along rows.
//
// Build macros: REACH, STEP, TAPS = 2·REACH/STEP + 1, RUN and STRIP (vectors of a row that one
// work-item handles in the pass along rows and along columns).
// Only valid pixels count, and of depth only those that see something. Where none does, lo = BIG and hi = -BIG remain.
// Neither pass costs more for a larger window, or much more.

#include "detect/packed.clh"

// Work-item: STRIP·VW columns of one feature, all the way down. out: [H][2F][pitch], lo then hi of each feature;
// columns outside the image are not written: the host filled them with BIG and -BIG.
// A window of TAPS rows is the end of one block of TAPS rows and the beginning of the next, so running extremes from
// both sides are enough (van Herk, "A fast algorithm for local minimum and maximum filters", 1992).
// Several vectors of a row are read together, because the next row is kilobytes away.
static inline __attribute__((always_inline)) void read_row(
    __global const real *row, int vectors, int pitch, int feature, realv *out_lo, realv *out_hi)
{
    for (int k = 0; k < vectors; k++) {
        const realv mask = LOAD(row + k * VW), v = LOAD(row + (FEATURE + feature) * pitch + k * VW);
        out_lo[k] = mask > 0 ? v : (realv)BIG;
        const realv high = mask > 0 ? v : (realv)-BIG;
        out_hi[k] = MISSES && feature == DEPTH ? (high < (realv)BIG ? high : (realv)-BIG) : high;
    }
}

__kernel void minmax_columns(
    __global const real *packed, long start, int pitch, int span, int height, __global real *out_columns)
{
    const int x = get_global_id(0) * STRIP * VW, j = get_global_id(1);
    const int vectors = MIN(STRIP, (span - x) / VW);
    const long packed_row = (long)PLANES * pitch, out_row = 2L * F * pitch;
    __global real *out = out_columns + 2L * j * pitch + BORDER + x;
    for (int phase = 0; phase < STEP && phase < height; phase++) {
        // Rows phase - REACH, then every STEP-th: outside the image their mask is 0.
        __global const real *in = packed + start + (BORDER + phase - REACH) * packed_row + BORDER + x;
        realv lo[TAPS][STRIP], hi[TAPS][STRIP];
        for (int i = 0; i < TAPS; i++, in += STEP * packed_row) read_row(in, vectors, pitch, j, lo[i], hi[i]);
        for (int y = phase; y < height;) {
            for (int i = TAPS - 2; i >= 0; i--)
                for (int k = 0; k < vectors; k++) {
                    lo[i][k] = MIN(lo[i][k], lo[i + 1][k]);
                    hi[i][k] = MAX(hi[i][k], hi[i + 1][k]);
                }
            realv next_lo[STRIP], next_hi[STRIP];
            for (int k = 0; k < vectors; k++) {
                next_lo[k] = BIG;
                next_hi[k] = -BIG;
            }
            for (int i = 0; i < TAPS && y < height; i++, y += STEP, in += STEP * packed_row) {
                for (int k = 0; k < vectors; k++) {
                    const realv least = MIN(lo[i][k], next_lo[k]), most = MAX(hi[i][k], next_hi[k]);
                    STORE(out + y * out_row + k * VW, least);
                    STORE(out + y * out_row + pitch + k * VW, most);
                }
                read_row(in, vectors, pitch, j, lo[i], hi[i]);
                for (int k = 0; k < vectors; k++) {
                    next_lo[k] = MIN(next_lo[k], lo[i][k]);
                    next_hi[k] = MAX(next_hi[k], hi[i][k]);
                }
            }
        }
    }
}

// Work-item: RUN vectors of one row, all features. out_extremes: [H][2F][span].
// Extremes of 2, 4, 8 … neighbours, each from two of the kind before; the last two may overlap. One step is taken for
// all features before the next, so that what is loaded askew was not stored just before (CPUs stall on that).
#define PRIVATE(row, i) (*(loadv_private *)(m[row] + (i)))
__kernel void minmax_rows(__global const real *columns, int pitch, int span, long start, __global real *out_extremes)
{
    const int x = get_global_id(0) * RUN * VW, y = get_global_id(1);
    const int vectors = MIN(RUN, (span - x) / VW), count = vectors + (2 * REACH + VW - 1) / VW;
    __global const real *in = columns + 2L * F * y * pitch + BORDER + x - REACH;
    __global real *out = out_extremes + start + 2L * F * y * span + x;
    real m[2 * F][(RUN + 2) * VW + 4 * REACH];
    // Rows of hi alternate with rows of lo: the largest value is the smallest with its sign turned.
    for (int row = 0; row < 2 * F; row++)
        for (int i = 0; i < count; i++) PRIVATE(row, i * VW) = (real)(row % 2 ? -1 : 1) * LOAD(in + row * pitch + i * VW);
    int length = 1;
    for (; 2 * length <= TAPS; length *= 2)
        for (int row = 0; row < 2 * F; row++)
            for (int i = 0; i < count; i++) {
                const realv a = PRIVATE(row, i * VW), b = PRIVATE(row, i * VW + length * STEP);
                PRIVATE(row, i * VW) = MIN(a, b);
            }
    for (int row = 0; row < 2 * F; row++)
        for (int i = 0; i < vectors; i++) {
            const realv a = PRIVATE(row, i * VW), b = PRIVATE(row, i * VW + (TAPS - length) * STEP);
            STORE(out + row * span + i * VW, (real)(row % 2 ? -1 : 1) * MIN(a, b));
        }
}
