"""OpenCL: devices, memory on them, and kernels built from the files in ``clsim.kernels``."""
