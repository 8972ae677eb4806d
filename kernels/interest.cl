// How close each pixel is to firing: what a renderer wants to know of the frames before.

// Work-item: a row. out_before: [H][span], the levels of the frame before.
__kernel void keep_level(__global const real *restrict state, int span, __global real *restrict out_before)
{
    const int y = get_global_id(0);
    state += ((size_t)y * STATE_PLANES + S_LEVEL) * span;
    out_before += (size_t)y * span;
    for (int x = 0; x < span; x++) out_before[x] = state[x];
}

// Work-item: a row. out_interest: [4][H][width], distance to the ON threshold and to the OFF threshold, change since the
// frame before (0 where there was no level), standard error; all NaN where a pixel has no reference.
__kernel void measure_interest(
    __global const real *restrict state, __global const real *restrict before, __global const real *restrict error,
    int has_error, int width, int height, int span, real on, real off, __global float *restrict out_interest)
{
    const int y = get_global_id(0);
    const size_t area = (size_t)width * height;
    __global const real *restrict ref = state + ((size_t)y * STATE_PLANES + S_REF) * span;
    __global const real *restrict level = state + ((size_t)y * STATE_PLANES + S_LEVEL) * span;
    before += (size_t)y * span;
    error += has_error ? (size_t)y * span : 0;
    out_interest += (size_t)y * width;
    for (int x = 0; x < width; x++) out_interest[x] = ref[x] + on - level[x];
    for (int x = 0; x < width; x++) out_interest[area + x] = level[x] - (ref[x] - off);
    for (int x = 0; x < width; x++)
        out_interest[2 * area + x] = before[x] == before[x] ? level[x] - before[x] : level[x] - level[x];
    for (int x = 0; x < width; x++) out_interest[3 * area + x] = level[x] - level[x];
    if (has_error)
        for (int x = 0; x < width; x++) out_interest[3 * area + x] += error[x];
}
