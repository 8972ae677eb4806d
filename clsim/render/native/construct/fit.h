// Writes boxes and corners for a known topology, children before their parents.
#include "construct/vectors.h"
#include "construct/triangles.h"
#include "search/list_fit.h"
float extent = 0.0f;
for (int at = count - 1; at >= 0; --at) {
    float* node = memory.data + NODE_FLOATS * (long long)at;
    const unsigned* refs = (const unsigned*)(node + 6 * CHILDREN);
    for (int i = 0; i < CHILDREN; ++i) {
        v4 lower = v4(inf), upper = v4(-inf);
        const int size = refs[i] & 15u;
        float* there = memory.data + UNIT_FLOATS * (long long)(refs[i] >> 4);
        if (!size) {
            for (int k = 0; k < 3; ++k) {
                for (int j = 0; j < CHILDREN; ++j) {
                    const float a = there[CHILDREN * k + j], b = there[CHILDREN * (k + 3) + j];
                    lower[k] = a < lower[k] ? a : lower[k];
                    upper[k] = b > upper[k] ? b : upper[k];
                }
            }
        } else if (((int*)there)[9 * size]) {
            for (int j = 0; j < size; ++j) {
                v4 p[3];
                // Corners that coincide are never hit: so those of a triangle without a normal are made to.
                const bool whole = load(((int*)there)[9 * size + j] - FIRST_NUMBER, p);
                for (int m = 0; m < 3; ++m) {
                    if (whole) {
                        lower = lesser(lower, p[m]);
                        upper = greater(upper, p[m]);
                    }
                    for (int k = 0; k < 3; ++k) there[(3 * m + k) * size + j] = whole ? p[m][k] : 0.0f;
                }
            }
        }
        for (int k = 0; k < 3; ++k) {
            node[CHILDREN * k + i] = lower[k];
            node[CHILDREN * (k + 3) + i] = upper[k];
            const float a = -lower[k], b = upper[k];
            if (lower[k] <= upper[k]) {
                extent = a > extent ? a : extent;
                extent = b > extent ? b : extent;
            }
        }
    }
}
out_extent.data[0] = extent;
