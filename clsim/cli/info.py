"""``clsim info``: what a scene is, and what was built in or left out for it."""

from __future__ import annotations

import json
from typing import Annotated, Any

import typer

from clsim.cli.options import JSON


def info(
    what: Annotated[str, typer.Argument(help="A bundled scene or a scene file.")],
    as_json: JSON = False,
) -> None:
    """Describe a scene, and what the renderer leaves out for it.

    Example: `clsim info two-boxes`
    """
    from clsim.render import RenderOptions, describe_build
    from clsim.scene import describe, load_world

    world = load_world(what)
    facts: dict[str, Any] = {"scene": describe(world), "renderer": describe_build(world, RenderOptions())}
    if as_json:
        typer.echo(json.dumps(facts))
        return
    for title, table in facts.items():
        typer.echo(title)
        for key, value in table.items():
            typer.echo(f"  {key:<16} {_text(value)}")


def _text(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {_text(item)}" for key, item in value.items()) or "none"
    if isinstance(value, list | tuple):
        return ", ".join(map(_text, value)) or "none"
    return f"{value:g}" if isinstance(value, float) else str(value)
