"""USD scenes."""
