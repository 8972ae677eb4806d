"""``clsim devices``: what can render and what can detect."""

from __future__ import annotations

import json

import typer

from clsim.cli.options import JSON


def devices(as_json: JSON = False) -> None:
    """List the devices for rendering (Warp) and for detection (OpenCL).

    Example: `clsim devices`
    """
    from clsim.opencl.device import list_devices
    from clsim.render import list_render_devices

    rendering = list_render_devices()
    detecting = list_devices()
    if as_json:
        typer.echo(json.dumps({"render": rendering, "opencl": detecting}))
        return
    typer.echo("render (--render-device)")
    for name in rendering:
        typer.echo(f"  {name}")
    typer.echo("detect (--opencl, part of a name)")
    for name in detecting:
        typer.echo(f"  {name}")
