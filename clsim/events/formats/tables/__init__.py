"""Events as tables and arrays in files: text, HDF5, numpy, Parquet, MATLAB."""
