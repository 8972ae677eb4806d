// The nearest hit of a ray in a tree of triangles.
#include "search/tree_memory.h"
#include "search/list_closest.h"
#include "search/tree_search.h"
// An entry is where the ray enters, as bits, which sort as the numbers do from 0 on, and below them the child.
unsigned long long stack[STACK];
int top = 0, nearest_count = 0;
unsigned child = 0;
const float* nearest = nullptr;
float nearest_u = 0.0f, nearest_v = 0.0f;
for (;;) {
    const int count = leaf_size(child);
    const float* there = place(child);
    if (!count) {
        const unsigned* children = (const unsigned*)(there + 6 * CHILDREN);
        alignas(v16) unsigned enter[CHILDREN];
        unsigned met = boxes(there, *(v16*)enter);
        if (met) {
            const auto entry = [&](int i) __attribute__((always_inline)) {
                fetch(children[i]);
                return (unsigned long long)enter[i] << 32 | children[i];
            };
            unsigned long long first = entry(__builtin_ctz(met));
            met &= met - 1;
            // The others go to the stack, the farthest first; the nearest is kept in hand.
            const int base = top;
            for (; met; met &= met - 1) {
                const unsigned long long other = entry(__builtin_ctz(met));
                const unsigned long long later = other > first ? other : first;
                first = other > first ? first : other;
                int at = top++;
                for (; at > base && stack[at - 1] < later; --at) stack[at] = stack[at - 1];
                stack[at] = later;
            }
            child = (unsigned)first;
            continue;
        }
    } else {
        alignas(32) float t[8], u[8], v[8];
        unsigned met = leaf(there, count, *(v8*)t, *(v8*)u, *(v8*)v);
        for (; met; met &= met - 1) {
            const int i = __builtin_ctz(met);
            if (t[i] < far) {
                far = t[i];
                nearest = there + i;
                nearest_count = count;
                nearest_u = u[i];
                nearest_v = v[i];
                const int number = ((const int*)nearest)[9 * count] - FIRST_NUMBER;
                if (rows) __builtin_prefetch(rows + row_bytes * number);
            }
        }
    }
    const unsigned far_bits = __builtin_bit_cast(unsigned, far);
    do {
        if (top == 0) {
            wp::vec_t<17, int32_t> hit;
            hit[0] = -1;
            if (nearest) {
                const int* row = (const int*)nearest;
                hit[0] = row[9 * nearest_count] - FIRST_NUMBER;
                hit[1] = __builtin_bit_cast(int, far);
                hit[2] = __builtin_bit_cast(int, nearest_u);
                hit[3] = __builtin_bit_cast(int, nearest_v);
                float e[3], f[3];
                float reach = 0.0f;
                for (int k = 0; k < 9; ++k) {
                    hit[4 + k] = row[k * nearest_count];
                    reach = __builtin_fmaxf(reach, __builtin_fabsf(nearest[k * nearest_count]));
                }
                hit[16] = __builtin_bit_cast(int, reach);
                for (int k = 0; k < 3; ++k) {
                    const float a = nearest[k * nearest_count];
                    e[k] = nearest[(3 + k) * nearest_count] - a;
                    f[k] = nearest[(6 + k) * nearest_count] - a;
                }
                const float n[3] = {
                    e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]
                };
                const float length = __builtin_sqrtf(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
                for (int k = 0; k < 3; ++k) hit[13 + k] = __builtin_bit_cast(int, n[k] / length);
            }
            return hit;
        }
        --top;
    } while ((unsigned)(stack[top] >> 32) > far_bits);
    child = (unsigned)stack[top];
}
