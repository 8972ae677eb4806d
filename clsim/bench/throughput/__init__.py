"""How fast rendering and detection are."""
