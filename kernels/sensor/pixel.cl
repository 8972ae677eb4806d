// A pixel with faults: brightness becomes events. A pixel is run from the start of a step to its end, piece after piece;
// in a piece what it compares is linear in time, so that crossings are solved and not stepped.
//
// Each stage is a macro (see clsim/sensor/pixel_stages.py, where c[C_…], its constants, come from) and a function or two; a
// stage that is off is not compiled. Times are absolute [ns]. What does not change with light is computed from times and
// values that no frame and no launch sets, so that their boundaries leave every bit as it is.
//
// Build macros: CHUNK (pixels that one work-item handles), KNOTS (the path tells levels within the step),
// P_… (planes of what a pixel keeps for ever), S_… (planes of its state), and those of the stages.

#include "types.clh"
#include "sensor/math.clh"
#include "sensor/random.clh"

#pragma OPENCL EXTENSION cl_khr_fp64 : enable

#define CELL 1000L        // [ns]: a launch's ends are whole µs, as is all at which noise is drawn
#define MAX_EVENTS 1000   // of one pixel in one step
#define MANY 3            // events in one step after which linear brightness between frames is a poor guess
#define NEVER LONG_MAX

#define SIGNAL 0   // causes of events
#define SHOT 1
#define LEAKED 2
#define HOT 3

#define SECONDS(ns) ((double)(ns) * 1e-9)

#include "sensor/state.clh"

// Where events of a work-item go.
typedef struct {
    __global long *time;
    __global ushort *x, *y;
    __global uchar *on, *cause;
    int capacity, count;
} Outbox;

// How far a time [s] lies ahead, in ns, rounded up.
static inline long ahead(double seconds) {
    const double ns = seconds * 1e9;
    return seconds < 4e9 ? (long)ns + ((long)ns < ns) : NEVER / 2;
}

#ifdef LEAK
#define LEAK_OF(p) ((p)->leak)
#else
#define LEAK_OF(p) 0.0
#endif

#ifdef PARASITIC
static inline double leak_under(const Pixel *p, double level) {
    return p->dark_leak + p->leak_factor * p->c[C_PARASITIC] * quick_exp(level);
}

// What was counted from when on: after a rest the reference is taken anew. Else an event takes as much as a threshold, and
// all that was counted before it still counts.
#ifdef REFRACTORY
#define COUNTED_FROM(p) MAX((p)->since, (p)->in.at)
#else
#define COUNTED_FROM(p) ((p)->in.at)
#endif

// What has leaked more by t than was counted in this piece: a piece's leak is that under its middle, or, of a pixel that
// was calm, under that of a line before.
static inline double leak_to_correct(const Pixel *p, long t) {
    const long from = MIN(COUNTED_FROM(p), t);
    const double level = 0.5 * (level_at(p->in, from) + level_at(p->in, t));
    return (leak_under(p, level) - p->leak) * SECONDS(t - from);
}

static inline void correct_leak(Pixel *p, long t) {
    const double more = leak_to_correct(p, t);
    p->leaked += more;
    p->ref -= more;
}

// Light adds to the leak.
static inline void change_leak(Pixel *p, long t, double level) {
    const double leak = leak_under(p, level);
    if (leak == p->leak) return;
    if (p->since <= t) {
        p->leaked += p->leak * SECONDS(t - p->since);
        p->ref -= p->leak * SECONDS(t - p->since);
        p->since = t;
    }
    p->leak = leak;
}
#endif

#include "sensor/front.clh"
#include "sensor/noise.clh"

// Work-item: CHUNK pixels of the image [H][span]. out_own: [planes][pixels], what each pixel keeps for ever.
__kernel void make_pixels(__global const double *c, ulong seed, int pixels, int span, __global double *out_own) {
    const int first = get_global_id(0) * CHUNK, last = MIN(first + CHUNK, pixels);
    for (int i = first; i < last; i++) be_born(c, key_of(seed, i % span, i / span), out_own, pixels, i);
}

#include "sensor/event.clh"

// When a line that is at `value` at time `from` and has this slope has risen to `level`; not before t.
static inline long rises_to(double value, double slope, double level, long from, long t) {
    if (slope > 0) {
        const double seconds = (level - value) / slope;
        return seconds < SECONDS(t - from) ? t : from + ahead(seconds);
    }
    return value + slope * SECONDS(t - from) >= level ? t : NEVER;
}

