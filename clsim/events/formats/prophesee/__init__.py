"""Prophesee's formats: RAW (EVT2, EVT2.1, EVT3, EVT4) and DAT."""
