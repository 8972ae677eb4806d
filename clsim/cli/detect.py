"""``clsim detect``: recorded frames become events."""

from __future__ import annotations

from typing import Annotated

import typer

from clsim.cli import parse
from clsim.cli.options import EVENT_RULE, FORMAT, HISTORY, JSON, METHOD, OPENCL, OUT_HELP, TEXT_TIME
from clsim.detect.config import Bandwidth, Gate, Kernel, Luminance, Precision, Regress, Response
from clsim.errors import InputError


def detect(
    frames: Annotated[
        str,
        typer.Argument(
            help="Folder or glob pattern of EXR frames: ours, the ICIP 2023 program's, "
            "pbrt-v4's, Mitsuba 3's or Blender's."
        ),
    ],
    out: Annotated[list[str], typer.Option(help=OUT_HELP)],
    fps: Annotated[float | None, typer.Option(help="Frames per second. [the times in the files]")] = None,
    threshold: Annotated[str, typer.Option(help="Contrast threshold: 0.2, or ON,OFF: 0.2,0.25.")] = "0.2",
    method: METHOD = "esim-ad",
    gate: Annotated[
        Gate,
        typer.Option(
            help="Where the fit is solved. delta-r-exact (to check delta-r) and published (the ICIP 2023 program's) "
            "keep old windows and run in numpy, slowly."
        ),
    ] = "radiance",
    gate_scale: Annotated[float, typer.Option(help="s: the radiance gate opens beyond s·C.")] = 1.0,
    box: Annotated[int, typer.Option(help="Side of the radiance gate's box means [pixels], odd.")] = 5,
    event_rule: EVENT_RULE = "interpolated",
    window: Annotated[
        int | None, typer.Option(help="Side of the window [pixels], odd, 3…21. [7 for irradiance, else 13]")
    ] = None,
    stride: Annotated[int, typer.Option(help="Step between the window's samples [pixels], 1…3.")] = 1,
    history: HISTORY = 1,
    kernel: Annotated[Kernel, typer.Option(help="Weight of a sample by its distance in feature space.")] = "gaussian",
    bandwidth: Annotated[
        Bandwidth,
        typer.Option(
            help="fixed; or chosen per pixel: tsvd leaves out noisy directions of feature space, optimised also weighs "
            "bias against variance. Both need variance planes and run in numpy, slowly."
        ),
    ] = "fixed",
    bandwidth_h: Annotated[float, typer.Option(help="Bandwidth h of the weights.")] = 1.0,
    ridge: Annotated[float, typer.Option(help="λ: how much β is penalised.")] = 1e-5,
    regress: Annotated[
        Regress,
        typer.Option(
            help="What is regressed: log brightness, as in the paper; or linear luminance, whose log is taken then: "
            "that of few samples is too low on average."
        ),
    ] = "log",
    shrink: Annotated[
        float,
        typer.Option(
            help="How readily a pixel's own value counts where its window's residual is more than noise: 0 never, "
            "1.5 is good. Needs --regress linear and the plane Variance.Luminance."
        ),
    ] = 0.0,
    response: Annotated[Response, typer.Option(help="Brightness of a luminance.")] = "ln",
    luminance: Annotated[Luminance, typer.Option(help="Weights of R, G and B.")] = "rec709",
    scale: Annotated[float, typer.Option(help="Factor on luminance.")] = 1.0,
    floor: Annotated[float, typer.Option(help="Smallest luminance after scaling.")] = 1e-4,
    features: Annotated[str, typer.Option(help="auto, or planes by name: Depth,Nx,Ny,Nz,Albedo.R …")] = "auto",
    precision: Annotated[Precision, typer.Option(help="Arithmetic of the regression.")] = "float32",
    opencl: OPENCL = None,
    format: FORMAT = None,
    text_time: TEXT_TIME = None,
    as_json: JSON = False,
) -> int:
    """Turn a sequence of EXR frames into events.

    Example: `clsim detect frames --fps 60 --out events.aedat4`
    """
    from clsim.cli.status import run_session
    from clsim.detect.config import DetectorConfig
    from clsim.events.address import is_standard_output
    from clsim.events.outputs import FileOptions
    from clsim.live.options import RecordingOptions
    from clsim.live.session import open_recording

    if as_json and any(map(is_standard_output, out)):
        raise InputError("--json and --out - would both write to standard output; give --out a file instead")
    on, off = parse.threshold(threshold)
    config = DetectorConfig(
        method=method,
        gate=gate,
        event_rule=event_rule,
        threshold_on=on,
        threshold_off=off,
        window=window,
        stride=stride,
        history=history,
        box=box,
        gate_scale=gate_scale,
        kernel=kernel,
        bandwidth=bandwidth,
        bandwidth_h=bandwidth_h,
        ridge=ridge,
        regress=regress,
        shrink=shrink,
        response=response,
        luminance=luminance,
        scale=scale,
        floor=floor,
        features=None if features == "auto" else tuple(name.strip() for name in features.split(",")),
        precision=precision,
    )
    options = RecordingOptions(frames, config, fps, opencl, tuple(out), FileOptions(format, text_time))
    return run_session(open_recording(options), as_json=as_json)
