"""Write docs/planes.md: what the planes of a frame mean.

python tools/pages/plane_table.py docs/planes.md
"""

from __future__ import annotations

import sys
from pathlib import Path

from clsim.frames import PLANES, Plane

INTRODUCTION = """# The planes of a frame

A frame is a stack of planes, one number for each pixel and plane. `clsim render SCENE --out DIR` writes each frame as
an EXR file with a channel for every plane; `clsim detect` reads them back. Row 0 is the top of the image.

`balanced` and `accurate` spend more first-hit rays on pixels that are near an event. Which pixels are near depends on
the contrast threshold of the run. Other pixels are less exact. To detect events of several thresholds in one set of
frames, render with the smallest threshold (`--threshold`), or with `--quality exact`, which spends the same on every
pixel.

"""

CONVENTIONS = """
**How samples become a value.** A pixel's samples lie all over the pixel's square and have equal weight.

- *mean*: over all samples.
- *mean over hits*: over the samples that hit something; 0 where no sample did. At a silhouette, this mean mixes the
  surfaces on both sides, but never a surface and the background.
- *sum*: over all samples.

**The seen surface** is the first surface that a ray hits, lamps included. If this surface is a perfect mirror or
clear glass, the ray continues, and the seen surface is the one seen in the mirror or through the glass; albedo,
normal and depth are those of that surface. Where light is cached, glossy metal and frosted glass (roughness up to .7,
without a normal map) count as a mirror and as clear glass. (`follow_specular = false` in a `--config` file switches
this off.) Where a mirror shows nothing but the sky, the mirror itself is the seen surface; in frames with first-hit
rays, the sky is. A spherical lamp has albedo 0.

**Frames with first-hit rays** take albedo, normal, depth, coverage and emission from first-hit rays: primary rays
that end at the seen surface. `Samples` counts these rays and the light paths together. Albedo is at least 0.001 on a
hit.

**Depth** is the length of the ray from the camera to the seen surface, with all segments added up. It is not the
distance along the camera's axis. Depth is a mean over the samples that hit something, and 0 where no sample did;
`Coverage` shows how many did.

**Variances** are those of the pixel's value, not of a single sample: a variance falls as samples are added. It is NaN
if fewer than two samples (or hits) contribute. With the Sobol sampler, samples within a batch depend on each other,
so the variance is taken over batches. `Variance.Luminance` is a plane of its own: red, green and blue vary together,
so it cannot be computed from their variances.

**Truth** (`--truth`) is the value for one ray through the pixel's centre, at the frame's very time. It is not
averaged over the pixel, the exposure or the aperture. The ray ends at the first surface whose opacity is at least one
half. At mirrors and glass, truth is that of the mirror or glass surface itself. Flow is the motion of the point at
the pixel's centre, exact to fractions of a pixel. A pixel that shows two surfaces has the flow of the surface at its
centre. Flow of the sky is that of a point infinitely far away. [ground-truth.md](ground-truth.md) has the rest.

**World axes.** The world is right-handed with +y up; lengths are metres. Normals are along these axes, not the
camera's.

**Pose axes.** A pose is a 4×4 matrix that takes points of the object or camera to the world; its columns are the
object's x, y and z axes and its position. A camera looks along its −z axis, +x is to the right of the image and +y to
its top. OpenCV's and ROS's cameras look along +z with +y down: negate the second and third column to get a pose in
these axes. The poses beside a recording, such as `events.aedat4.poses.txt`, are already in OpenCV's axes, as the
file's first lines say.

**Radiance** is linear and in the Rec. 709 primaries, in the units of the scene's lights. Luminance is
0.2126 R + 0.7152 G + 0.0722 B.
"""

_GIVEN = {
    "always": "always",
    "first-hit rays": "with first-hit rays",
    "variance only": "only the variance",
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
