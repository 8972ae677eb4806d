"""Options that several commands share, each defined once."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from clsim.detect.config import EventRule, Method
from clsim.events.files import FORMATS, promises
from clsim.live.quality import Noise, Quality, Sampler, Sampling, describe_qualities

SCENE = Annotated[
    str,
    typer.Argument(
        help="A bundled scene (see `clsim scenes`) or a .toml, .gltf, .glb, .obj, .ply, .xml (Mitsuba) or .pbrt file."
    ),
]
RESOLUTION = Annotated[
    str | None, typer.Option(help="WIDTHxHEIGHT in pixels; the horizontal field of view stays. [scene's own]")
]
FPS = Annotated[float | None, typer.Option(help="Frames per simulated second. [scene's own]")]
SPP = Annotated[int, typer.Option(help="Light paths per pixel and frame.")]
LIVE_SPP = Annotated[
    int | None,
    typer.Option(help="Light paths per pixel and frame; with adaptive sampling, at most. [the quality's]"),
]
PROBE_SPP = Annotated[int | None, typer.Option(help="Light paths that every pixel gets, with adaptive sampling. [1]")]
PROBE_EVERY = Annotated[
    int | None,
    typer.Option(
        help="Frames in which the light of all pixels is found once, in turn; with adaptive sampling, in each frame "
        "where it may decide about an event. [1]"
    ),
]
FIRST_HIT_RAYS = Annotated[
    int | None,
    typer.Option(help="Most rays per pixel that look for the first hit alone: clean features. [the quality's]"),
]
SAMPLING = Annotated[
    Sampling | None,
    typer.Option(help="The same for every pixel; or as much as tells whether an event fires. [the quality's]"),
]
QUALITY = Annotated[
    Quality | None,
    typer.Option(
        help="A named point of speed against accuracy; other options win over it. [balanced; with --method, 8 paths]. "
        f"{describe_qualities()}."
    ),
]
MAX_DEPTH = Annotated[int, typer.Option(help="Longest light path in edges: 2 is direct light, 3 one bounce.")]
THREADS = Annotated[int | None, typer.Option(help="Threads that render. [one a core]")]
SEED = Annotated[int, typer.Option(help="Seed of all random numbers.")]
NOISE_HELP = "Same random numbers in every frame, so that noise cancels in differences; or fresh ones."
NOISE = Annotated[Noise, typer.Option(help=NOISE_HELP)]
LIVE_NOISE = Annotated[Noise | None, typer.Option(help=f"{NOISE_HELP} [common]")]
SAMPLER = Annotated[
    Sampler,
    typer.Option(help="Random numbers: plain, or Sobol's sequence (less noise for a little more time)."),
]
LIVE_SAMPLER = Annotated[
    Sampler | None,
    typer.Option(help="Random numbers: plain, or Sobol's sequence, which has less noise. [the quality's]"),
]
FOLLOW_SPECULAR = Annotated[
    bool,
    typer.Option(
        "--follow-specular/--first-hit",
        help="Regress on what mirrors and clear glass show, or on the glass itself.",
    ),
]
THRESHOLD = Annotated[
    str | None, typer.Option(help="Contrast threshold in natural-log units: 0.2, or ON,OFF: 0.2,0.25. [scene's own]")
]
METHOD_HELP = (
    "esim: no denoising; wlr-esim: a regression at every pixel; esim-ad: only where the gate opens; irradiance: a "
    "filter of the light that falls on surfaces."
)
METHOD = Annotated[Method, typer.Option(help=METHOD_HELP)]
LIVE_METHOD = Annotated[
    Method | None,
    typer.Option(help=f"{METHOD_HELP} [the quality's]"),
]
EVENT_RULE_HELP = "interpolated: each crossing gets its own time; frame: at most one event a frame."
EVENT_RULE = Annotated[EventRule, typer.Option(help=EVENT_RULE_HELP)]
LIVE_EVENT_RULE = Annotated[EventRule | None, typer.Option(help=f"{EVENT_RULE_HELP} [interpolated]")]
LIVE_WINDOW = Annotated[
    int | None, typer.Option(help="Side of the regression window [pixels], odd, 3…21. [the quality's, or the method's]")
]
HISTORY = Annotated[int, typer.Option(help="Frames whose windows form one regression, 1…5.")]
RENDER_DEVICE = Annotated[str, typer.Option(help="Where to render: cpu, cuda:0 … (see `clsim devices`).")]
OPENCL = Annotated[str | None, typer.Option(help="Part of the name of the OpenCL device. [a GPU if there is one]")]
JSON = Annotated[bool, typer.Option("--json", help="Print machine-readable results on standard output.")]

FILES = promises()
OUT_HELP = (
    "Where events go: tcp://HOST:PORT, udp://HOST:PORT, unix://PATH, - for text on standard output, or a file; may be "
    "given several times. Files: " + FILES
)
FORMAT = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help=f"Format of files whose ending shall not decide: {', '.join(each.name for each in FORMATS)}.",
    ),
]
TEXT_TIME = Annotated[
    Literal["us", "s"] | None, typer.Option(help="Time in text: whole µs, or seconds with six decimals. [us]")
]
STRICT = Annotated[
    bool, typer.Option("--strict", help="Refuse a scene that asks for what clsim lacks, instead of warning.")
]
