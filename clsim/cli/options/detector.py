"""Options of ``clsim detect`` alone: how events are found in recorded frames."""

from __future__ import annotations

from typing import Annotated

import typer

from clsim.cli.options.shared import OUT_HELP, advanced
from clsim.cli.options.texts import told
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
FPS = Annotated[float | None, typer.Option(help=told("FootageOptions.fps"))]
THRESHOLD = Annotated[
    str | None,
    typer.Option(help=told("threshold", "Such as 0.2, or ON,OFF: 0.2,0.25.", "the sensor's, the frames', or 0.2")),
]
RECORDED_SENSOR = Annotated[
    str | None, typer.Option("--sensor", metavar="NAME|FILE", help=told("RecordedSensor.sensor"))
]
SENSOR_SEED = Annotated[int | None, advanced("--seed", help=told("RecordedSensor.seed"))]
LUX_PER_UNIT = Annotated[float | None, advanced(help=told("lux_per_unit"))]
TRANSFER = Annotated[Transfer | None, typer.Option(help=told("transfer"))]
TIMES = Annotated[str | None, typer.Option(help=told("times"))]
TIME_UNIT = Annotated[TimeUnit | None, advanced(help=told("time_unit"))]
LIKE = Annotated[Convention | None, advanced(help=told("like"))]
GATE = Annotated[Gate | None, advanced(help=told("DetectorConfig.gate"))]
GATE_SCALE = Annotated[float | None, advanced(help=told("gate_scale"))]
BOX = Annotated[int | None, advanced(help=told("box"))]
STRIDE = Annotated[int | None, advanced(help=told("stride"))]
KERNEL = Annotated[Kernel | None, advanced(help=told("kernel"))]
BANDWIDTH = Annotated[Bandwidth | None, advanced(help=told("bandwidth"))]
BANDWIDTH_H = Annotated[float | None, advanced(help=told("bandwidth_h"))]
RIDGE = Annotated[float | None, advanced(help=told("ridge"))]
REGRESS = Annotated[Regress | None, advanced(help=told("regress"))]
SHRINK = Annotated[float | None, advanced(help=told("shrink"))]
RESPONSE = Annotated[Response | None, advanced(help=told("response"))]
LUMINANCE = Annotated[Luma | None, advanced(help=told("luminance"))]
SCALE = Annotated[float | None, advanced(help=told("scale", default="the frames', or 1"))]
FLOOR = Annotated[float | None, advanced(help=told("floor", default="the frames', or 1e-4"))]
FEATURES = Annotated[str | None, advanced(help=told("features", "auto, or their names: Depth,Nx,Ny,Nz,Albedo.R …"))]
PRECISION = Annotated[Precision | None, advanced(help=told("precision"))]
