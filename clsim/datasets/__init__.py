"""Data sets: many sequences from one specification, made by many workers, resumed after any interruption."""
