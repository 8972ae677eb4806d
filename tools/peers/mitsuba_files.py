"""Scene files as Mitsuba 3 loads them, those of earlier versions too, which name things that it lacks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from clsim.errors import InputError

_GONE = {"roughdiffuse": "diffuse"}
"""Plugins that Mitsuba 3 lacks, and what is next to them."""


def load_mitsuba_file(mitsuba: Any, file: Path, **parameters: str) -> Any:
    """Return the scene of a file, with a path integrator instead of whatever it asks for.

    ``parameters`` are values for what the file names with a ``$``, where it does. Properties that Mitsuba 3 no longer
    knows are passed over.

    Raises:
        InputError: Mitsuba cannot load it.
    """
    parser = mitsuba.parser
    config = parser.ParserConfig(mitsuba.variant())
    config.unused_properties = config.unused_parameters = mitsuba.LogLevel.Debug
    # Textures and meshes are named relative to the file.
    before = mitsuba.file_resolver()
    beside = mitsuba.FileResolver(before)
    beside.prepend(str(file.resolve().parent))
    mitsuba.set_file_resolver(beside)
    try:
        state = parser.parse_file(config, str(file), **parameters)
        parser.transform_upgrade(config, state)
        for node in state.nodes:
            renew(mitsuba, node)
        parser.transform_all(config, state)
        return parser.instantiate(config, state)
    except RuntimeError as error:
        raise InputError(f"{file}: Mitsuba cannot load it: {error}") from None
    finally:
        mitsuba.set_file_resolver(before)


def renew(mitsuba: Any, node: Any) -> None:
    """Replace what Mitsuba 3 lacks in one node of a file."""
    plugin = node.props.plugin_name()
    if node.type == mitsuba.ObjectType.Integrator:
        node.props = mitsuba.Properties("path")
    elif plugin in _GONE:
        node.props.set_plugin_name(_GONE[plugin])
    elif plugin == "bitmap" and node.props.get("filter_type") == "trilinear":
        node.props["filter_type"] = "bilinear"
