// Whether a ray hits anything in a tree of triangles.
#include "tree_memory.h"
#include "list_any.h"
#include "tree_search.h"
int stack[STACK];
int top = 0, child = 0;
for (;;) {
    if (child >= 0) {
        const float* node = nodes + 8 * (long long)child;
        const int* children = (const int*)(node + 48);
        v8 enter;
        for (unsigned met = boxes(node, enter); met; met &= met - 1) stack[top++] = children[__builtin_ctz(met)];
    } else {
        v8 t, u, v;
        if (leaf(~child >> 3, (~child & 7) + 1, t, u, v)) return true;
    }
    if (top == 0) return false;
    child = stack[--top];
}
