// What pixels remember of their last event: the plane that was fitted there.
//
// Build macros: CHUNK (pixels of the list that one work-item handles), RADIANCE (1: box means are there).

#include "detect/model.clh"

// Work-item: CHUNK pixels of the list, of which those that fired (fired[i] != 0) or are new take over what was fitted.
// extremes: [slots][H][2F][span]; fit: [H][1 + D][span]; model: [H][MODEL_PLANES][span].
__kernel void keep_models(
    __global const int *list, int count, __global const uchar *flags, __global const int *fired,
    __global const real *packed, long packed_size, __global const real *extremes, long extremes_size, int frames,
    int slot, int slots, int pitch, int span, __global const real *boxes, __global const real *fit,
    __global real *model)
{
    const int first = get_global_id(0) * CHUNK, last = MIN(first + CHUNK, count);
    for (int i = first; i < last; i++) {
        if (flags[list[i]] != FRESH && fired[i] == 0) continue;
        const int x = list[i] % span, y = list[i] / span;
        __global real *kept = model + (size_t)y * MODEL_PLANES * span + x;
        __global const real *f = fit + (size_t)y * (1 + D) * span + x;
        kept[M_ALPHA * span] = f[0];
        for (int j = 0; j < D; j++) kept[(M_SLOPE + j) * span] = f[(1 + j) * span];
#ifdef RADIANCE
        __global const real *box = boxes + (size_t)y * BOX_PLANES * span + x;
        real sum = box[B_BRIGHTNESS * span] - f[span] * box[B_X * span] - f[2 * span] * box[B_Y * span];
#endif
        for (int j = 0; j < F; j++) {
            real lo = BIG, hi = -BIG;
            for (int age = 0; age < frames; age++) {
                __global const real *e = extremes + extremes_size * ((slot - age + slots) % slots);
                e += (size_t)y * 2 * F * span + 2 * j * span + x;
                lo = MIN(lo, e[0]);
                hi = MAX(hi, e[span]);
            }
            if (lo > hi) lo = hi = 0;
            real v = packed[slot * packed_size + ((long)(y + BORDER) * PLANES + FEATURE + j) * pitch + BORDER + x];
            if (MISSES && j == DEPTH) v = MIN(v, hi);
            kept[(M_CENTRE + j) * span] = v;
            kept[(M_LO + j) * span] = lo;
            kept[(M_HI + j) * span] = hi;
#ifdef RADIANCE
            real mean = box[(B_FEATURE + j) * span];
            if (MISSES && j == DEPTH) mean += box[B_MISS * span] * hi;
            sum -= f[(3 + j) * span] * (mean - v);
#endif
        }
#ifdef RADIANCE
        kept[M_BOX * span] = sum;
#endif
    }
}
