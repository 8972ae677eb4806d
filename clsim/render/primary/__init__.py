"""What a pixel shows: first hits, edges, shadow rays, and how many samples pixels get."""
