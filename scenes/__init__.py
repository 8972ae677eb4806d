"""The bundled scenes, as package resources."""
