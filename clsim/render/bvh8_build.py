"""The 8-wide tree: its topology by binned SAH, its boxes bottom-up, in native code.

Two steps, so that a mesh that deforms repeats the second alone. ``grow`` splits the triangles of a node until it has
eight children: always the largest range by area, at the best of 16 planes on each axis by the surface area heuristic
(Wald, RT 2007), where a leaf costs as much as a test of eight triangles. It leaves the triangles in the order of the
leaves, and children behind their parents. ``fit`` goes through the nodes backwards, copies the corners of each leaf's
triangles and unites boxes. Where there are few triangles, ``grow`` makes no node, and ``fit`` the blocks of a list.
"""

import warp as wp

from clsim.render.bvh8_list import BLOCK_FLOATS, FIT_LIST, LIST_TRIANGLES, ROWS
from clsim.render.bvh8_traverse import CORNER_FLOATS, FIRST_NUMBER, LEAF_TRIANGLES, MAX_DEPTH, NODE_FLOATS

FARTHEST = 1.0e12
"""Vertices farther from the origin belong to no triangle: the cubes of their coordinates must be finite."""

_COMMON = """
    typedef float v4 __attribute__((ext_vector_type(4)));
    typedef int i4 __attribute__((ext_vector_type(4)));
    const float inf = __builtin_inff();
    const auto lesser = [](v4 a, v4 b) __attribute__((always_inline)) { return a < b ? a : b; };
    const auto greater = [](v4 a, v4 b) __attribute__((always_inline)) { return a > b ? a : b; };
    const auto corner = [&](int triangle, int i) __attribute__((always_inline)) {
        const float* p = &vertices.data[indices.data[3 * (long long)triangle + i]][0];
        return v4{p[0], p[1], p[2], 0.0f};
    };
    const auto usable = [&](v4 lower, v4 upper) __attribute__((always_inline)) {
        return lower.x >= -FARTHEST && lower.y >= -FARTHEST && lower.z >= -FARTHEST
            && upper.x <= FARTHEST && upper.y <= FARTHEST && upper.z <= FARTHEST;
    };
    // The corners of a triangle, and whether a ray may hit it.
    const auto load = [&](int triangle, v4* p) __attribute__((always_inline)) {
        bool whole = true;
        for (int m = 0; m < 3; ++m) {
            p[m] = corner(triangle, m);
            whole = whole && usable(p[m], p[m]);
        }
        const v4 e = p[1] - p[0], f = p[2] - p[0];
        const v4 n = e.yzxw * f.zxyw - e.zxyw * f.yzxw;
        return whole && n.x * n.x + n.y * n.y + n.z * n.z > 0.0f;
    };
"""

# counts: nodes, triangles, deepest level
_GROW = """
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
    Task tasks[7 * MAX_DEPTH + 1];
    int waiting = 0;
    tasks[waiting++] = Task{all, 0, 0};
    while (waiting) {
        const Task task = tasks[--waiting];
        deepest = task.depth > deepest ? task.depth : deepest;
        // So many triangles that eight equal parts a level will just do: from here on nothing else is allowed.
        long long room = LEAF_TRIANGLES;
        for (int d = task.depth + 1; d < MAX_DEPTH && room < (1ll << 40); ++d) room *= 8;
        const bool balance = task.range.count > room;
        Range children[8];
        int count = task.range.count ? 1 : 0;
        children[0] = task.range;
        while (count && count < 8) {
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
        bool tried[8] = {};
        while (count && count < 8) {
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
        int* refs = (int*)(nodes.data + NODE_FLOATS * (long long)task.node + 48);
        for (int i = 0; i < 8; ++i) {
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
"""

