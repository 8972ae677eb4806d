"""Seeing events: a page in the browser, the terminal, rerun, and pictures and videos."""
