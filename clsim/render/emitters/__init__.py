"""Lights: lamps, the environment, and which of many is drawn."""
