"""Textures: images and checkerboards, filtered."""
