"""Meshes from files (OBJ, PLY), and what is computed on meshes."""
