// A number with its first bit last.
#if defined(__CUDA_ARCH__)
    return __brev(x);
#else
    return __builtin_bitreverse32(x);
#endif
