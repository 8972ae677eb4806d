// The bus that takes events off the chip, one after the other.

#include "types.clh"

// One work-item: a queue. Requests are sorted by time [ns]; serving one takes event_ns, and row_ns more where it is of
// another row than the one before. Who would wait longer than most_ns is lost. bus: when it is free [ns], and its row.
// out_time: when each was served [ns], -1 where it is lost.
__kernel void serve(
    __global const long *time, __global const ushort *y, int count, long event_ns, long row_ns, long most_ns,
    __global long *bus, __global long *out_time)
{
    long free = bus[0], row = bus[1];
    for (int i = 0; i < count; i++) {
        const long begin = MAX(time[i], free);
        if (begin - time[i] > most_ns) {
            out_time[i] = -1;
            continue;
        }
        free = begin + event_ns + (y[i] == row ? 0 : row_ns);
        row = y[i];
        out_time[i] = free;
    }
    bus[0] = free;
    bus[1] = row;
}
