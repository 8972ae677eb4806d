"""Bridges to other simulators; each is an extra, and is imported by its own name."""
