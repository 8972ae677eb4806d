// Finds the topology of a tree. counts: nodes, triangles, deepest level.
#include "build_triangles.h"
struct Box { v4 lower, upper; };
struct Range { Box box, centres; int first, count; };
struct Bin { Box box; int count; };
struct Task { Range range; int node, depth; };
const int bins = 16;
const Box nothing = {v4(inf), v4(-inf)};
const auto unite = [&](Box a, Box b) __attribute__((always_inline)) {
    return Box{lesser(a.lower, b.lower), greater(a.upper, b.upper)};
};
const auto area = [](Box a) __attribute__((always_inline)) {
    const v4 d = a.upper - a.lower;
    return d.x * d.y + d.y * d.z + d.z * d.x;
};
const auto blocks = [](int count) __attribute__((always_inline)) { return (float)((count + 7) / 8); };
Box* boxes = (Box*)scratch.data;
const auto id = [](Box& a) __attribute__((always_inline)) -> int& { return ((int*)&a)[7]; };
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
    // A comparison with NaN may be lost in a minimum: each corner must be usable.
    if (!usable(a, a) || !usable(b, b) || !usable(c, c)) continue;
    Box& slot = boxes[all.count++];
    slot = box;
    id(slot) = triangle;
    enlarge(all, box);
}

if (all.count && all.count <= LIST_TRIANGLES) {
    // The last block is filled with the last triangle.
    const int filled = (all.count + 7) / 8 * 8;
    for (int i = 0; i < filled; ++i) order.data[i] = id(boxes[i < all.count ? i : all.count - 1]);
    counts.data[0] = counts.data[2] = 0;
    counts.data[1] = filled;
    return;
}

// Divides a range in two where a plane of bins is best, else in the middle of the order; returns the gain.
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

int node_count = 1, deepest = 0;
Task tasks[(CHILDREN - 1) * MAX_DEPTH + 1];
int waiting = 0;
tasks[waiting++] = Task{all, 0, 0};
while (waiting) {
    const Task task = tasks[--waiting];
    deepest = task.depth > deepest ? task.depth : deepest;
    // So many triangles that equal parts a level will just do: from here on nothing else is allowed.
    long long room = LEAF_TRIANGLES;
    for (int d = task.depth + 1; d < MAX_DEPTH && room < (1ll << 40); ++d) room *= CHILDREN;
    const bool balance = task.range.count > room;
    Range children[CHILDREN];
    int count = task.range.count ? 1 : 0;
    children[0] = task.range;
    while (count && count < CHILDREN) {
        int worst = -1;
        float most = -1.0f;
        for (int i = 0; i < count; ++i) {
            const float size = balance ? (float)children[i].count : area(children[i].box);
            if (children[i].count > LEAF_TRIANGLES && size > most) {
                most = size;
                worst = i;
            }
        }
        if (worst < 0) break;
        const Range range = children[worst];
        const Plan best = balance ? Plan{-1, 0, inf} : plan(range);
        if (best.axis < 0) halve(range, children[worst], children[count]);
        else part(range, best, children[worst], children[count]);
        ++count;
    }
    // Leaves are parted further as long as there is room and it pays.
    bool tried[CHILDREN] = {};
    while (count && count < CHILDREN) {
        int worst = -1;
        float most = 0.0f;
        for (int i = 0; i < count; ++i) {
            if (!tried[i] && children[i].count > 1 && children[i].count <= LEAF_TRIANGLES
                    && area(children[i].box) > most) {
                most = area(children[i].box);
                worst = i;
            }
        }
        if (worst < 0) break;
        tried[worst] = true;
        const Range range = children[worst];
        const Plan best = plan(range);
        if (best.axis < 0 || best.cost >= area(range.box)) continue;
        part(range, best, children[worst], children[count]);
        tried[worst] = tried[count] = false;
        ++count;
    }
    int* refs = (int*)(nodes.data + NODE_FLOATS * (long long)task.node + 6 * CHILDREN);
    for (int i = 0; i < CHILDREN; ++i) {
        if (i >= count) refs[i] = ~(8 * all.count);
        else if (children[i].count <= LEAF_TRIANGLES) refs[i] = ~(8 * children[i].first + children[i].count - 1);
        else {
            refs[i] = NODE_FLOATS / 8 * node_count;
            tasks[waiting++] = Task{children[i], node_count++, task.depth + 1};
        }
    }
}
for (int i = 0; i < all.count; ++i) order.data[i] = id(boxes[i]);
counts.data[0] = node_count;
counts.data[1] = all.count;
counts.data[2] = deepest + 1;
