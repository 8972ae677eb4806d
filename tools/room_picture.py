"""The picture of a room in the README: what the camera sees, and the events of two versions of clsim.

python tools/room_picture.py SCENE before.npz after.npz docs/images/room.png

Both recordings are of the same motion, made by ``clsim live SCENE --resolution 173x130 --frame-count 12``.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

from clsim.events.batch import gather
from clsim.events.files import open_source
from clsim.frames import page_aligned
from clsim.frames.frame import Frame
from clsim.frames.tonemap import ToneMap
from clsim.live.options import LiveOptions
from clsim.live.stages import plan_stages
from clsim.render import View

WIDTH, HEIGHT, ZOOM, GAP, TITLE = 173, 130, 2, 8, 20


def seen(scene: str) -> npt.NDArray[np.uint8]:
    """Return the first frame, ``[H, W, 3]``."""
    stages = plan_stages(LiveOptions(scene, resolution=(WIDTH, HEIGHT), frame_count=1, spp=64, quality="accurate"))
    view = View(stages.scene_data(), stages.render)
    frame = Frame(page_aligned((len(stages.planes), HEIGHT, WIDTH)), stages.planes)
    view.fill(0, frame)
    view.close()
    return ToneMap()(np.stack([frame.plane(name) for name in "RGB"], axis=-1))


def drawn(events: Any) -> npt.NDArray[np.uint8]:
    """Return all events on white: the last one of a pixel, brighter in red and darker in blue."""
    picture = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)
    picture[events["y"], events["x"]] = np.where(events["on"][:, None], (200, 40, 30), (40, 70, 200))
    return picture


def main(scene: str, before: str, after: str, target: str) -> None:
    """Draw the three panels side by side."""
    panels = [("what the camera sees", seen(scene))]
    for title, name in (("before", before), ("now", after)):
        events = gather(open_source(name))
        panels.append((f"{title}: {len(events):,} events in {events['t'].max() / 1e6:.2f} s", drawn(events)))
    step = ZOOM * WIDTH + GAP
    sheet = Image.new("RGB", (len(panels) * step - GAP, ZOOM * HEIGHT + TITLE), "white")
    draw = ImageDraw.Draw(sheet)
    for k, (title, picture) in enumerate(panels):
        large = Image.fromarray(picture).resize((ZOOM * WIDTH, ZOOM * HEIGHT), Image.Resampling.NEAREST)
        sheet.paste(large, (k * step, TITLE))
        draw.text((k * step, 4), title, fill="black")
    sheet.save(target)


if __name__ == "__main__":
    main(*sys.argv[1:])
