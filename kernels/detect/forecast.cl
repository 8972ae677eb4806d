// What brightness is likely to do between two frames: the pictures at both ends are carried along the ways of things.
//
// Build macros: LINEAR_LIGHT (light is linear in time between marks, and not its logarithm, which levels are).

#include "types.clh"

#define WAYS 3        // ways that things may go over a pixel
#define MOMENTS 64    // into how many parts a step is divided
#define SHORT 0.25f   // pixels that a way must be long at least
#define ALIKE 0.7f    // pixels within which two ways are one
#define BLOCK 4       // side of the squares of which the least and the largest level are known [pixels]
#define OVERSHOOT ((real)0.2813)   // a cubic's values leave those of its neighbours by so much of their range
#define SHARE ((real)0.5)   // of a threshold: what comes so near may reach it

typedef real __attribute__((ext_vector_type(4), aligned(4))) four;

// Weights of four neighbours for a place between the two in the middle: a cubic through these with the slopes of chords
// (Catmull and Rom, 1974), so that what peaks between two pixels is not cut off.
static inline void cubic(real f, real *weights) {
    const real g = 1 - f;
    weights[0] = (real)-0.5 * f * g * g;
    weights[1] = g * (1 + f - (real)1.5 * f * f);
    weights[2] = f * (1 + g - (real)1.5 * g * g);
    weights[3] = (real)-0.5 * g * f * f;
}

// An image at x, y (0, 0 is the middle of the first pixel), smooth between pixels.
static inline real sampled(__global const real *image, real x, real y, int width, int height, int span) {
    x = x < 0 ? 0 : (x > width - 1 ? width - 1 : x);
    y = y < 0 ? 0 : (y > height - 1 ? height - 1 : y);
    const int left = (int)x, top = (int)y;
    real across[4], down[4], sum = 0;
    cubic(x - left, across);
    cubic(y - top, down);
    if (left >= 1 && top >= 1 && left + 2 < width && top + 2 < height) {
        four row = 0;
        for (int j = 0; j < 4; j++)
            row += down[j] * *(const __global four *)(image + (size_t)(top + j - 1) * span + left - 1);
        return across[0] * row.x + across[1] * row.y + across[2] * row.z + across[3] * row.w;
    }
    int columns[4];
    for (int i = 0; i < 4; i++) columns[i] = MIN(MAX(left + i - 1, 0), width - 1);
    for (int j = 0; j < 4; j++) {
        __global const real *row = image + (size_t)MIN(MAX(top + j - 1, 0), height - 1) * span;
        sum += down[j] * (across[0] * row[columns[0]] + across[1] * row[columns[1]] + across[2] * row[columns[2]]
            + across[3] * row[columns[3]]);
    }
    return sum;
}

// Marks the moments between which the forecast is straight to `tolerance`: from a mark on, a line must pass within it by
// all values (the swinging door: Bristol, ISA 1990). The ends of the step are marks already.
static inline ulong bends(const real *levels, int parts, real tolerance) {
    real values[MOMENTS + 1], off[MOMENTS + 1];
    for (int i = 0; i <= parts; i++) {
#ifdef LINEAR_LIGHT
        values[i] = exp(levels[i] - levels[0]);
        off[i] = tolerance * values[i];
#else
        values[i] = levels[i];
        off[i] = tolerance;
#endif
    }
    ulong marks = 0;
    int from = 0;
    real least = -INFINITY, most = INFINITY;
    for (int i = 1; i <= parts; i++) {
        const real run = (real)1 / (i - from);
        const real low = (values[i] - off[i] - values[from]) * run, high = (values[i] + off[i] - values[from]) * run;
        const real slope = (values[i] - values[from]) * run;
        if (slope < least || slope > most) {
            from = i - 1;
            const int moment = from * MOMENTS / parts;
            if (moment > 0) marks |= (ulong)1 << moment;
            least = values[i] - off[i] - values[from];
            most = values[i] + off[i] - values[from];
        } else {
            least = MAX(least, low);
            most = MIN(most, high);
        }
    }
    return marks;
}

// The least and the largest level of squares of BLOCK pixels, [2][rows of blocks][columns of blocks], NaN where a level
// is. Work-item: a row of blocks.
__kernel void extremes(__global const real *image, int width, int height, int span, __global real *out_extremes)
{
    const int row = get_global_id(0), rows = (height + BLOCK - 1) / BLOCK, columns = (width + BLOCK - 1) / BLOCK;
    for (int column = 0; column < columns; column++) {
        real least = INFINITY, most = -INFINITY;
        for (int y = row * BLOCK; y < MIN((row + 1) * BLOCK, height); y++)
            for (int x = column * BLOCK; x < MIN((column + 1) * BLOCK, width); x++) {
                const real level = image[(size_t)y * span + x];
                least = level < least || level != level ? level : least;
                most = level > most || level != level ? level : most;
            }
        out_extremes[row * columns + column] = least;
        out_extremes[(rows + row) * columns + column] = most;
    }
}

// Whether no level sampled on a line from x, y can be so far from the reference that a pixel is forecast.
static inline bool calm(
    __global const real *extremes, real x, real y, real dx, real dy, int width, int height, real low, real high)
{
    const int rows = (height + BLOCK - 1) / BLOCK, columns = (width + BLOCK - 1) / BLOCK;
    const int left = clamp((int)floor(MIN(x, x + dx)) - 1, 0, width - 1) / BLOCK;
    const int right = clamp((int)floor(MAX(x, x + dx)) + 2, 0, width - 1) / BLOCK;
    const int top = clamp((int)floor(MIN(y, y + dy)) - 1, 0, height - 1) / BLOCK;
    const int bottom = clamp((int)floor(MAX(y, y + dy)) + 2, 0, height - 1) / BLOCK;
    real least = INFINITY, most = -INFINITY;
    for (int row = top; row <= bottom; row++)
        for (int column = left; column <= right; column++) {
            const real lower = extremes[row * columns + column], upper = extremes[(rows + row) * columns + column];
            least = lower < least || lower != lower ? lower : least;
            most = upper > most || upper != upper ? upper : most;
        }
    const real beyond = OVERSHOOT * (most - least);
    return most + beyond < high && least - beyond > low;
}

// Work-item: a row. start and end: levels at both ends of the step, [H][span]; ways: [WAYS][2][H][width], how far things
// go on the image in the step; of_start and of_end: their extremes. out_marks, [H][width]: bit m is set where brightness should be known at m / MOMENTS.
__kernel void forecast(
    __global const real *start, __global const real *end, __global const real *of_start, __global const real *of_end,
    __global const real *references, __global const float *ways, int width, int height, int span, real on, real off,
    real tolerance, __global ulong *out_marks)
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
            if (known || length < SHORT) continue;
            const real low = ref - SHARE * off, high = ref + SHARE * on;
            if (calm(of_start, x, y, -dx, -dy, width, height, low, high)
                && calm(of_end, x, y, dx, dy, width, height, low, high)) continue;
            const int parts = length > MOMENTS / 4 ? MOMENTS : (int)ceil(4 * length);
            real values[MOMENTS + 1], least = INFINITY, most = -INFINITY;
            for (int i = 0; i <= parts; i++) {
                const real share = (real)i / parts, rest = 1 - share;
                values[i] = rest * sampled(start, x - share * dx, y - share * dy, width, height, span)
                    + share * sampled(end, x + rest * dx, y + rest * dy, width, height, span);
                least = MIN(least, values[i]);
                most = MAX(most, values[i]);
            }
            if (most >= high || least <= low) marks |= bends(values, parts, tolerance);
        }
        out_marks[(size_t)y * width + x] = marks;
    }
}
