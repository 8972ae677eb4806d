// Boxes, which are the nodes of a binary tree. The two children of a node lie side by side.
// Where boxes would have a fourth coordinate a node has its first child (0: none), and a leaf the number of its triangle.
struct Box { v4 lower, upper; };
const Box nothing = {v4(inf), v4(-inf)};
const auto first_child = [](Box& a) __attribute__((always_inline)) -> int& { return ((int*)&a)[3]; };
const auto number = [](Box& a) __attribute__((always_inline)) -> int& { return ((int*)&a)[7]; };
const auto unite = [&](Box a, Box b) __attribute__((always_inline)) {
    return Box{lesser(a.lower, b.lower), greater(a.upper, b.upper)};
};
const auto area = [](Box a) __attribute__((always_inline)) {
    const v4 d = a.upper - a.lower;
    return d.x * d.y + d.y * d.z + d.z * d.x;
};
