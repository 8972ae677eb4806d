"""The path tracer: a World in, Frames out, in Warp on a CPU or GPU."""

from clsim.render.device.compiler import precompile_headers
from clsim.render.device.devices import check_device, fastest_tree, list_render_devices
from clsim.render.features.scene_features import camera_watches, direct_light_is_analytic, light_stands_still
from clsim.render.features.scene_lamps import lamps_move
from clsim.render.options import RenderOptions
from clsim.render.primary.effort import Effort
from clsim.render.scene_data import SceneData
from clsim.render.tracer import PathTracer, describe_build
from clsim.render.view import RenderCancelled, View

__all__ = [
    "Effort",
    "PathTracer",
    "RenderCancelled",
    "RenderOptions",
    "SceneData",
    "View",
    "camera_watches",
    "check_device",
    "describe_build",
    "direct_light_is_analytic",
    "fastest_tree",
    "lamps_move",
    "light_stands_still",
    "list_render_devices",
    "precompile_headers",
]
