// Adds to a sum that other threads add to as well: on a CPU Warp's own atomics expect that there is one thread.
#ifdef __CUDA_ARCH__
wp::atomic_add(sums, row, field, value);
#else
__atomic_fetch_add(&wp::index(sums, row, field), value, __ATOMIC_RELAXED);
#endif
