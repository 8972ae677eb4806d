// Asks a CPU for the line of memory in which an entry lies, and goes on.
#ifndef __CUDA_ARCH__
__builtin_prefetch(&array.data[index]);
#endif
