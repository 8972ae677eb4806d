"""Spectra, daylight and the sun."""
