"""Events against reference events."""
