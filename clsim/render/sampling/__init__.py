"""Random numbers, Sobol points and sampling densities."""
