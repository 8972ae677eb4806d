"""Paths from the camera through the scene, and the kernels that are put together of all parts."""
