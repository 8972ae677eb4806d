// The bus that takes events off the chip, one after the other.

#include "types.clh"

#define LOST (-1)    // in place of a time
#define WAITS (-2)

// One work-item: a queue. Requests are sorted by time [ns]; serving one takes event_ns, and row_ns more where it is of
// another row than the one before. Who would wait longer than most_ns is lost. bus: when it is free [ns], and its row.
// out_time: when each was served [ns], or LOST.
__kernel void serve(
    __global const long *time, __global const ushort *y, int count, long event_ns, long row_ns, long most_ns,
    __global long *bus, __global long *out_time)
{
    long free = bus[0], row = bus[1];
    for (int i = 0; i < count; i++) {
        const long begin = MAX(time[i], free);
        if (begin - time[i] > most_ns) {
            out_time[i] = LOST;
            continue;
        }
        free = begin + event_ns + (y[i] == row ? 0 : row_ns);
        row = y[i];
        out_time[i] = free;
    }
    bus[0] = free;
    bus[1] = row;
}

// One work-item: rows that ask are served one after the other, in the order in which they first asked. Requests are
// sorted by time [ns]; a pixel that waits asks for nothing more. A row takes row_ns, and event_ns for each of its events,
// which bear the time at which they leave, or row_ns after the row's turn came if `shared`. Rows whose turn comes after
// `end` wait. bus: when it is free [ns]. waiting, [height][width], is 0 before and after; head, [height], a row's first
// request, -1. tail and queue: [height]. next: of requests, what follows in their row. out_time: when each is served
// [ns], or LOST, or WAITS.
__kernel void serve_rows(
    __global const long *time, __global const ushort *x, __global const ushort *y, int count, int width, int height,
    long event_ns, long row_ns, long most_ns, int shared, long end, __global long *bus, __global uchar *waiting,
    __global int *head, __global int *tail, __global int *queue, __global int *next, __global long *out_time)
{
    long free = bus[0];
    int first = 0, queued = 0, i = 0;
    while (i < count || queued > 0) {
        const int turn = queued > 0 ? queue[first] : -1;
        const long begin = turn < 0 ? LONG_MAX : MAX(free, time[head[turn]]);
        if (begin <= end && (i == count || begin < time[i])) {
            free = begin + row_ns;
            for (int k = head[turn]; k >= 0; k = next[k]) {
                waiting[turn * width + x[k]] = 0;
                if (begin - time[k] > most_ns) {
                    out_time[k] = LOST;
                    continue;
                }
                free += event_ns;
                out_time[k] = shared ? begin + row_ns : free;
            }
            head[turn] = -1;
            first = first + 1 == height ? 0 : first + 1;
            queued--;
            continue;
        }
        if (i == count) break;
        const int row = y[i], pixel = row * width + x[i];
        if (waiting[pixel]) {
            out_time[i++] = LOST;
            continue;
        }
        waiting[pixel] = 1;
        out_time[i] = WAITS;
        next[i] = -1;
        if (head[row] < 0) {
            head[row] = i;
            queue[(first + queued++) % height] = row;
        } else {
            next[tail[row]] = i;
        }
        tail[row] = i++;
    }
    for (; queued > 0; queued--) {
        const int row = queue[first];
        for (int k = head[row]; k >= 0; k = next[k]) waiting[row * width + x[k]] = 0;
        head[row] = -1;
        first = first + 1 == height ? 0 : first + 1;
    }
    bus[0] = free;
}
