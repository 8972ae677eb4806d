// The nearest hit, where there is a list in place of a tree.
if (blocks) {
#include "search/list_block.h"
    alignas(32) float us[8], vs[8];
    alignas(32) int places[8];
    v8 best = v8(far), best_u = v8(0.0f), best_v = v8(0.0f);
    lanes8 place = lanes8(0);
    for (int block = 0; block < blocks; ++block) {
        v8 t, u, v;
        const lanes8 met = list(block, best, t, u, v);
        best = met ? t : best;
        best_u = met ? u : best_u;
        best_v = met ? v : best_v;
        place = met ? lanes8(block) : place;
    }
    *(v8*)us = best_u;
    *(v8*)vs = best_v;
    *(lanes8*)places = place;
    // As integers, which sort as the numbers do from 0 on, and sooner.
    const lanes8 order = __builtin_bit_cast(lanes8, best);
    const int least = __builtin_reduce_min(order);
    const float nearest = __builtin_bit_cast(float, least);
    wp::vec_t<17, int32_t> hit;
    hit[0] = -1;
    if (nearest < far) {
        const int lane = __builtin_ctz(mask(order == lanes8(least))) & 7;
        const int* row = (const int*)(memory + BLOCK_FLOATS * places[lane] + lane);
        hit[0] = row[8 * 9] - FIRST_NUMBER;
        hit[1] = least;
        hit[2] = __builtin_bit_cast(int, us[lane]);
        hit[3] = __builtin_bit_cast(int, vs[lane]);
        for (int k = 0; k < 9; ++k) hit[4 + k] = row[8 * k];
        for (int k = 0; k < 3; ++k) hit[13 + k] = row[8 * (32 + k)];
        hit[16] = row[8 * 35];
    }
    return hit;
}
