"""Draw scenes beside their events, one row a scene: what docs/images/scenes.png shows.

python tools/pages/contact_sheet.py docs/images/scenes.png two-boxes moving-light cornell …
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

import clsim
from clsim.frames import BASE_PLANES, RADIANCE, Frame, page_aligned
from clsim.frames.tonemap import ToneMap
from clsim.live.view.accumulate import colour_indices, signed_image
from clsim.live.view.colormaps import lut
from clsim.render import PathTracer, RenderOptions
from clsim.scene import load_world

RGB = npt.NDArray[np.uint8]
GAP = 4


@dataclass(frozen=True)
class Sheet:
    """How the pictures are made."""

    width: int
    height: int
    spp: int
    clean_spp: int
    frames: int
    fps: float


def main() -> None:
    """Parse the arguments, draw, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--resolution", default="240x180")
    parser.add_argument("--spp", type=int, default=8, help="paths per pixel for the events")
    parser.add_argument("--clean-spp", type=int, default=128, help="paths per pixel for the picture of the scene")
    parser.add_argument("--frames", type=int, default=4)
    parser.add_argument("--fps", type=float, default=60.0)
    parser.add_argument("--columns", type=int, default=1)
    options = parser.parse_args()
    width, height = map(int, options.resolution.split("x"))
    sheet = Sheet(width, height, options.spp, options.clean_spp, options.frames, options.fps)
    tiles = [draw(scene, sheet) for scene in options.scenes]
    while len(tiles) % options.columns:
        tiles.append(np.full_like(tiles[0], 255))
    rows = [np.concatenate(tiles[i : i + options.columns], axis=1) for i in range(0, len(tiles), options.columns)]
    options.out.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.concatenate(rows)).save(options.out, optimize=True)


def draw(scene: str, sheet: Sheet) -> RGB:
    """Return the scene, and the events between its first frames, side by side."""
    world = load_world(scene, resolution=(sheet.width, sheet.height))
    tracer = PathTracer(world, RenderOptions(spp=sheet.clean_spp, fps=sheet.fps))
    frame = Frame(page_aligned((len(BASE_PLANES), sheet.height, sheet.width)), tracer.names)
    tracer.fill(sheet.frames // 2, frame)
    tracer.close()
    picture = ToneMap()(np.stack([frame.plane(name) for name in RADIANCE], axis=-1))
    options = {"resolution": (sheet.width, sheet.height), "frame_count": sheet.frames + 1, "fps": sheet.fps}
    events = np.concatenate(list(clsim.stream(scene, spp=sheet.spp, **options)))
    image = colour_indices(signed_image(events, sheet.width, sheet.height), full=2.0)
    shown = lut()[image][..., :3]
    label = f"{world.name}: {len(events):,} events in {sheet.frames / sheet.fps * 1e3:.0f} ms, {sheet.spp} spp"
    both = np.concatenate([picture, np.full((sheet.height, GAP, 3), 255, np.uint8), shown], axis=1)
    framed = np.full((both.shape[0] + 18, both.shape[1] + GAP, 3), 255, np.uint8)
    framed[18:, :-GAP] = both
    canvas = Image.fromarray(framed)
    ImageDraw.Draw(canvas).text((2, 3), label, fill=(0, 0, 0))
    return np.asarray(canvas)


if __name__ == "__main__":
    main()
