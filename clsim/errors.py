"""The errors of clsim: all derive from `Error`."""

from __future__ import annotations


class Error(Exception):
    """The base of all errors of ours."""


class InputError(Error, ValueError):
    """Wrong input: a file, key, option or address that cannot be used.

    Its text is one clear sentence that names the file, line or key, the value, and what was expected. Parameters and
    fields stand in it as Python spells them, between backticks: "`max_depth` must be at least 1, got 0".
    The command line prints them as its own options, ``--max-depth``, and exits with status 2.
    """


class Notice(UserWarning):
    """What the user should know of the machine or of a file; the command line prints it as one sentence."""


def require_choice(name: str, value: object, choices: tuple[object, ...]) -> None:
    """Raise InputError unless ``value``, of the field ``name``, is one of ``choices``."""
    if value not in choices:
        raise InputError(f"`{name}` must be one of {', '.join(map(str, choices))}, got {value!r}")
