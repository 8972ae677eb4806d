"""Options that several commands share, each defined once; None is "not given", and defaults stand in brackets."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from clsim.detect.config import EventRule, Method
from clsim.events.files import FORMATS, promises
from clsim.events.outputs import Encoding
from clsim.live.quality import Noise, Quality, Sampler, Sampling
from clsim.truth.layouts import LAYOUTS
from clsim.truth.names import TRUTH_NAMES


def advanced(*names: str, **more: Any) -> Any:
    """Return an option that stands apart in ``--help``, for few need it."""
    return typer.Option(*names, rich_help_panel="Advanced", **more)


# What most runs need.
SCENE_HELP = "A bundled scene (see `clsim scenes`) or a .toml, .gltf, .glb, .usd, .obj, .ply, .xml or .pbrt file."
SCENE = Annotated[str | None, typer.Argument(help=SCENE_HELP, show_default=False)]
CONFIG = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Options from a JSON file, such as the .json beside what an earlier run wrote: that run again. Options "
        "given here win.",
    ),
]
DURATION = Annotated[
    str | None, typer.Option(help="Simulated time, such as 2s or 500ms; a bare number is seconds. [the motion]")
]
CAMERA_PATH = Annotated[
    str | None,
    advanced(
        metavar="FILE",
        help="Poses that the camera follows: TUM text, CSV, npz, or a glTF with a camera. The run lasts as long.",
    ),
]
CAMERA_AXES = Annotated[
    Literal["opencv", "opengl"] | None,
    advanced(help="The camera's axes in that file: opencv, +z ahead and y down; opengl, −z ahead and y up. [opencv]"),
]
CAMERA_INTERPOLATION = Annotated[
    Literal["linear", "cubic"] | None,
    advanced(help="How its poses are joined: straight and by slerp, or along splines. [linear]"),
]
FPS = Annotated[float | None, typer.Option(help="Frames per simulated second. [scene's own]")]
RESOLUTION = Annotated[
    str | None, typer.Option(help="WIDTHxHEIGHT in pixels; the horizontal field of view stays. [scene's own]")
]
SENSOR_SIZE = Annotated[
    str | None, typer.Option("--resolution", help="WIDTHxHEIGHT of the sensor, for files that do not tell. [found out]")
]
THRESHOLD = Annotated[
    str | None, typer.Option(help="Contrast threshold in natural-log units: 0.2, or ON,OFF: 0.2,0.25. [scene's own]")
]
QUALITY = Annotated[
    Quality | None,
    typer.Option(
        help="How much is spent on accuracy: draft is the fastest, balanced suits most, accurate costs several times "
        "as much, exact does not denoise, published is the ICIP 2023 paper's method with its settings. Other options "
        "win over it. [balanced; with --method, 8 plain paths]"
    ),
]
PACE = Annotated[
    Literal["max", "real"] | None,
    typer.Option(
        help="As fast as it can; or by the wall clock, where a governor renders less while the machine is too "
        "slow. [max]"
    ),
]
TIME = Annotated[
    str | None,
    advanced(
        help="When brightness is found: at frames alone (fixed), or between them too, where events happen (adaptive), "
        "or in whole pictures from one to the next of which nothing goes farther than some pixels (lambda=0.5, as in "
        "ESIM); without --fps there are 30 frames a second then, or what fast things or changing light need. auto is "
        "fixed, and adaptive where things go over 2 pixels a frame before a still camera, but for draft and published. "
        "[auto]"
    ),
]
TIME_TOLERANCE = Annotated[
    str | None,
    advanced(
        help="With --time adaptive: error of an event's time that will do, such as 20us. [100us; 30us with accurate "
        "and exact]"
    ),
]
RENDER_TIMES = Annotated[
    str | None,
    advanced(
        help="A file of times [s], one a line or in .npy, at which frames are rendered, in place of an even rate; or "
        "adaptive: frames 30 a second or more, and with them the pixels that are traced between."
    ),
]
LOOP = Annotated[bool | None, typer.Option("--loop", help="Start the motion anew at its end.")]
SENSOR = Annotated[
    str | None,
    typer.Option(
        metavar="NAME|FILE",
        help="The camera: davis346 … (see docs/sensor.md), or a .toml file. It sets the resolution too, unless given. "
        "[ideal]",
    ),
]
SEED = Annotated[int | None, typer.Option(help="Seed of all random numbers. [0]")]
JSON = Annotated[bool, typer.Option("--json", help="Print machine-readable results on standard output.")]

FILES = promises()
OUT_HELP = (
    "Where events go: tcp://HOST:PORT, udp://HOST:PORT, unix://PATH, - for text on standard output, or a file; may be "
    "given several times. {camera} in a name stands for each camera of a rig. Files: " + FILES
)

# How frames are rendered.
FRAME_COUNT = Annotated[int | None, advanced(help="Number of frames, instead of a duration.")]
SPP = Annotated[
    int | None, advanced(help="Light paths per pixel and frame; with adaptive sampling, at most. [the quality's]")
]
SAMPLING = Annotated[
    Sampling | None,
    advanced(
        help="The same for every pixel; or as much as tells whether an event fires; or (cached) with light kept on "
        "surfaces. [the quality's]"
    ),
]
PROBE_SPP = Annotated[
    int | None, advanced(help="Light paths that every pixel gets, with adaptive or cached sampling. [the quality's]")
]
PROBE_EVERY = Annotated[
    int | None,
    advanced(
        help="Frames from one probe of a pixel's light to the next; with adaptive sampling, where no event is near. "
        "[the quality's]"
    ),
]
FIRST_HIT_RAYS = Annotated[
    int | None,
    advanced(
        help="Rays per pixel that look for the first hit alone, more near an event: clean features. [the quality's]"
    ),
]
NOISE = Annotated[
    Noise | None,
    advanced(
        help="Same random numbers in every frame, so that noise cancels in differences; or fresh ones. [the quality's]"
    ),
]
SAMPLER = Annotated[
    Sampler | None,
    advanced(help="Random numbers: plain, or Sobol's sequence, which has less noise. [the quality's]"),
]
FOLLOW_SPECULAR = Annotated[
    bool | None,
    advanced(
        "--follow-specular/--no-follow-specular",
        help="Depth, normal and albedo of what mirrors and clear glass show, or of the glass itself. [follow]",
    ),
]
MAX_DEPTH = Annotated[int | None, advanced(help="Longest light path in edges: 2 is direct light, 3 one bounce. [8]")]
GOVERNOR = Annotated[
    bool | None,
    advanced("--governor/--no-governor", help="With --pace real: render less rather than fall behind. [yes]"),
]
RING = Annotated[
    Literal["block", "drop-oldest"] | None,
    advanced(help="block loses nothing; drop-oldest never waits (with --pace real). [block]"),
]
THREADS = Annotated[int | None, advanced(help="Threads that render. [one a core]")]
RENDER_DEVICE = Annotated[str | None, advanced(help="Where to render: cpu, cuda:0 … (see `clsim devices`). [cpu]")]
STRICT = Annotated[
    bool | None, advanced("--strict", help="Refuse a scene that asks for what clsim lacks, instead of warning.")
]

# How events are found.
METHOD = Annotated[
    Method | None,
    advanced(
        help="esim: no denoising; wlr-esim: a regression at every pixel; esim-ad: only where the gate opens; "
        "irradiance: a filter of the light that falls on surfaces. [the quality's]"
    ),
]
GATE = Annotated[
    Literal["radiance", "delta-r"] | None,
    advanced(help="Where esim-ad solves its regression; delta-r is the paper's. [the quality's]"),
]
EVENT_RULE = Annotated[
    EventRule | None,
    advanced(
        help="interpolated: each crossing gets its own time, the logarithm of light being linear between frames; "
        "linear-light: light itself is; frame: at most one event a frame. [the quality's, else interpolated]"
    ),
]
WINDOW = Annotated[
    int | None, advanced(help="Side of the window [pixels], odd, 3…21. [the quality's; 7 for irradiance, else 13]")
]
CONFIDENCE = Annotated[
    float | None,
    advanced(
        help="Standard errors by which brightness must have changed before an event is fired; with method irradiance "
        "alone. [0]"
    ),
]
HISTORY = Annotated[int | None, advanced(help="Frames whose windows form one regression, 1…5. [1]")]
OPENCL = Annotated[str | None, advanced(help="Part of the name of the OpenCL device. [a GPU if there is one]")]

# What is recorded beside events.
TRUTH = Annotated[
    str | None,
    typer.Option(
        metavar="NAMES",
        help=f"What is known beside the events, such as depth,flow: all, none, or of {', '.join(TRUTH_NAMES)}. "
        f"clsim live writes it to outputs that end in {', '.join(e for kind in LAYOUTS for e in kind.endings)}.",
    ),
]
FRAME_RATE = Annotated[
    float | None,
    advanced(help="Frames of --truth per simulated second; goes into --fps without a rest. [all that are rendered]"),
]
POSE_RATE = Annotated[float | None, advanced(help="Poses per simulated second, with --truth poses. [200]")]
IMU_RATE = Annotated[float | None, advanced(help="Inertial samples per simulated second, with --truth imu. [1000]")]
IMU_NOISE = Annotated[
    str | None, advanced(metavar="FILE", help="Noise of the inertial sensor: Kalibr's imu.yaml. [none]")
]

# How files are written.
FORMAT = Annotated[
    str | None,
    advanced(
        metavar="NAME",
        help=f"Format of files whose ending shall not decide: {', '.join(each.name for each in FORMATS)}.",
    ),
]
ROS_EVENTS = Annotated[
    Encoding | None,
    advanced(help="Events in bags of ROS: EventPacket in encoding mono or evt3, or dvs_msgs' EventArray. [mono]"),
]
TEXT_TIME = Annotated[
    Literal["us", "s"] | None, advanced(help="Time in text: whole µs, or seconds with six decimals. [us]")
]
STRICT_ORDER = Annotated[
    bool,
    advanced(
        "--strict",
        help="Refuse files whose events are out of order, instead of putting in place what is up to 0.1 s late and "
        "leaving out the rest.",
    ),
]
LABELS = Annotated[
    bool | None,
    advanced(
        "--labels",
        help="What caused each event (signal, shot, leak, hot), in a column of .h5 and .parquet files; with "
        "--truth labels the object too.",
    ),
]
FRAMES = Annotated[
    bool | None,
    advanced("--frames", help="Frames, in 8-bit sRGB, along with the events in .aedat4 files."),
]
