// Asks a CPU for the lines of memory in which an entry lies, and goes on.
#ifndef __CUDA_ARCH__
for (size_t at = 0; at < sizeof(array.data[0]); at += 64) {
    __builtin_prefetch(reinterpret_cast<const char*>(&array.data[index]) + at);
}
#endif