// The next crossing after t of what is linear.
static inline long next_crossing(const Pixel *p, Line line, long t, int *rising) {
    // Where light does not change, nothing here hangs on where pieces begin.
    const long from = line.slope == 0 ? p->since : line.at;
    const double leak = LEAK_OF(p), slope = line.slope + leak;
    const double value = level_at(line, from) - p->ref + leak * SECONDS(from - p->since);
    const long up = rises_to(value, slope, p->on, from, t), down = rises_to(-value, -slope, p->off, from, t);
    *rising = up <= down;
    return MIN(up, down);
}

// Too many events in a launch: the others are counted, and the reference moves as if they had been fired.
static inline void cap(Pixel *p, Line line, long t) {
    const double moved = level_at(line, t) - p->ref + LEAK_OF(p) * SECONDS(t - p->since);
    const double size = moved > 0 ? p->on : p->off, crossings = floor(ABS(moved) / size);
    p->capped += crossings > 1e9 ? 1000000000L : (long)crossings;
    if (crossings >= 1) take_reference(p, line, t);
}

// From t to `end`, over which the pixel sees `line`.
static inline void run_piece(Pixel *p, Outbox *out, Line line, long t, long end) {
    while (true) {
        if (p->since > t) {
            if (p->since > end) return;
            t = p->since;
            take_reference(p, line, t);
        }
        if (p->fired >= MAX_EVENTS) {
            cap(p, line, end);
            return;
        }
        int rising, cause = -1;
        long next = next_crossing(p, line, t, &rising);
#ifdef RATE_NOISE
        int noise_rising;
        const long noisy = p->silent ? NEVER : next_arrival(p, line, t, MIN(next, end), &noise_rising);
        if (noisy < next) {
            next = noisy;
            rising = noise_rising;
            cause = SHOT;
        }
#endif
        if (next > end) return;
        t = next;
        const int exact = cause < 0;
        fire(p, out, line, t, rising, exact ? cause_of(p, line, t, rising) : cause, exact);
    }
}

#ifdef SHOT_NOISE
#include "sensor/shot.clh"
#define RUN_PIECE run_noisy
#else
#define RUN_PIECE run_piece
#endif

// A knot of a brightness path, with the light there.
typedef struct { long t; double level; Light light; } Knot;

static inline Knot knot_at(const Pixel *p, long t, double level) {
    const Knot knot = {t, level, light_of(p->c, level)};
    return knot;
}

#ifdef FRONT
// From t, where it is moved, over a piece or to the launch's end `to`; `light` is that at p->in.at.
static inline void run_front_piece(Pixel *p, Outbox *out, const Piece *piece, Light *light, long *t, long to) {
    const long end = MIN(to, piece->end);
#ifdef PARASITIC
    change_leak(p, p->in.at, 0.5 * (p->in.level + level_at(p->in, piece->end)));
#endif
    // Pieces that end before t were left out while the pixel was calm.
    if (end > *t) {
        RUN_PIECE(p, out, piece->seen, *t, end);
        *t = end;
    }
    if (end == piece->end) {
#ifdef PARASITIC
        if (COUNTED_FROM(p) > p->in.at) correct_leak(p, end);
#endif
        const Line in = {end, level_at(p->in, end), p->in.slope};
        p->in = in;
        p->front = piece->front;
        *light = piece->after;
    }
}
#endif

// From a knot to the next one.
static inline void run_segment(Pixel *p, Outbox *out, Knot from, Knot to) {
    if (from.t == to.t) return;
    const double slope = (to.level - from.level) / SECONDS(to.t - from.t);
#ifdef FRONT
    Light light = from.light;
    if (!follows_line(p, from.t, from.level) || !follows_line(p, to.t, to.level)) {
        turn(p, from.t, from.level, light, slope);
    } else if (p->in.level != from.level) {
        light = light_of(p->c, p->in.level);
    }
    for (long t = from.t; t < to.t;) {
        const Piece piece = piece_of(p, light);
        run_front_piece(p, out, &piece, &light, &t, to.t);
    }
#else
    const Line line = {from.t, from.level, slope};
    run_piece(p, out, line, from.t, to.t);
#endif
}

