"""The OpenCL kernels, as package resources."""
