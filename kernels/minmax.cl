// Extremes of each feature over each pixel's window, as two passes: along columns, then along rows.
//
// Build macros: REACH, STEP, TAPS = 2·REACH/STEP + 1, RUN (vectors of a row that one work-item handles).
// Only valid pixels count, and of depth only those that see something. Where none does, lo = BIG and hi = -BIG remain.
// Neither pass costs more for a larger window, or much more.

// Work-item: VW columns of one feature, all the way down. out: [H][2F][pitch], lo then hi of each feature; columns
// outside the image are not written: the host filled them with BIG and -BIG.
// A window of TAPS rows is the end of one block of TAPS rows and the beginning of the next, so running extremes from
// both sides are enough (van Herk, "A fast algorithm for local minimum and maximum filters", 1992).
__kernel void minmax_columns(
    __global const real *packed, long start, int pitch, int height, __global real *out_columns)
{
    const int x = get_global_id(0) * VW, j = get_global_id(1);
    const long packed_row = (long)PLANES * pitch, out_row = 2L * F * pitch;
    __global real *out = out_columns + 2L * j * pitch + BORDER + x;
    for (int phase = 0; phase < STEP && phase < height; phase++) {
        // Rows phase - REACH, then every STEP-th: outside the image their mask is 0.
        __global const real *in = packed + start + (BORDER + phase - REACH) * packed_row + BORDER + x;
        realv lo[TAPS], hi[TAPS];
#define READ_ROW(i)                                                                                                    \
        {                                                                                                              \
            const realv mask = LOAD(in), v = LOAD(in + (FEATURE + j) * pitch);                                         \
            lo[i] = mask > 0 ? v : (realv)BIG;                                                                         \
            hi[i] = mask > 0 ? v : (realv)-BIG;                                                                        \
            if (MISSES && j == DEPTH) hi[i] = hi[i] < (realv)BIG ? hi[i] : (realv)-BIG;                                \
            in += STEP * packed_row;                                                                                   \
        }
        for (int i = 0; i < TAPS; i++) READ_ROW(i)
        for (int y = phase; y < height;) {
            for (int i = TAPS - 2; i >= 0; i--) {
                lo[i] = MIN(lo[i], lo[i + 1]);
                hi[i] = MAX(hi[i], hi[i + 1]);
            }
            realv next_lo = BIG, next_hi = -BIG;
            for (int i = 0; i < TAPS && y < height; i++, y += STEP) {
                const realv least = MIN(lo[i], next_lo), most = MAX(hi[i], next_hi);
                STORE(out + y * out_row, least);
                STORE(out + y * out_row + pitch, most);
                READ_ROW(i)
                next_lo = MIN(next_lo, lo[i]);
                next_hi = MAX(next_hi, hi[i]);
            }
        }
    }
}

// Work-item: RUN vectors of one row of one feature. out_extremes: [H][2F][span].
// Extremes of 2, 4, 8 … neighbours, each from two of the kind before; the last two may overlap.
__kernel void minmax_rows(
    __global const real *columns, int pitch, int span, long start, __global real *out_extremes)
{
    const int x = get_global_id(0) * RUN * VW, row = get_global_id(1);
    const int vectors = MIN(RUN, (span - x) / VW);
    // Rows alternate lo and hi, and there are 2F of them for each y.
    const int high = row % 2;
    __global const real *in = columns + (long)row * pitch + BORDER + x - REACH;
    __global real *out = out_extremes + start + (long)row * span + x;
    real m[(RUN + 2) * VW + 2 * REACH];
    const int count = vectors + (2 * REACH + VW - 1) / VW;
#define PRIVATE(i) (*(loadv_private *)(m + (i)))
    for (int i = 0; i < count; i++) PRIVATE(i * VW) = high ? -LOAD(in + i * VW) : LOAD(in + i * VW);
    int length = 1;
#pragma unroll
    for (; 2 * length <= TAPS; length *= 2)
        for (int i = 0; i < count; i++) {
            const realv a = PRIVATE(i * VW), b = PRIVATE(i * VW + length * STEP);
            PRIVATE(i * VW) = MIN(a, b);
        }
    for (int i = 0; i < vectors; i++) {
        const realv a = PRIVATE(i * VW), b = PRIVATE(i * VW + (TAPS - length) * STEP);
        const realv least = MIN(a, b);
        STORE(out + i * VW, high ? -least : least);
    }
}
