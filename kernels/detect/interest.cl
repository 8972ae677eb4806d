// How close each pixel is to firing: what a renderer wants to know of the frames before.

#include "types.clh"

// Work-item: a row. out_interest: [4][H][width], distance to the ON threshold and to the OFF threshold, change since the
// frame before (0 where there was no level), standard error; all NaN where a pixel has no reference.
__kernel void measure_interest(
    __global const real *restrict reference, __global const real *restrict before, __global const real *restrict level,
    __global const real *restrict error, int has_error, int width, int height, int span, real on, real off, __global float *restrict out_interest)
{
    const int y = get_global_id(0);
    const size_t area = (size_t)width * height;
    reference += (size_t)y * span;
    before += (size_t)y * span;
    level += (size_t)y * span;
    error += has_error ? (size_t)y * span : 0;
    out_interest += (size_t)y * width;
    for (int x = 0; x < width; x++) out_interest[x] = reference[x] + on - level[x];
    for (int x = 0; x < width; x++) out_interest[area + x] = level[x] - (reference[x] - off);
    for (int x = 0; x < width; x++)
        out_interest[2 * area + x] = before[x] == before[x] ? level[x] - before[x] : level[x] - level[x];
    for (int x = 0; x < width; x++) out_interest[3 * area + x] = level[x] - level[x];
    if (has_error)
        for (int x = 0; x < width; x++) out_interest[3 * area + x] += error[x];
}
