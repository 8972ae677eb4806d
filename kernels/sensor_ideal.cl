// The ideal pixel: brightness becomes events. First how many each listed pixel fires, then, once their places are known,
// the events.
//
// Build macros: CHUNK (pixels of the list that one work-item handles), FRAME_RULE (at most one event, at the step's end).

#include "types.clh"

#ifdef cl_khr_fp64
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
typedef double stamp;
#else
typedef float stamp;
#endif

#define MAX_EVENTS 1000   // of one pixel in one step
#define MANY 3            // crossings in one step after which linear brightness between frames is a poor guess

// Work-item: CHUNK pixels of the list, which holds y·span + x. start and end: levels at both ends of the step. Updates the
// references; a pixel without one (NaN) takes the level as its first and fires nothing.
// out_fired: crossings, negative for OFF; out_from: level before, reference before, level after.
// out_counts per work-item: events to write, pixels with many crossings, events left out, most crossings of a pixel.
__kernel void decide_events(
    __global const int *list, int count, __global const real *start, __global const real *end, real on, real off,
    __global real *references, __global int *out_fired, __global real *out_from, __global long *out_counts)
{
    const int first = get_global_id(0) * CHUNK, last = MIN(first + CHUNK, count);
    long events = 0, many = 0, capped = 0, most = 0;
    for (int i = first; i < last; i++) {
        const real now = end[list[i]], before = start[list[i]], ref = references[list[i]], change = now - ref;
        int fired = 0;
        if (ref != ref) {
            references[list[i]] = now;
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
                references[list[i]] = ref_after;
            }
        }
        out_fired[i] = fired;
        out_from[3 * i] = before;
        out_from[3 * i + 1] = ref;
        out_from[3 * i + 2] = now;
    }
    out_counts[4 * get_global_id(0)] = events;
    out_counts[4 * get_global_id(0) + 1] = many;
    out_counts[4 * get_global_id(0) + 2] = capped;
    out_counts[4 * get_global_id(0) + 3] = most;
}

// When a pixel crosses its k-th threshold [µs from the step's start], counted from 1. from: its three values of out_from.
static inline long crossed_at(__global const real *from, int k, int rising, real on, real off, long step) {
#ifdef FRAME_RULE
    return step;
#else
    const stamp before = from[0], ref = from[1], rise = from[2] - before;
    const stamp crossed = ref + k * (rising ? (stamp)on : -(stamp)off) - before;
    const long t = (long)ceil(crossed / (rise == 0 ? 1 : rise) * step);
    return t < 1 ? 1 : (t > step ? step : t);
#endif
}

// Work-item: CHUNK pixels of the list, from work-item first_chunk on; its events go to out_* from place[work-item] on.
__kernel void emit_events(
    __global const int *list, int count, int first_chunk, __global const int *fired, __global const real *from,
    __global const int *place, int span, long time_before, long step, real on, real off, __global long *out_time,
    __global ushort *out_x, __global ushort *out_y, __global uchar *out_on)
{
    const int first = (first_chunk + get_global_id(0)) * CHUNK, last = MIN(first + CHUNK, count);
    int next = place[get_global_id(0)];
    for (int i = first; i < last; i++) {
        const int rising = fired[i] > 0, n = rising ? fired[i] : -fired[i];
        for (int k = 1; k <= n; k++) {
            out_time[next] = time_before + crossed_at(from + 3 * i, k, rising, on, off, step);
            out_x[next] = list[i] % span;
            out_y[next] = list[i] / span;
            out_on[next++] = rising;
        }
    }
}
