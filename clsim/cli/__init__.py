"""The clsim command."""
