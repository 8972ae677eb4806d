"""The one exception that means "the input is wrong, not the program"."""

from __future__ import annotations


class InputError(ValueError):
    """Wrong input: a file, key, option or address that cannot be used.

    Its text is one clear sentence that names the file, line or key, the value, and what was expected.
    The command line prints it and exits with status 2. Any other exception is a fault of clsim itself.
    """
