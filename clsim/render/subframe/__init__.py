"""Chosen pixels between two frames: traced again, or followed on flat surfaces."""
