"""Measurements that ship with the program; may import every room, nothing imports it but the command line."""
