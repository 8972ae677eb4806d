"""``clsim devices``: what can render and what can detect."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import typer

from clsim.cli.options.shared import JSON

if TYPE_CHECKING:
    from clsim.opencl.device import Found


def devices(as_json: JSON = False) -> None:
    """List the devices for rendering (Warp) and for detection (OpenCL), and whether these work.

    Example: `clsim devices`
    """
    from clsim.opencl.device import INSTALL, find_devices
    from clsim.render import list_render_devices

    rendering = list_render_devices()
    detecting = find_devices()
    if as_json:
        working = [found.name for found in detecting if found.fault is None]
        broken = [{"name": found.name, "why": found.fault, "do": found.advice} for found in detecting if found.fault]
        typer.echo(json.dumps({"render": rendering, "opencl": working, "opencl_broken": broken}))
        return
    typer.echo("render (--render-device)")
    for name in rendering:
        typer.echo(f"  {name}")
    typer.echo("detect (--opencl, part of a name)")
    for found in detecting:
        typer.echo(f"  {found.name}")
        typer.echo(f"    {_state(found)}")
    if not detecting:
        typer.echo(f"  none; {INSTALL}")


def _state(found: Found) -> str:
    if found.fault is not None:
        return f"does not work: {found.fault}; {found.advice}"
    return "works" if found.told is None else f"works, built for {found.told}: it does not know this processor"
