"""Bundled specifications."""
