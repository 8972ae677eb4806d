"""The float64 reference of the sensor: the oracle of its kernels, which shares no code with them."""
