"""What stands in where a file lacks it: a lamp, a camera, a motion."""
