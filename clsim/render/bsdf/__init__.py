"""Scattering models, one file each."""