#ifdef LEAK
// How much of a threshold a pixel has leaked at a moment at random. Each noise event takes all of it back: with x of
// them in the time that a threshold takes, a share s is as likely as exp(-x s).
static inline double leaked_share(const Pixel *p, double level) {
    const double u = uniform_of(drawn(p->key, 0, DRAW_LEAK_PHASE));
#ifdef RATE_NOISE
    double on, off;
    rates_at(p, level, &on, &off);
    const double x = (on + off) / p->c[C_RATE_MOST] / p->rate_wait * p->on / p->leak;
    if (x > 1e-6) return -quick_log(1 + u * quick_expm1(-x)) / x;
#endif
    return u;
}
#endif

// A pixel's first level, at t.
static inline void begin(Pixel *p, long t, double level) {
    Line line = {t, level, 0};
#ifdef PARASITIC
    p->since = t + 1;
    change_leak(p, t, level);
#endif
#ifdef FRONT
    line.level = start_front(p, t, level);
#endif
#ifdef SHOT_NOISE
    start_noise(p, t, level);
#endif
    p->ref = line.level;
    p->since = t;
#ifdef SHOT_NOISE
    // As many thresholds away as noise is: with references at random, or at the mean, all would fire in a burst.
    const double size = p->noise > 0 ? p->on : p->off;
    p->noise_at_ref = copysign(size < INFINITY ? floor(ABS(p->noise) / size) * size : 0.0, p->noise);
    p->ref += p->noise_at_ref;
#endif
#ifdef LEAK
    // Leaks have no common beginning. A dead pixel's threshold is no number to take a share of.
    if (p->leak > 0 && p->on < INFINITY) {
        const double leaked = p->on * leaked_share(p, line.level), ago = MIN(leaked / p->leak, 1e9);
        p->since -= (long)(ago * 1e9);
        p->ref -= leaked - ago * p->leak;
    }
#endif
}

// What a detector takes for the level of the last event: the level now, under `light`, less what the pixel will compare
// when its filters have come to rest under it, noise apart.
static inline double reference_for(const Pixel *p, long t, double level, Light light) {
    double ref = p->ref - LEAK_OF(p) * SECONDS(t - p->since);
#ifdef SHOT_NOISE
    ref -= p->noise_at_ref;
#endif
    return p->since > t ? level : level - (light.level - ref);
}

#ifdef SHOT_NOISE
// Noise goes on in whole µs.
#define WHEN(ns) (((ns) + CELL / 2) / CELL * CELL)
#else
#define WHEN(ns) (ns)
#endif

#include "sensor/calm.clh"

#ifdef KNOTS
// Work-item: CHUNK pixels of the list. out_rows: [H][span], where each is in the list.
__kernel void find_rows(__global const int *list, int count, __global int *out_rows) {
    const int first = get_global_id(0) * CHUNK, last = MIN(first + CHUNK, count);
    for (int i = first; i < last; i++) out_rows[list[i]] = i;
}
#define KNOT_ARGUMENTS                                                                                                 \
    __global const int *rows, __global const int *offsets, __global const long *times, __global const real *levels,
#else
#define KNOT_ARGUMENTS
#endif

