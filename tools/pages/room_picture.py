"""The picture of a room in the README, in which a crate crosses before a camera that moves.

python -m tools.pages.room_picture record SCENE before.npz     # with another version of clsim installed
python -m tools.pages.room_picture record SCENE after.npz
python -m tools.pages.room_picture draw SCENE before.npz after.npz docs/images/room.png
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

from clsim.events.batch import gather
from clsim.events.files import open_source
from clsim.frames import page_aligned
from clsim.frames.frame import Frame
from clsim.frames.tonemap import ToneMap
from clsim.live import stages as live_stages
from clsim.live.options import LiveOptions
from clsim.live.stages import plan_stages
from clsim.render import View
from clsim.scene import Instance, Material, World, load_world, shapes
from clsim.scene.motion import Keyframes

WIDTH, HEIGHT, ZOOM, GAP, TITLE = 173, 130, 2, 8, 20
_AHEAD_M, _SIDE_M, _SPEED_M_S, _LASTS_S = 2.2, 0.5, 1.0, 2.0


def crossed(scene: str) -> World:
    """Return the scene with a crate that crosses the room, some way ahead of where the camera begins."""
    world = load_world(scene, resolution=(WIDTH, HEIGHT))
    pose = world.camera.motion.pose(0.0)
    begin = pose[:3, 3] - _AHEAD_M * pose[:3, 2] - (0.0, 0.3, 0.0) - 0.25 * pose[:3, 0]
    end = begin + _SPEED_M_S * _LASTS_S * pose[:3, 0]
    upright = (0.0, 0.0, 0.0, 1.0)
    motion = Keyframes((0.0, _LASTS_S), (tuple(begin), tuple(end)), (upright, upright))
    crate = shapes.box((_SIDE_M,) * 3, len(world.materials))
    return replace(
        world,
        materials=(*world.materials, Material(color=(0.55, 0.4, 0.25), name="crate")),
        meshes=(*world.meshes, crate),
        instances=(*world.instances, Instance(len(world.meshes), motion, "crate")),
    )


def record(scene: str, target: str) -> None:
    """Write the events of twelve frames of such a room."""
    import clsim

    world = crossed(scene)
    live_stages.load_options_world = lambda options: world  # type: ignore[assignment]
    with clsim.stream("two-boxes", fps=120.0, frame_count=12, resolution=(WIDTH, HEIGHT)) as run:
        events = gather(np.array(batch, copy=True) for batch in run)
    with clsim.write(target, WIDTH, HEIGHT) as out:
        out.write(events, 100_000)


def seen(scene: str) -> npt.NDArray[np.uint8]:
    """Return the first frame, ``[H, W, 3]``."""
    options = LiveOptions(scene, resolution=(WIDTH, HEIGHT), frame_count=1, spp=64, quality="accurate")
    stages = plan_stages(options, crossed(scene))
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


def draw(scene: str, before: str, after: str, target: str) -> None:
    """Draw the three panels side by side."""
    panels = [("what the camera sees", seen(scene))]
    for title, name in (("before", before), ("now", after)):
        events = gather(open_source(name))
        panels.append((f"{title}: {len(events):,} events in {events['t'].max() / 1e6:.2f} s", drawn(events)))
    step = ZOOM * WIDTH + GAP
    sheet = Image.new("RGB", (len(panels) * step - GAP, ZOOM * HEIGHT + TITLE), "white")
    pen = ImageDraw.Draw(sheet)
    for k, (title, picture) in enumerate(panels):
        large = Image.fromarray(picture).resize((ZOOM * WIDTH, ZOOM * HEIGHT), Image.Resampling.NEAREST)
        sheet.paste(large, (k * step, TITLE))
        pen.text((k * step, 4), title, fill="black")
    sheet.save(target)


if __name__ == "__main__":
    {"record": record, "draw": draw}[sys.argv[1]](*sys.argv[2:])
