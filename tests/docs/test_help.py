"""``help()`` tells every argument."""

import inspect
import pydoc
import re

import pytest

import clsim


@pytest.mark.parametrize("name", ["Simulator", "stream", "batch", "events_from", "load_scene", "open", "write"])
def test_help_tells_each_argument(name: str) -> None:
    value = getattr(clsim, name)
    told = pydoc.plain(pydoc.render_doc(value)).replace("|", " ")
    entries = re.findall(r"^\s+((?:\w+(?:,\s+)?)+): ", told, re.MULTILINE)
    named = {each for entry in entries for each in re.split(r",\s+", entry)}
    kinds = (inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL)
    asked = {each.name for each in inspect.signature(value).parameters.values() if each.kind not in kinds}
    assert asked - {"self"} <= named


def test_the_version_is_told() -> None:
    from clsim.version import VERSION

    assert clsim.__version__ == VERSION
