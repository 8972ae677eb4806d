// Any hit, where there is a list in place of a tree.
if (blocks) {
#include "search/list_block.h"
    lanes8 any = lanes8(0);
    for (int block = 0; block < blocks; ++block) {
        v8 t, u, v;
        const lanes8 met = list(block, v8(far), t, u, v);
        if (MAY_PASS && stops(mask(met), (const int*)(memory + BLOCK_FLOATS * block + 8 * 9))) return 1;
        any |= met;
    }
    return MAY_PASS ? found : mask(any) != 0;
}
