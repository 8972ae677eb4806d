"""The pipeline that joins source, ring, detector and sinks."""
