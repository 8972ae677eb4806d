"""Where rays meet surfaces: trees, meshes and instances, intersection."""
