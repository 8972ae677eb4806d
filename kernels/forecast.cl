// What brightness is likely to do between two frames: the pictures at both ends are carried along the ways of things.
//
// Build macros: none of its own.

#include "types.clh"

#define WAYS 3        // ways that things may go over a pixel
#define MOMENTS 64    // into how many parts a step is divided
#define ALIKE 0.25f   // pixels within which two ways are one
#define SHARE ((real)0.9)   // of a threshold: what comes so near may reach it

// An image at x, y (0, 0 is the middle of the first pixel), linear between pixels.
static inline real sampled(__global const real *image, real x, real y, int width, int height, int span) {
    x = x < 0 ? 0 : (x > width - 1 ? width - 1 : x);
    y = y < 0 ? 0 : (y > height - 1 ? height - 1 : y);
    const int left = (int)x, top = (int)y;
    const int right = left + (left < width - 1), below = top + (top < height - 1);
    const real fx = x - left, fy = y - top;
    __global const real *upper = image + (size_t)top * span, *lower = image + (size_t)below * span;
    return (upper[left] * (1 - fx) + upper[right] * fx) * (1 - fy) + (lower[left] * (1 - fx) + lower[right] * fx) * fy;
}

// Marks the moments between which the forecast is straight to `tolerance`: from a mark on, a line must pass within it by
// all values (the swinging door: Bristol, ISA 1990). The ends of the step are marks already.
static inline ulong bends(const real *values, int parts, real tolerance) {
    ulong marks = 0;
    int from = 0;
    real least = -INFINITY, most = INFINITY;
    for (int i = 1; i <= parts; i++) {
        const real run = (real)1 / (i - from);
        const real low = (values[i] - tolerance - values[from]) * run, high = (values[i] + tolerance - values[from]) * run;
        const real slope = (values[i] - values[from]) * run;
        if (slope < least || slope > most) {
            from = i - 1;
            const int moment = from * MOMENTS / parts;
            if (moment > 0) marks |= (ulong)1 << moment;
            least = values[i] - tolerance - values[from];
            most = values[i] + tolerance - values[from];
        } else {
            least = MAX(least, low);
            most = MIN(most, high);
        }
    }
    return marks;
}

// Work-item: a row. start and end: levels at both ends of the step, [H][span]; ways: [WAYS][2][H][width], how far things
// go on the image in the step. out_marks, [H][width]: bit m is set where brightness should be known at m / MOMENTS.
__kernel void forecast(
    __global const real *start, __global const real *end, __global const real *references, __global const float *ways,
    int width, int height, int span, real on, real off, real tolerance, __global ulong *out_marks)
{
    const int y = get_global_id(0);
    const size_t area = (size_t)width * height;
    for (int x = 0; x < width; x++) {
        const size_t at = (size_t)y * span + x;
        const real ref = references[at];
        __global const float *way = ways + (size_t)y * width + x;
        ulong marks = 0;
        for (int k = 0; k < WAYS && ref == ref; k++) {
            const real dx = way[2 * k * area], dy = way[(2 * k + 1) * area];
            int known = 0;
            for (int j = 0; j < k; j++) {
                const real ex = way[2 * j * area] - dx, ey = way[(2 * j + 1) * area] - dy;
                known |= ex * ex + ey * ey < ALIKE * ALIKE;
            }
            const real length = sqrt(dx * dx + dy * dy);
            if (known || length < ALIKE) continue;
            const int parts = length > MOMENTS / 2 ? MOMENTS : (int)ceil(2 * length);
            real values[MOMENTS + 1], least = INFINITY, most = -INFINITY;
            for (int i = 0; i <= parts; i++) {
                const real share = (real)i / parts, rest = 1 - share;
                values[i] = rest * sampled(start, x - share * dx, y - share * dy, width, height, span)
                    + share * sampled(end, x + rest * dx, y + rest * dy, width, height, span);
                least = MIN(least, values[i]);
                most = MAX(most, values[i]);
            }
            if (most - ref >= SHARE * on || ref - least >= SHARE * off) marks |= bends(values, parts, tolerance);
        }
        out_marks[(size_t)y * width + x] = marks;
    }
}
