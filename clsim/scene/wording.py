"""What pydantic finds wrong, in the words of clsim's messages."""

from __future__ import annotations

import re

from pydantic_core import ErrorDetails


def plainly(error: ErrorDetails) -> str:
    """Return what was found and expected, without pydantic's own words."""
    if error["type"] == "missing":
        return "is missing, expected a value"
    message = error["msg"].removeprefix("Value error, ").replace("Input should be", "expected")
    message = re.sub(r"a valid dictionary or instance of \w+$", "a table of keys", message)
    message = message.replace("a valid boolean", "true or false").replace("a valid tuple", "a list")
    message = re.sub(r"^(Tuple|List|Dictionary) should have (.*) after validation, not \d+$", r"expected \2", message)
    return f"{message[0].lower()}{message[1:]}"
