// Any hit, where there is a list in place of a tree.
if (blocks) {
#include "list_block.h"
    lanes8 any = lanes8(0);
    for (int block = 0; block < blocks; ++block) {
        v8 t, u, v;
        any |= list(block, v8(far), t, u, v);
    }
    return mask(any) != 0;
}
