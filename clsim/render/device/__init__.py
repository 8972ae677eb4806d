"""The device that kernels run on: Warp, how kernels are compiled and launched, arrays."""
