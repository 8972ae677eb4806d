// Gathers a binary tree into nodes of sixteen children, and leaves. counts: nodes (0: the tree is too tall), units of 8 floats
// of leaves, deepest level.
#include "construct/vectors.h"
#include "construct/binary.h"
Box* tree = (Box*)nodes_of_two.data;
// By node: triangles below it, and levels; and nodes, parents first.
int *under = scratch.data, *height = under + node_of_two_count, *queue = height + node_of_two_count;
int queued = 0;
queue[queued++] = 0;
for (int i = 0; i < queued; ++i) {
    const int first = first_child(tree[queue[i]]);
    if (first) {
        queue[queued++] = first;
        queue[queued++] = first + 1;
    }
}
for (int i = queued - 1; i >= 0; --i) {
    const int node = queue[i], first = first_child(tree[node]);
    under[node] = first ? under[first] + under[first + 1] : number(tree[node]) >= 0;
    height[node] = first ? 1 + (height[first] > height[first + 1] ? height[first] : height[first + 1]) : 0;
}
if (height[0] > TALLEST) {
    counts.data[0] = 0;
    return;
}
const unsigned MISSING = ~0u;
struct Task { int from, node, depth; };
Task tasks[(CHILDREN - 1) * MAX_DEPTH + 1];
int waiting = 0, node_count = 1, deepest = 0;
long long placed = 0;
tasks[waiting++] = Task{0, 0, 0};
while (waiting) {
    const Task task = tasks[--waiting];
    deepest = task.depth > deepest ? task.depth : deepest;
    // Opening the tallest child fifteen times takes four levels away, which always suffices.
    const bool tall = height[task.from] > 4 * (MAX_DEPTH - 1 - task.depth);
    int children[CHILDREN];
    int count = under[task.from] ? 1 : 0;
    children[0] = task.from;
    while (count && count < CHILDREN) {
        int worst = -1;
        float most = -1.0f;
        for (int i = 0; i < count; ++i) {
            if (under[children[i]] <= LEAF_TRIANGLES) continue;
            const float size = tall ? (float)height[children[i]] : area(tree[children[i]]);
            if (size > most) {
                most = size;
                worst = i;
            }
        }
        if (worst < 0) break;
        const int first = first_child(tree[children[worst]]);
        children[worst] = first;
        children[count++] = first + 1;
    }
    // Leaves are parted further as long as there is room and it pays.
    bool tried[CHILDREN] = {};
    while (count && count < CHILDREN) {
        int worst = -1;
        float most = 0.0f;
        for (int i = 0; i < count; ++i) {
            const int child = children[i];
            if (!tried[i] && under[child] > 1 && under[child] <= LEAF_TRIANGLES && area(tree[child]) > most) {
                most = area(tree[child]);
                worst = i;
            }
        }
        if (worst < 0) break;
        tried[worst] = true;
        const int first = first_child(tree[children[worst]]);
        if (area(tree[first]) + area(tree[first + 1]) >= most) continue;
        children[worst] = first;
        children[count] = first + 1;
        tried[worst] = tried[count] = false;
        ++count;
    }
    unsigned* refs = (unsigned*)(nodes.data + NODE_FLOATS * (long long)task.node + 6 * CHILDREN);
    for (int i = 0; i < CHILDREN; ++i) {
        const int size = i < count ? under[children[i]] : 0;
        if (!size) refs[i] = MISSING;
        else if (size > LEAF_TRIANGLES) {
            refs[i] = (unsigned)(NODE_FLOATS / UNIT_FLOATS * node_count) << 4;
            tasks[waiting++] = Task{children[i], node_count++, task.depth + 1};
        } else {
            refs[i] = (unsigned)placed << 4 | (unsigned)size;
            // The triangles' numbers, which the leaf has last, are all that `fit` needs to know of them.
            int* numbers = (int*)(leaves.data + UNIT_FLOATS * placed) + 9 * size;
            int stack[LEAF_TRIANGLES + 1], top = 0;
            stack[top++] = children[i];
            while (top) {
                Box& at = tree[stack[--top]];
                const int first = first_child(at);
                if (first) {
                    stack[top++] = first + 1;
                    stack[top++] = first;
                } else if (number(at) >= 0) *numbers++ = FIRST_NUMBER + number(at);
            }
            const int units = (CORNER_FLOATS * size + UNIT_FLOATS - 1) / UNIT_FLOATS;
            // A leaf is read wider than it is: what lies behind it is the same in each build.
            float* leaf = leaves.data + UNIT_FLOATS * placed;
            for (int i = CORNER_FLOATS * size; i < UNIT_FLOATS * units; ++i) leaf[i] = 0.0f;
            placed += units;
        }
    }
}
// Leaves come behind the nodes, and behind them one without extent.
const long long first_leaf = (long long)NODE_FLOATS / UNIT_FLOATS * node_count;
for (int n = 0; n < node_count; ++n) {
    unsigned* refs = (unsigned*)(nodes.data + NODE_FLOATS * (long long)n + 6 * CHILDREN);
    for (int i = 0; i < CHILDREN; ++i) {
        if (refs[i] == MISSING) refs[i] = (unsigned)(first_leaf + placed) << 4 | 1u;
        else if (refs[i] & 15u) refs[i] += (unsigned)first_leaf << 4;
    }
}
counts.data[0] = node_count;
counts.data[1] = (int)placed;
counts.data[2] = deepest + 1;
