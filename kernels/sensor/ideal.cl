// The ideal pixel: brightness becomes events. First how many each listed pixel fires, then, once their places are known,
// the events.
//
// Build macros: FRAME_RULE (at most one event, at the step's end), KNOTS (the path tells levels within the step),
// LINEAR_LIGHT (light is linear in time, and not its logarithm, which levels are).

#include "types.clh"

#ifdef cl_khr_fp64
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
typedef double stamp;
#else
typedef float stamp;
#endif

#define MAX_EVENTS 1000   // of one pixel in one step
#define MANY 3            // crossings in one step after which linear brightness between frames is a poor guess

// Lets a pixel fire until its reference is within a threshold of the level; moves the reference, tells the direction.
static inline real crossings_to(real level, real on, real off, real *ref, int *rising) {
    const real change = level - *ref, size = change > 0 ? on : off, length = change > 0 ? change : -change;
    *rising = change > 0;
    if (!(length >= size)) return 0;
#ifdef FRAME_RULE
    *ref = level;
    return 1;
#else
    real crossings = floor(length / size);
    crossings = crossings < 1 ? 1 : crossings;
    *ref += (change > 0 ? crossings : -crossings) * size;
    return crossings;
#endif
}

#ifdef KNOTS
#define KNOT_ARGUMENTS __global const int *offsets, __global const long *times, __global const real *levels,
#define KNOTS_GIVEN offsets, times, levels,
#else
#define KNOT_ARGUMENTS
#define KNOTS_GIVEN
#endif

// Chunk `mine` of the list, which has `chunk` pixels as y·span + x. start and end: levels at both ends of the step; KNOTS:
// levels[k] at times[k] [ns from the start], k = offsets[i] … offsets[i + 1] - 1, for the i-th of the list. Updates the
// references; a pixel without one (NaN) takes the level as its first and fires nothing.
// out_fired: crossings, negative where the last is OFF; out_from: level before, reference before, level after.
// out_counts, of each chunk: events to write, pixels with many crossings and no knots, events left out, most crossings of a
// pixel without knots.
static inline void decide(
    int mine, __global const int *list, int count, int chunk, __global const real *start, __global const real *end,
    KNOT_ARGUMENTS real on, real off, __global real *references, __global int *out_fired, __global real *out_from,
    __global long *out_counts)
{
    const int first = mine * chunk, last = MIN(first + chunk, count);
    long events = 0, many = 0, capped = 0, most = 0;
    for (int i = first; i < last; i++) {
        const real now = end[list[i]], before = start[list[i]], ref = references[list[i]];
        real ref_after = ref, crossings = 0, steepest = 0;
        int fired = 0, rising = 0;
        if (ref != ref) {
            references[list[i]] = now;
        } else {
#ifdef KNOTS
            for (int k = offsets[i]; k < offsets[i + 1]; k++) {
                int knot_rising;
                const real knot_crossings = crossings_to(levels[k], on, off, &ref_after, &knot_rising);
                if (knot_crossings > 0) rising = knot_rising;
                crossings += knot_crossings;
            }
            int end_rising;
            const real end_crossings = crossings_to(now, on, off, &ref_after, &end_rising);
            if (end_crossings > 0) rising = end_rising;
            crossings += end_crossings;
            if (offsets[i] == offsets[i + 1]) steepest = end_crossings;
#else
            steepest = crossings = crossings_to(now, on, off, &ref_after, &rising);
#endif
            if (crossings > 0) {
                const int written = crossings > MAX_EVENTS ? MAX_EVENTS : (int)crossings;
                many += steepest > MANY;
                const int counted = (int)(crossings > 1e9f ? 1e9f : crossings);
                capped += counted - written;
                most = MAX(most, (long)(steepest > 1e9f ? 1e9f : steepest));
                events += written;
                fired = rising ? written : -written;
                references[list[i]] = ref_after;
            }
        }
        out_fired[i] = fired;
        out_from[3 * i] = before;
        out_from[3 * i + 1] = ref;
        out_from[3 * i + 2] = now;
    }
    out_counts[4 * mine] = events;
    out_counts[4 * mine + 1] = many;
    out_counts[4 * mine + 2] = capped;
    out_counts[4 * mine + 3] = most;
}

