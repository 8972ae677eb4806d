// Divides triangles in two, and these again, down to single ones. counts: nodes (0: a list), triangles of a list.
#include "construct/vectors.h"
#include "construct/triangles.h"
#include "construct/binary.h"
struct Range { Box box, centres; int first, count; };
struct Bin { Box box; int count; };
struct Task { Range range; int node, depth; };
const int bins = 16;
const auto blocks = [](int count) __attribute__((always_inline)) { return (float)((count + 7) / 8); };
Box* boxes = (Box*)scratch.data;
// The box of a triangle holds its number in the place of the fourth coordinate.
const auto bare = [](Box a) __attribute__((always_inline)) { a.upper.w = 0.0f; return a; };
const auto enlarge = [&](Range& range, Box a) __attribute__((always_inline)) {
    range.box = unite(range.box, a);
    range.centres = unite(range.centres, Box{a.lower + a.upper, a.lower + a.upper});
};

Range all = {nothing, nothing, 0, 0};
for (int triangle = 0; triangle < indices.shape[0] / 3; ++triangle) {
    const v4 a = corner(triangle, 0), b = corner(triangle, 1), c = corner(triangle, 2);
    const Box box = {lesser(lesser(a, b), c), greater(greater(a, b), c)};
    if (!usable(a) || !usable(b) || !usable(c)) continue;
    Box& slot = boxes[all.count++];
    slot = box;
    number(slot) = triangle;
    enlarge(all, box);
}

if (all.count && all.count <= LIST_TRIANGLES) {
    // The last block is filled with the last triangle.
    const int filled = (all.count + 7) / 8 * 8;
    for (int i = 0; i < filled; ++i) parents.data[i] = number(boxes[i < all.count ? i : all.count - 1]);
    counts.data[0] = 0;
    counts.data[1] = filled;
    return;
}

// Divides a range in two where a plane of bins is best, else in the middle of the order.
struct Plan { int axis, plane; float cost; };
const auto plan = [&](const Range& range) {
    Plan best = {-1, 0, inf};
    const v4 span = range.centres.upper - range.centres.lower;
    const v4 scale = (float)bins * 0.99999f / span;
    Bin bin[3][bins];
    for (int k = 0; k < 3; ++k) for (int i = 0; i < bins; ++i) bin[k][i] = Bin{nothing, 0};
    const bool open[3] = {span.x > 0.0f, span.y > 0.0f, span.z > 0.0f};
    for (int i = range.first; i < range.first + range.count; ++i) {
        const Box box = bare(boxes[i]);
        const v4 at = (box.lower + box.upper - range.centres.lower) * scale;
        for (int k = 0; k < 3; ++k) {
            if (!open[k]) continue;
            int j = (int)at[k];
            j = j < 0 ? 0 : j >= bins ? bins - 1 : j;
            Bin& b = bin[k][j];
            b.box = unite(b.box, box);
            b.count++;
        }
    }
    for (int k = 0; k < 3; ++k) {
        if (!open[k]) continue;
        float right[bins];
        Box sum = nothing;
        int count = 0;
        for (int i = bins - 1; i > 0; --i) {
            sum = unite(sum, bin[k][i].box);
            count += bin[k][i].count;
            right[i] = count ? area(sum) * blocks(count) : inf;
        }
        sum = nothing;
        count = 0;
        for (int i = 1; i < bins; ++i) {
            sum = unite(sum, bin[k][i - 1].box);
            count += bin[k][i - 1].count;
            if (!count) continue;
            const float cost = area(sum) * blocks(count) + right[i];
            if (cost < best.cost) best = Plan{k, i, cost};
        }
    }
    return best;
};
const auto halve = [&](const Range& range, Range& left, Range& right) {
    left = right = Range{nothing, nothing, 0, 0};
    left.first = range.first;
    left.count = range.count / 2;
    right.first = range.first + left.count;
    right.count = range.count - left.count;
    for (int i = 0; i < left.count; ++i) enlarge(left, bare(boxes[left.first + i]));
    for (int i = 0; i < right.count; ++i) enlarge(right, bare(boxes[right.first + i]));
};
const auto part = [&](const Range& range, Plan at, Range& left, Range& right) {
    left = right = Range{nothing, nothing, 0, 0};
    const float low = range.centres.lower[at.axis];
    const float scale = ((float)bins * 0.99999f / (range.centres.upper - range.centres.lower))[at.axis];
    int i = range.first, j = range.first + range.count - 1;
    while (i <= j) {
        Box box = boxes[i];
        int bin = (int)((box.lower[at.axis] + box.upper[at.axis] - low) * scale);
        bin = bin < 0 ? 0 : bin >= bins ? bins - 1 : bin;
        if (bin < at.plane) {
            enlarge(left, bare(box));
            ++i;
        } else {
            enlarge(right, bare(box));
            boxes[i] = boxes[j];
            boxes[j--] = box;
        }
    }
    left.first = range.first;
    left.count = i - range.first;
    right.first = i;
    right.count = range.count - left.count;
};

Box* tree = (Box*)nodes_of_two.data;
int* up = parents.data;
int node_count = 1;
Task tasks[TALLEST_GROWN + 2];
int waiting = 0;
tasks[waiting++] = Task{all, 0, 0};
up[0] = -1;
while (waiting) {
    const Task task = tasks[--waiting];
    const Range& range = task.range;
    Box& node = tree[task.node];
    node = range.box;
    first_child(node) = 0;
    if (range.count < 2) {
        number(node) = range.count ? number(boxes[range.first]) : -1;
        continue;
    }
    // So many triangles that equal parts will just do: from here on nothing else is allowed.
    const int levels = TALLEST_GROWN - task.depth;
    const bool balance = levels < 31 && range.count > (1 << levels) / 2;
    const Plan best = balance || range.count == 2 ? Plan{-1, 0, inf} : plan(range);
    Range halves[2];
    if (best.axis < 0) halve(range, halves[0], halves[1]);
    else part(range, best, halves[0], halves[1]);
    first_child(node) = node_count;
    for (int i = 0; i < 2; ++i) {
        up[node_count] = task.node;
        tasks[waiting++] = Task{halves[i], node_count++, task.depth + 1};
    }
}
counts.data[0] = node_count;
