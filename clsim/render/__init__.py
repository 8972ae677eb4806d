"""The path tracer: a World in, Frames out, in Warp on a CPU or GPU."""

from clsim.render.devices import check_device, fastest_tree, list_render_devices
from clsim.render.effort import Effort
from clsim.render.tracer import PathTracer, RenderCancelled, RenderOptions, describe_build

__all__ = [
    "Effort",
    "PathTracer",
    "RenderCancelled",
    "RenderOptions",
    "check_device",
    "describe_build",
    "fastest_tree",
    "list_render_devices",
]
