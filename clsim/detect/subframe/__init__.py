"""Brightness between two frames: of chosen pixels, or of whole pictures."""
