"""The OpenCL event detector: Frame → events."""
