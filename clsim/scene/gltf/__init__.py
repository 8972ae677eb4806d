"""glTF scenes."""
