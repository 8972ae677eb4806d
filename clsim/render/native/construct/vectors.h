// What all steps of building share: corners of boxes.
typedef float v4 __attribute__((ext_vector_type(4)));
const float inf = __builtin_inff();
const auto lesser = [](v4 a, v4 b) __attribute__((always_inline)) { return a < b ? a : b; };
const auto greater = [](v4 a, v4 b) __attribute__((always_inline)) { return a > b ? a : b; };
