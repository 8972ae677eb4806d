// Whether a ray hits anything in a tree of triangles. With MAY_PASS, triangles that may let it pass do not end the search:
// 2 says that there were no others.
#include "search/tree_memory.h"
int found = 0;
const unsigned char* may_pass = (const unsigned char*)tree[5];
const auto stops = [&](unsigned met, const int* numbers) __attribute__((always_inline)) {
    if (!MAY_PASS || !may_pass) return met != 0;
    for (; met; met &= met - 1) {
        if (!may_pass[numbers[__builtin_ctz(met)] - FIRST_NUMBER]) return true;
        found = 2;
    }
    return false;
};
#include "search/list_any.h"
#include "search/tree_search.h"
unsigned stack[STACK];
int top = 0;
unsigned child = 0;
for (;;) {
    const int count = leaf_size(child);
    const float* there = place(child);
    if (!count) {
        const unsigned* children = (const unsigned*)(there + 6 * CHILDREN);
        v16 enter;
        for (unsigned met = boxes(there, enter); met; met &= met - 1) stack[top++] = children[__builtin_ctz(met)];
    } else {
        v8 t, u, v;
        const unsigned met = leaf(there, count, t, u, v);
        if (stops(met, (const int*)there + 9 * count)) return 1;
    }
    if (top == 0) return found;
    child = stack[--top];
}
