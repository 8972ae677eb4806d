"""Plots of commands."""
