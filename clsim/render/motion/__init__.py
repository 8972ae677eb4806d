"""What moves: poses through the shutter, and meshes whose vertices move."""
