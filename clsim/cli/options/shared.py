"""Options that several commands share, each defined once; None is "not given", and defaults stand in brackets."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from clsim.cli.options.texts import told
from clsim.detect.config import EventRule, Method
from clsim.events.files import FORMATS, promises
from clsim.events.outputs import Encoding
from clsim.live.quality import Noise, Quality, Sampling
from clsim.truth.layouts import LAYOUTS
from clsim.truth.names import TRUTH_NAMES


def advanced(*names: str, **more: Any) -> Any:
    """Return an option that stands apart in ``--help``, for few need it."""
    return typer.Option(*names, rich_help_panel="Advanced", **more)


# What most runs need.
SCENE_HELP = told("scene")
SCENE = Annotated[str | None, typer.Argument(help=SCENE_HELP, show_default=False)]
CONFIG = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Options from a TOML or JSON file, by their names in Python, which help(clsim.stream) explains, such "
        "as pose_rate = 100. The .json beside what an earlier run wrote is that run again. Options given here win.",
    ),
]
DURATION = Annotated[
    str | None, typer.Option(help=told("duration_s", "Such as 2s or 500ms; a bare number is seconds."))
]
CAMERA_PATH = Annotated[str | None, advanced(metavar="FILE", help=told("camera_path"))]
FPS = Annotated[float | None, typer.Option(help=told("fps"))]
RESOLUTION = Annotated[str | None, typer.Option(metavar="WIDTHxHEIGHT", help=told("resolution"))]
SENSOR_SIZE = Annotated[
    str | None, typer.Option("--resolution", help="WIDTHxHEIGHT of the sensor, for files that do not tell. [found out]")
]
THRESHOLD = Annotated[str | None, typer.Option(help=told("threshold", "Such as 0.2, or ON,OFF: 0.2,0.25."))]
QUALITY = Annotated[Quality | None, typer.Option(help=told("quality"))]
PACE = Annotated[Literal["max", "real"] | None, typer.Option(help=told("pace"))]
TIME = Annotated[str | None, advanced(help=told("time"))]
TIME_TOLERANCE = Annotated[str | None, advanced(help=told("time_tolerance_us", "Such as 20us."))]
RENDER_TIMES = Annotated[
    str | None,
    advanced(
        help="A file of times [s], one a line or in .npy, at which frames are rendered, in place of an even rate; or "
        "adaptive: frames 30 a second or more, and with them the pixels that are traced between."
    ),
]
LOOP = Annotated[bool | None, typer.Option("--loop", help=told("loop"))]
SENSOR = Annotated[str | None, typer.Option(metavar="NAME|FILE", help=told("sensor"))]
SEED = Annotated[int | None, typer.Option(help=told("seed"))]
JSON = Annotated[bool, typer.Option("--json", help="Print machine-readable results on standard output.")]

FILES = promises()
OUT_HELP = (
    "Where events go: tcp://HOST:PORT, udp://HOST:PORT, unix://PATH, - for text on standard output, or a file; may be "
    "given several times. {camera} in a name stands for each camera of a rig. Files: " + FILES
)

# How frames are rendered.
FRAME_COUNT = Annotated[int | None, advanced(help=told("frame_count"))]
SPP = Annotated[int | None, advanced(help=told("spp"))]
SAMPLING = Annotated[Sampling | None, advanced(help=told("sampling"))]
NOISE = Annotated[Noise | None, advanced(help=told("noise"))]
MAX_DEPTH = Annotated[int | None, advanced(help=told("max_depth"))]
THREADS = Annotated[int | None, advanced(help=told("threads"))]
RENDER_DEVICE = Annotated[str | None, advanced(help=told("render_device"))]
STRICT = Annotated[bool | None, advanced("--strict", help=told("strict"))]

# How events are found.
METHOD = Annotated[Method | None, advanced(help=told("method"))]
GATE = Annotated[Literal["radiance", "delta-r"] | None, advanced(help=told("gate"))]
EVENT_RULE = Annotated[EventRule | None, advanced(help=told("event_rule"))]
WINDOW = Annotated[int | None, advanced(help=told("window"))]
CONFIDENCE = Annotated[float | None, advanced(help=told("confidence"))]
HISTORY = Annotated[int | None, advanced(help=told("history"))]
OPENCL = Annotated[str | None, advanced(help=told("opencl"))]

# What is recorded beside events.
TRUTH = Annotated[
    str | None,
    typer.Option(
        metavar="NAMES",
        help=told(
            "truth",
            f"Such as depth,flow; all, none, or of {', '.join(TRUTH_NAMES)}. clsim live writes it to outputs that end "
            f"in {', '.join(e for kind in LAYOUTS for e in kind.endings)}.",
        ),
    ),
]
FRAME_RATE = Annotated[float | None, advanced(help=told("frame_rate"))]

# How files are written.
FORMAT = Annotated[
    str | None,
    advanced(metavar="NAME", help=told("format", f"One of {', '.join(each.name for each in FORMATS)}.")),
]
ROS_EVENTS = Annotated[Encoding | None, advanced(help=told("ros_events"))]
TEXT_TIME = Annotated[Literal["us", "s"] | None, advanced(help=told("text_time"))]
STRICT_ORDER = Annotated[
    bool,
    advanced(
        "--strict",
        help="Refuse files whose end is missing or whose events are out of order, instead of reading what there is, "
        "putting in place what is up to 0.1 s late and leaving out the rest.",
    ),
]
LABELS = Annotated[bool | None, advanced("--labels", help=told("labels"))]
FRAMES = Annotated[bool | None, advanced("--frames", help=told("frames"))]
