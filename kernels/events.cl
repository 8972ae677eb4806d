// Levels become events: first how many each listed pixel fires, then, once their places are known, the events.

#ifdef cl_khr_fp64
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
typedef double stamp;
#else
typedef float stamp;
#endif

#define MAX_EVENTS 1000   // of one pixel in one step
#define MANY 3            // crossings in one step after which linear brightness between frames is a poor guess

// Work-item: CHUNK pixels of the list. Updates reference, level and (on an event) model.
// out_fired: crossings, negative for OFF; out_from: level before, reference before, level after.
// out_counts per work-item: events to write, pixels with many crossings, events left out, most crossings of a pixel.
__kernel void decide_events(
    __global const int *list, int count, __global const uchar *flags, __global const real *level, long level_row,
    long level_start, int span, real on, real off, __global real *state,
#ifdef MODEL
    __global const real *packed, long packed_size, __global const real *extremes, long extremes_size, int frames,
    int slot, int slots, int pitch, __global const real *boxes, __global const real *fit,
#endif
    __global int *out_fired, __global real *out_from, __global int *out_counts)
{
    const int first = get_global_id(0) * CHUNK, last = MIN(first + CHUNK, count);
    int events = 0, many = 0, capped = 0, most = 0;
    for (int i = first; i < last; i++) {
        const int x = list[i] % span, y = list[i] / span, fresh = flags[list[i]] == FRESH;
        __global real *s = state + (size_t)y * STATE_PLANES * span + x;
        const real now = level_of(level[y * level_row + level_start + x]), ref = s[S_REF * span];
        const real change = now - ref;
        const real before = s[S_LEVEL * span];
        s[S_LEVEL * span] = now;
        int fired = 0;
        if (fresh) {
            s[S_REF * span] = now;
        } else {
            const real size = change > 0 ? on : off, length = change > 0 ? change : -change;
            if (length >= size) {
#ifdef FRAME_RULE
                const real crossings = 1, ref_after = now;
#else
                real crossings = floor(length / size);
                crossings = crossings < 1 ? 1 : crossings;
                const real ref_after = ref + (change > 0 ? crossings : -crossings) * size;
#endif
                const int written = crossings > MAX_EVENTS ? MAX_EVENTS : (int)crossings;
                many += crossings > MANY;
                const int counted = (int)(crossings > 1e9f ? 1e9f : crossings);
                capped += counted - written;
                most = MAX(most, counted);
                events += written;
                fired = change > 0 ? written : -written;
                s[S_REF * span] = ref_after;
            }
        }
        out_fired[i] = fired;
        out_from[3 * i] = before;
        out_from[3 * i + 1] = ref;
        out_from[3 * i + 2] = now;
#ifdef MODEL
        if (fresh || fired) {
            __global const real *f = fit + (size_t)y * (1 + D) * span + x;
            s[S_ALPHA * span] = f[0];
            for (int j = 0; j < D; j++) s[(S_SLOPE + j) * span] = f[(1 + j) * span];
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
                s[(S_CENTRE + j) * span] = v;
                s[(S_LO + j) * span] = lo;
                s[(S_HI + j) * span] = hi;
#ifdef RADIANCE
                real mean = box[(B_FEATURE + j) * span];
                if (MISSES && j == DEPTH) mean += box[B_MISS * span] * hi;
                sum -= f[(3 + j) * span] * (mean - v);
#endif
            }
#ifdef RADIANCE
            s[S_BOX * span] = sum;
#endif
        }
#endif
    }
    out_counts[4 * get_global_id(0)] = events;
    out_counts[4 * get_global_id(0) + 1] = many;
    out_counts[4 * get_global_id(0) + 2] = capped;
    out_counts[4 * get_global_id(0) + 3] = most;
}

// Work-item: CHUNK pixels of the list, whose events go to out_* from start[work-item] on.
__kernel void emit_events(
    __global const int *list, int count, __global const int *fired, __global const real *from,
    __global const int *start, int span, long time_before, long step, real on, real off, __global long *out_time,
    __global ushort *out_x, __global ushort *out_y, __global uchar *out_on)
{
    const int first = get_global_id(0) * CHUNK, last = MIN(first + CHUNK, count);
    int next = start[get_global_id(0)];
    for (int i = first; i < last; i++) {
        const int rising = fired[i] > 0, n = rising ? fired[i] : -fired[i];
        for (int k = 1; k <= n; k++) {
            long t = step;
#ifndef FRAME_RULE
            const stamp before = from[3 * i], ref = from[3 * i + 1], rise = from[3 * i + 2] - before;
            const stamp crossed = ref + k * (rising ? (stamp)on : -(stamp)off) - before;
            t = (long)ceil(crossed / (rise == 0 ? 1 : rise) * step);
            t = t < 1 ? 1 : (t > step ? step : t);
#endif
            out_time[next] = time_before + t;
            out_x[next] = list[i] % span;
            out_y[next] = list[i] / span;
            out_on[next++] = rising;
        }
    }
}
