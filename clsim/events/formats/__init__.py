"""Event files: what writers and readers share, and the formats of cameras."""
