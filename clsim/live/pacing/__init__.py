"""When frames are due, and how a run keeps up with the clock."""
