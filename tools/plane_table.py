"""Write docs/planes.md: what the planes of a frame mean.

python tools/plane_table.py docs/planes.md
"""

from __future__ import annotations

import sys
from pathlib import Path

from clsim.frames import PLANES, Plane

INTRODUCTION = """# The planes of a frame

A frame is a stack of planes, one number for each pixel and plane. `clsim render SCENE --out DIR` writes each frame as
an EXR file with a channel for every plane; `clsim detect` reads them back. Row 0 is the top of the image.

Named qualities spend rays and paths where an event is near, by the thresholds of the run. Elsewhere frames are less
exact. To detect events of several thresholds in one set of frames, render with the smallest of them (`--threshold`), or
with `--quality exact`, which spends the same everywhere.

"""

CONVENTIONS = """
**How samples become a value.** A pixel's samples lie all over the pixel's square and count alike.

- *mean*: over all samples.
- *mean over hits*: over the samples that hit something; 0 where none did. At a silhouette it is a mixture of the
  surfaces on both sides, but never of a surface and the background.
- *sum*: over all samples.

**The seen surface** is the first that a ray hits, lamps included. Perfect mirrors and clear glass are followed to what
is seen in them (`follow_specular = false` in a `--config` file does without), and albedo, normal and depth are of that.
Where a mirror shows nothing but the sky, the mirror itself is the seen surface. A spherical lamp has albedo 0.

**Frames with first-hit rays** take albedo, normal, depth, coverage and emission from rays that end at the seen surface.
`Samples` counts these rays and the light paths together; albedo is at least 0.001 on a hit.

**Depth** is the length of the ray's way from the camera to the seen surface, all segments added up: not the distance
along the camera's axis. It is a mean over the samples that hit, and 0 where none did: `Coverage` tells a miss.

**Variances** are those of the pixel's value, not of a single sample: they fall as samples are added. They are NaN where
fewer than two samples (or hits) tell of them. With the Sobol sampler, samples within a batch depend on each other, and
the batches count instead. `Variance.Luminance` stands by itself: red, green and blue vary together, so it does not
follow from theirs.

**Truth** (`--truth`) is of a ray through the pixel's centre, at the frame's very time: no mean over the pixel, the
exposure or the aperture. It shows the first surface whose opacity is at least one half; mirrors and glass count as
themselves. Flow is the way of the point at the pixel's centre, so a fraction of a pixel means just that: a pixel that
shows two surfaces has the flow of the one in its middle. Flow of the sky is that of a thing infinitely far.
[ground-truth.md](ground-truth.md) has the rest.

**World axes.** The world is right-handed with +y up; lengths are metres. Normals are along these axes, not the
camera's.

**Pose axes.** A pose is a 4×4 matrix that takes points of the object or camera to the world; its columns are the
object's x, y and z axes and its position. A camera looks along its −z axis, +x is to the right of the image and +y to
its top. OpenCV's and ROS's cameras look along +z with +y down: negate the second and third column for theirs. So do
the poses beside a recording, in `NAME.poses.txt`, as its first lines say.

**Radiance** is linear and in the Rec. 709 primaries, in the units of the scene's lights. Luminance is
0.2126 R + 0.7152 G + 0.0722 B.
"""

_GIVEN = {
    "always": "always",
    "first-hit rays": "with first-hit rays",
    "variance only": "its variance only",
    "truth": "with `--truth`",
}


def row(plane: Plane) -> str:
    """Return the plane's row of the table."""
    channels = plane.channels if plane.given != "variance only" else ()
    shown = ", ".join(f"`{channel}`" for channel in channels) or "–"
    variance = ", ".join(f"`{channel}`" for channel in plane.variance_channels) or "–"
    cells = (plane.name, shown, plane.unit, plane.meaning, plane.reduction, _GIVEN[plane.given], variance)
    return f"| {' | '.join(cells)} |"


def text() -> str:
    """Return the whole page."""
    head = "| plane | channels | unit | meaning | of the samples | in rendered frames | variance |"
    table = "\n".join([head, "|---" * 7 + "|", *map(row, PLANES)])
    return f"{INTRODUCTION}{table}\n{CONVENTIONS}"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(text())
