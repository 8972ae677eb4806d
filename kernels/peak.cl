// Independent multiply-adds, as many as registers hold: what the device can do at best.

#include "types.clh"

#define CHAINS 12

__kernel void peak(int rounds, real factor, real summand, __global real *out_sum)
{
    const realv a = factor, b = summand;
    realv v[CHAINS];
#pragma unroll
    for (int i = 0; i < CHAINS; i++) v[i] = a * (real)i;
    for (int round = 0; round < rounds; round++)
#pragma unroll
        for (int i = 0; i < CHAINS; i++) v[i] = v[i] * a + b;
    realv sum = 0;
#pragma unroll
    for (int i = 0; i < CHAINS; i++) sum += v[i];
    STORE(out_sum + get_global_id(0) * VW, sum);
}
