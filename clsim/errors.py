"""The one exception that means "the input is wrong, not the program"."""

from __future__ import annotations


class InputError(ValueError):
    """Wrong input: a file, key, option or address that cannot be used.

    Its text is one clear sentence that names the file, line or key, the value, and what was expected.
    The command line prints it and exits with status 2. Any other exception is a fault of clsim itself.
    """


def require_choice(option: str, value: object, choices: tuple[object, ...]) -> None:
    """Raise InputError unless ``value`` is one of ``choices``."""
    if value not in choices:
        raise InputError(f"{option} must be one of {', '.join(map(str, choices))}, got {value!r}")
