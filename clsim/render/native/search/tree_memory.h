// What both searches, and those of lists, share. A child is where its memory begins, in units of 32 bytes, times 16, plus
// how many triangles it has if it is a leaf, else 0. A missing child is the leaf behind the last, without extent: a ray of
// NaN may go there, and must find memory.
// Casts are C's, because Warp defines int(x) and float(x) as macros.
typedef float v8 __attribute__((ext_vector_type(8)));
typedef float unaligned8 __attribute__((ext_vector_type(8), aligned(4)));
typedef int lanes8 __attribute__((ext_vector_type(8)));
typedef bool bits8 __attribute__((ext_vector_type(8)));
// A number of each child of a node.
typedef float v16 __attribute__((ext_vector_type(CHILDREN)));
typedef int lanes16 __attribute__((ext_vector_type(CHILDREN)));
typedef bool bits16 __attribute__((ext_vector_type(CHILDREN)));

const unsigned long long* tree = (const unsigned long long*)handle;
const float* memory = (const float*)tree[0];
const float extent = *(const float*)&tree[1];
const int blocks = (int)tree[2];
const float* middle = (const float*)&tree[3];
const char* rows = (const char*)tree[6];
const long long row_bytes = (long long)tree[7];

const auto lesser = [](auto a, auto b) __attribute__((always_inline)) { return a < b ? a : b; };
const auto greater = [](auto a, auto b) __attribute__((always_inline)) { return a > b ? a : b; };
const auto mask = [](lanes8 a) __attribute__((always_inline)) {
    return (unsigned)__builtin_bit_cast(unsigned char, __builtin_convertvector(a, bits8));
};
