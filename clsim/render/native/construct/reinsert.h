// Takes nodes of a binary tree out, one by one, and puts each where the sum of all areas becomes least.
#include "construct/vectors.h"
#include "construct/binary.h"
Box* tree = (Box*)nodes_of_two.data;
int* up = parents.data;
const auto sibling = [](int node) __attribute__((always_inline)) { return ((node - 1) ^ 1) + 1; };
const auto adopt = [&](int node) {
    const int first = first_child(tree[node]);
    if (first) up[first] = up[first + 1] = node;
};
const auto refit = [&](int node) {
    for (; node >= 0; node = up[node]) {
        const int first = first_child(tree[node]);
        if (!first) continue;
        tree[node] = unite(tree[first], tree[first + 1]);
        first_child(tree[node]) = first;
    }
};
// What is saved beside a node and above it: branches that cannot save more than the best place known are left out.
struct Beside { float saved; int node; };
Beside open[OPEN];

for (int i = 0; i < which.shape[0]; ++i) {
    const int node = which.data[i], parent = up[node];
    if (parent < 0) continue;
    const Box own = tree[node];
    const float size = area(own);
    float most = 0.0f, saved = area(tree[parent]);
    int best = -1, beside = sibling(node), above = parent;
    Box without = tree[beside];
    // From the node's sibling up: what hangs beside each node above it.
    for (;;) {
        int top = 0;
        open[top++] = Beside{saved, beside};
        while (top) {
            const Beside at = open[--top];
            if (at.saved - size <= most) continue;
            const Box there = tree[at.node];
            const float gain = at.saved - area(unite(there, own));
            if (gain > most) {
                most = gain;
                best = at.node;
            }
            const int first = first_child(tree[at.node]);
            if (first && top + 2 <= OPEN) {
                open[top++] = Beside{gain + area(there), first};
                open[top++] = Beside{gain + area(there), first + 1};
            }
        }
        if (above != parent) {
            without = unite(without, tree[beside]);
            saved += area(tree[above]) - area(without);
        }
        if (up[above] < 0) break;
        beside = sibling(above);
        above = up[above];
    }
    const int other = sibling(node);
    if (best < 0 || best == other || best == parent) continue;
    // The sibling takes the parent's place, and what is met there the sibling's, beside the node.
    const Box left = tree[other], met = tree[best];
    first_child(tree[best]) = node < other ? node : other;
    tree[other] = met;
    tree[parent] = left;
    adopt(other);
    adopt(parent);
    up[other] = up[node] = best;
    refit(best);
    refit(parent);
}
