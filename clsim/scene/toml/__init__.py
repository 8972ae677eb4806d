"""clsim's own scenes, in TOML."""
