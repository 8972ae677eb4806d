"""Surfaces: materials at a point, what they let through, normals, microfacets."""
