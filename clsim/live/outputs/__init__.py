"""Where the events of a run go, and what is written with them."""
