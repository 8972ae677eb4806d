"""What a scene and a camera have: kernels are built for exactly that."""
