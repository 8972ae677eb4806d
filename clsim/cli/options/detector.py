"""Options of ``clsim detect`` alone: how events are found in recorded frames."""

from __future__ import annotations

from typing import Annotated

import typer

from clsim.cli.options.shared import OUT_HELP, advanced
from clsim.detect.config import (
    Bandwidth,
    Gate,
    Kernel,
    Luma,
    Precision,
    Regress,
    Response,
)
from clsim.footage import Convention, TimeUnit, Transfer

FRAMES = Annotated[
    str | None,
    typer.Argument(
        show_default=False,
        help="A video; a folder or glob pattern of pictures (PNG, JPEG, TIFF …), or of EXR frames: ours, the ICIP 2023 "
        "program's, pbrt-v4's, Mitsuba 3's or Blender's.",
    ),
]
OUT = Annotated[list[str] | None, typer.Option(help=OUT_HELP)]
FPS = Annotated[float | None, typer.Option(help="Frames per second. [the times in the files]")]
THRESHOLD = Annotated[
    str | None,
    typer.Option(help="Contrast threshold in natural-log units: 0.2, or ON,OFF: 0.2,0.25. [the frames', or 0.2]"),
]
RECORDED_SENSOR = Annotated[
    str | None,
    typer.Option(
        "--sensor",
        metavar="NAME|FILE",
        help="The camera: davis346 … (see docs/sensor.md), or a .toml file; the frames' size stays. [ideal]",
    ),
]
SENSOR_SEED = Annotated[int | None, advanced("--seed", help="Seed of the sensor's random numbers. [0]")]
LUX_PER_UNIT = Annotated[
    float | None, advanced(help="Illuminance of the sensor under a luminance of 1, for --sensor [lux]. [100]")
]
TRANSFER = Annotated[
    Transfer | None,
    typer.Option(
        help="Transfer function that is undone in video and pictures; as-is undoes none. [the file's; bt709 for video "
        "that tells none, srgb for pictures of whole numbers, linear for others]"
    ),
]
TIMES = Annotated[
    str | None,
    typer.Option(help="File with a time for each frame of video or pictures: text, or .npy. [the file's]"),
]
TIME_UNIT = Annotated[TimeUnit | None, advanced(help="Unit of the times in --times. [s]")]
LIKE = Annotated[
    Convention | None,
    advanced(help="What another converter of video takes for brightness, for comparisons; without its noise."),
]
GATE = Annotated[
    Gate | None,
    advanced(
        help="Where esim-ad solves its regression. delta-r-exact (to check delta-r) and published (the ICIP 2023 "
        "program's) keep old windows and run in numpy, slowly. [radiance]"
    ),
]
GATE_SCALE = Annotated[float | None, advanced(help="s: the radiance gate opens beyond s·C. [1]")]
BOX = Annotated[int | None, advanced(help="Side of the radiance gate's box means [pixels], odd. [5]")]
STRIDE = Annotated[int | None, advanced(help="Step between the window's samples [pixels], 1…3. [1]")]
KERNEL = Annotated[Kernel | None, advanced(help="Weight of a sample by its distance in feature space. [gaussian]")]
BANDWIDTH = Annotated[
    Bandwidth | None,
    advanced(
        help="fixed; or chosen per pixel: tsvd leaves out noisy directions of feature space, optimised also weighs "
        "bias against variance. Both need variance planes and run in numpy, slowly. [fixed]"
    ),
]
BANDWIDTH_H = Annotated[float | None, advanced(help="Bandwidth h of the weights. [1]")]
RIDGE = Annotated[float | None, advanced(help="λ: how much β is penalised. [1e-5]")]
REGRESS = Annotated[
    Regress | None,
    advanced(
        help="What is regressed: log brightness, as in the paper; or linear luminance, whose log is taken then: "
        "that of few samples is too low on average. [log]"
    ),
]
SHRINK = Annotated[
    float | None,
    advanced(
        help="How readily a pixel's own value counts where its window's residual is more than noise: 0 never, "
        "1.5 is good. Needs --regress linear and the plane Variance.Luminance. [0]"
    ),
]
RESPONSE = Annotated[Response | None, advanced(help="Brightness of a luminance. [ln]")]
LUMINANCE = Annotated[Luma | None, advanced(help="Weights of R, G and B. [rec709]")]
SCALE = Annotated[float | None, advanced(help="Factor on luminance. [the frames', or 1]")]
FLOOR = Annotated[float | None, advanced(help="Smallest luminance after scaling. [the frames', or 1e-4]")]
FEATURES = Annotated[str | None, advanced(help="auto, or planes by name: Depth,Nx,Ny,Nz,Albedo.R … [auto]")]
PRECISION = Annotated[Precision | None, advanced(help="Arithmetic of the regression. [float32]")]
