"""Seeing events: a page in the browser, the terminal, rerun, and pictures and videos."""

FRAME_PERIOD_S = 1 / 15
"""Time between two frames that are shown: looking must not cost what rendering needs [s]."""
