"""How much of a run's events is noise of rendering."""
