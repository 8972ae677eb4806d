"""Noise meters: the share of a run's events that is noise of rendering."""