// Work-item: CHUNK pixels of the image [H][span], over a step from t0 to t1 [ns] at whose ends the levels are `start` and
// `end`; KNOTS: rows is -1 for pixels without knots, else their row of knots, with times from t0. out_references:
// [H][span], as a detector takes them. out_fired: events of each pixel, negative where the last is OFF.
// out_time, out_x, out_y, out_on, out_cause: events of each work-item, as many as have room from rooms[its number] up to
// the next one's.
// out_counts per work-item: its events, also those without room; pixels with many; events left out; most of a pixel.
__kernel void run_pixels(
    __global const double *c, ulong seed, __global const double *own, __global const double *state, int pixels, int span,
    int width, long t0, long t1, __global const real *start, __global const real *end, KNOT_ARGUMENTS
    __global const long *rooms, __global double *out_state, __global real *out_references, __global int *out_fired,
    __global long *out_time, __global ushort *out_x, __global ushort *out_y, __global uchar *out_on,
    __global uchar *out_cause, __global long *out_counts)
{
    const int item = get_global_id(0), first = item * CHUNK, last = MIN(first + CHUNK, pixels);
    const long room = rooms[item];
    Outbox out = {
        out_time + room, out_x + room, out_y + room, out_on + room, out_cause + room, (int)(rooms[item + 1] - room), 0
    };
    Totals totals = {0, 0, 0};
    Chunk chunk;
    look_ahead(&chunk, c, seed, own, state, pixels, span, first, last - first, t0, t1, start, end);
#ifdef KNOTS
    for (int i = first; i < last; i++)
        if (rows[i] >= 0) chunk.calm[i - first] &= offsets[rows[i]] == offsets[rows[i] + 1];
#endif
    keep_calm(&chunk, state, pixels, first, last - first, out_state, out_references, out_fired);
    Pixel together[CHUNK];   // those that run side by side
    Light light[CHUNK];
    int at[CHUNK], count = 0;
    for (int i = first; i < last; i++) {
        if (chunk.calm[i - first]) continue;
        Pixel p = loaded(c, seed, own, state, pixels, i, i % span, i / span);
#ifdef RATE_NOISE
        p.silent = chunk.silent[i - first];
#endif
#ifdef SHOT_NOISE
        set_law(&p, p.law.light);
#endif
        const double before = start[i], now = end[i];
        if (i % span < width && now == now) {
#ifdef KNOTS
            const int row = rows[i], knots = row < 0 ? 0 : offsets[row + 1] - offsets[row];
#else
            const int knots = 0;
#endif
#ifdef SIDE_BY_SIDE
            if (chunk.joined[i - first] && knots == 0) {
                take_front(&p, &chunk, i - first);
                together[count] = p;
                light[count] = chunk.begun[i - first];
                at[count++] = i;
                continue;
            }
#endif
            if (p.ref != p.ref && p.since <= t0) {
                begin(&p, t1, now);
            } else {
                Knot from = {t0, before, chunk.first[i - first]};
#ifdef KNOTS
                for (int k = 0; k < knots; k++) {
                    const int n = offsets[row] + k;
                    const Knot knot = knot_at(&p, t0 + WHEN(times[n]), levels[n]);
                    run_segment(&p, &out, from, knot);
                    from = knot;
                }
#endif
                const Knot to = {t1, now};
                run_segment(&p, &out, from, to);
            }
            out_references[i] = reference_for(&p, t1, now, chunk.last[i - first]);
        }
        keep(&p, out_state, pixels, i, out_fired, &totals);
    }
#ifdef SIDE_BY_SIDE
    run_side_by_side(together, light, count, &out, t0, t1);
    for (int k = 0; k < count; k++) {
        out_references[at[k]] = reference_for(&together[k], t1, end[at[k]], chunk.last[at[k] - first]);
        keep(&together[k], out_state, pixels, at[k], out_fired, &totals);
    }
#endif
    out_counts[4 * item] = out.count;
    out_counts[4 * item + 1] = totals.many;
    out_counts[4 * item + 2] = totals.capped;
    out_counts[4 * item + 3] = totals.most;
}

// Work-item: a work-item of run_pixels; its events go to out_* from place[work-item] on.
__kernel void gather_events(
    __global const long *counts, __global const int *place, __global const long *rooms, __global const long *time,
    __global const ushort *x, __global const ushort *y, __global const uchar *on, __global const uchar *cause,
    __global long *out_time, __global ushort *out_x, __global ushort *out_y, __global uchar *out_on,
    __global uchar *out_cause)
{
    const long from = rooms[get_global_id(0)];
    const int count = counts[4 * get_global_id(0)], to = place[get_global_id(0)];
    for (int k = 0; k < count; k++) {
        out_time[to + k] = time[from + k];
        out_x[to + k] = x[from + k];
        out_y[to + k] = y[from + k];
        out_on[to + k] = on[from + k];
        out_cause[to + k] = cause[from + k];
    }
}

// Work-item: CHUNK pixels of the list; out_crossings: how many events each had.
__kernel void list_fired(__global const int *list, int count, __global const int *fired, __global int *out_crossings) {
    const int first = get_global_id(0) * CHUNK, last = MIN(first + CHUNK, count);
    for (int i = first; i < last; i++) out_crossings[i] = fired[list[i]];
}
