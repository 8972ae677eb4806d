"""What is wrong with the words of a command line, in the words of clsim's other messages."""

from __future__ import annotations

import difflib
import json
import re
import sys
from typing import Any

from clsim.cli.spelling import CONFIG_KEYS


def usage_sentence(error: Any) -> str:
    """Return the sentence of a usage error of typer's: the option, what was expected, and what was got.

    It is empty where no command was given, and help was printed instead.
    """
    findings = getattr(error.__cause__, "errors", None)
    parameter = getattr(error, "param", None)
    if findings is None or parameter is None:
        message = _config_sentence(getattr(error, "option_name", "")) or str(error.format_message())
        if split := re.search(r"unexpected extra argument.*\((us|µs|ms|s|min)\)", message):
            return f"{message.rstrip('.')}; write a time and its unit as one word, such as 200{split[1]}"
        if not message.startswith("No such command"):
            return message
        return f"{message.rstrip('.')}, expected one of {', '.join(error.ctx.command.list_commands(error.ctx))}"
    finding = findings()[0]
    got, name = finding["input"], max(parameter.opts, key=len)
    choices = re.fullmatch(r"Value error, .* is not one of (.*?)\.?", finding["msg"])
    if choices is not None:
        known = re.findall(r"'([^']*)'", choices[1])
        close = difflib.get_close_matches(str(got), known, 1)
        hint = f"; did you mean {close[0]}?" if close else ""
        return f"{name} must be one of {', '.join(known)}, got {got!r}{hint}"
    expected = finding["msg"].removeprefix("Value error, ").replace("Input should be", "must be").partition(",")[0]
    return f"{name} {expected.replace('a valid', 'a').replace('a integer', 'a whole number')}, got {got!r}"


def _config_sentence(option: str) -> str | None:
    """Return what to write in place of an option that is a key of a file now, with the value that was given."""
    key = option.removeprefix("--").removeprefix("no-").replace("-", "_")
    if key not in CONFIG_KEYS:
        return None
    words = [word for each in sys.argv[1:] for word in (each.split("=", 1) if each.startswith(option) else [each])]
    value = next(iter(words[words.index(option) + 1 :]), "…")
    if key in ("follow_specular", "governor"):
        value = "false" if option.startswith("--no-") else "true"
    text = value if re.fullmatch(r"[-+.\deE]+|true|false|…", value) else json.dumps(value)
    return f"{option} is a key of a --config file now, such as run.toml: {key} = {text}"
