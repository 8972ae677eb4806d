"""Layouts of data sets, one file each, written and read."""