// Work-item: a chunk.
__kernel void decide_events(
    __global const int *list, int count, int chunk, __global const real *start, __global const real *end,
    KNOT_ARGUMENTS real on, real off, __global real *references, __global int *out_fired, __global real *out_from,
    __global long *out_counts)
{
    decide(
        get_global_id(0), list, count, chunk, start, end, KNOTS_GIVEN on, off, references, out_fired, out_from, out_counts);
}

// What is linear in time as brightness changes.
static inline stamp way_of(stamp change) {
#ifdef LINEAR_LIGHT
    return expm1(change);
#else
    return change;
#endif
}

// The whole µs from the step's start at which what is linear, on its way from time t0 to t1 [µs], of `all`, has gone `way`.
static inline long crossed_at(stamp way, stamp all, stamp t0, stamp t1, long step) {
#ifdef FRAME_RULE
    return step;
#else
    const long t = (long)ceil(t0 + way / (all == 0 ? 1 : all) * (t1 - t0));
    return t < 1 ? 1 : (t > step ? step : t);
#endif
}

// As clsim/events/batch.py has it.
typedef struct __attribute__((packed)) {
    long time;
    ushort x, y;
    uchar on;
} Event;

// Chunk `mine`: its events go to out_events from `next` on, if all of them have room: there is room for `room`.
static inline void emit(
    int mine, long next, __global const int *list, int count, int chunk, __global const int *fired,
    __global const real *from, __global const long *counts, long room, int span, long time_before, long step,
    KNOT_ARGUMENTS real on, real off, __global Event *out_events)
{
    const int first = mine * chunk, last = MIN(first + chunk, count);
    if (next + counts[4 * mine] > room) return;
    for (int i = first; i < last; i++) {
        int left = fired[i] > 0 ? fired[i] : -fired[i];
        if (!left) continue;
        real before = from[3 * i], ref = from[3 * i + 1];
        stamp t0 = 0;
#ifdef KNOTS
        for (int k = offsets[i]; k <= offsets[i + 1]; k++) {
            const int at_end = k == offsets[i + 1];
            const real after = at_end ? from[3 * i + 2] : levels[k];
            const stamp t1 = at_end ? (stamp)step : times[k] * (stamp)1e-3;
            real ref_after = ref;
            int rising;
            const real crossings = crossings_to(after, on, off, &ref_after, &rising);
            const int n = crossings < left ? (int)crossings : left;
#else
        {
            const real after = from[3 * i + 2], ref_after = ref;
            const stamp t1 = step;
            const int rising = fired[i] > 0, n = left;
#endif
            const stamp all = way_of((stamp)after - before);
            for (int j = 1; j <= n; j++) {
                const stamp level = ref + j * (rising ? (stamp)on : -(stamp)off);
                out_events[next].time = time_before + crossed_at(way_of(level - before), all, t0, t1, step);
                out_events[next].x = list[i] % span;
                out_events[next].y = list[i] / span;
                out_events[next++].on = rising;
            }
            left -= n;
            before = after;
            ref = ref_after;
            t0 = t1;
        }
    }
}

// Work-item: a chunk, from first_chunk on. Its events follow those of the work-items before.
__kernel void emit_events(
    __global const int *list, int count, int chunk, int first_chunk, __global const int *fired,
    __global const real *from, __global const long *counts, long room, int span, long time_before, long step,
    KNOT_ARGUMENTS real on, real off, __global Event *out_events)
{
    const int mine = first_chunk + get_global_id(0);
    long next = 0;
    for (int k = first_chunk; k < mine; k++) next += counts[4 * k];
    emit(
        mine, next, list, count, chunk, fired, from, counts, room, span, time_before, step, KNOTS_GIVEN on, off,
        out_events);
}

// One work-item does both for all chunks: where they are few, a launch takes longer.
__kernel void fire_events(
    __global const int *list, int count, int chunk, __global const real *start, __global const real *end, long room,
    int span, long time_before, long step, KNOT_ARGUMENTS real on, real off, __global real *references,
    __global int *out_fired, __global real *out_from, __global long *out_counts, __global Event *out_events)
{
    long next = 0;
    for (int mine = 0; mine * chunk < count; mine++) {
        decide(mine, list, count, chunk, start, end, KNOTS_GIVEN on, off, references, out_fired, out_from, out_counts);
        emit(
            mine, next, list, count, chunk, out_fired, out_from, out_counts, room, span, time_before, step, KNOTS_GIVEN
            on, off, out_events);
        next += out_counts[4 * mine];
    }
}