_FIT = """
    float extent = 0.0f;
    for (int at = count - 1; at >= 0; --at) {
        float* node = nodes.data + NODE_FLOATS * (long long)at;
        const int* refs = (const int*)(node + 48);
        for (int i = 0; i < 8; ++i) {
            v4 lower = v4(inf), upper = v4(-inf);
            const int first = ~refs[i] >> 3, size = (~refs[i] & 7) + 1;
            if (refs[i] >= 0) {
                const float* child = nodes.data + 8 * (long long)refs[i];
                for (int k = 0; k < 3; ++k) {
                    for (int j = 0; j < 8; ++j) {
                        const float a = child[8 * k + j], b = child[8 * k + 24 + j];
                        lower[k] = a < lower[k] ? a : lower[k];
                        upper[k] = b > upper[k] ? b : upper[k];
                    }
                }
            } else if (first < order.shape[0]) {
                float* block = corners.data + CORNER_FLOATS * (long long)first;
                for (int j = 0; j < size; ++j) {
                    v4 p[3];
                    // Corners that coincide are never hit: so those of a triangle without a normal are made to.
                    const bool whole = load(order.data[first + j], p);
                    ((int*)block)[9 * size + j] = FIRST_NUMBER + order.data[first + j];
                    for (int m = 0; m < 3; ++m) {
                        if (whole) {
                            lower = lesser(lower, p[m]);
                            upper = greater(upper, p[m]);
                        }
                        for (int k = 0; k < 3; ++k) block[(3 * m + k) * size + j] = whole ? p[m][k] : 0.0f;
                    }
                }
            }
            for (int k = 0; k < 3; ++k) {
                node[8 * k + i] = lower[k];
                node[8 * k + 24 + i] = upper[k];
                const float a = -lower[k], b = upper[k];
                if (lower[k] <= upper[k]) {
                    extent = a > extent ? a : extent;
                    extent = b > extent ? b : extent;
                }
            }
        }
    }
    out_extent.data[0] = extent;
"""


def _native(snippet: str) -> str:
    sizes = {
        "BLOCK_FLOATS": BLOCK_FLOATS,
        "CORNER_FLOATS": CORNER_FLOATS,
        "FIRST_NUMBER": FIRST_NUMBER,
        "LEAF_TRIANGLES": LEAF_TRIANGLES,
        "LIST_TRIANGLES": LIST_TRIANGLES,
        "MAX_DEPTH": MAX_DEPTH,
        "NODE_FLOATS": NODE_FLOATS,
        "ROWS": ROWS,
    }
    for name, value in sizes.items():
        snippet = snippet.replace(name, str(value))
    return snippet.replace("FARTHEST", f"{FARTHEST:e}f")


@wp.func_native(_native(_COMMON + _GROW))
def _grow(
    vertices: wp.array(dtype=wp.vec3),
    indices: wp.array(dtype=int),
    scratch: wp.array(dtype=float),
    nodes: wp.array(dtype=float),
    order: wp.array(dtype=int),
    counts: wp.array(dtype=int),
): ...


@wp.func_native(_native(_COMMON + FIT_LIST + _FIT))
def _fit(
    vertices: wp.array(dtype=wp.vec3),
    indices: wp.array(dtype=int),
    order: wp.array(dtype=int),
    count: int,
    nodes: wp.array(dtype=float),
    corners: wp.array(dtype=float),
    out_extent: wp.array(dtype=float),
): ...


@wp.kernel(module="clsim_bvh8_build", enable_backward=False)
def grow(
    vertices: wp.array(dtype=wp.vec3),
    indices: wp.array(dtype=int),
    scratch: wp.array(dtype=float),
    out_nodes: wp.array(dtype=float),
    out_order: wp.array(dtype=int),
    out_counts: wp.array(dtype=int),
):
    """Find the topology; ``out_counts`` are nodes (0: a list), triangles, levels; ``scratch`` holds 8 floats each."""
    _grow(vertices, indices, scratch, out_nodes, out_order, out_counts)


@wp.kernel(module="clsim_bvh8_build", enable_backward=False)
def fit(
    vertices: wp.array(dtype=wp.vec3),
    indices: wp.array(dtype=int),
    order: wp.array(dtype=int),
    nodes: int,
    out_nodes: wp.array(dtype=float),
    out_corners: wp.array(dtype=float),
    out_extent: wp.array(dtype=float),
):
    """Write boxes and corners for a known topology; ``out_extent`` is the largest coordinate, sign aside."""
    _fit(vertices, indices, order, nodes, out_nodes, out_corners, out_extent)
