"""Pictures from files, still and moving."""
