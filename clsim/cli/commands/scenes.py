"""``clsim scenes``: what comes with the package."""

from __future__ import annotations

import json

import typer

from clsim.cli.options.shared import JSON


def scenes(as_json: JSON = False) -> None:
    """List the bundled scenes.

    Example: `clsim scenes`
    """
    from clsim.scene import bundled_scenes

    found = bundled_scenes()
    if as_json:
        typer.echo(json.dumps(found))
        return
    width = max(len(name) for name in found)
    for name, description in found.items():
        typer.echo(f"{name:<{width}}  {description}")
