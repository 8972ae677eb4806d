"""The figures and the picture of docs/quality.md: what each quality costs and how wrong it is, in four kinds of scene.

python -m tools.pages.quality_page measure LIVING-ROOM/scene.xml --cache FOLDER     # an hour on two cores
python -m tools.pages.quality_page draw LIVING-ROOM/scene.xml docs/images/quality.png
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

import clsim
from clsim.bench.tradeoff.settings import named_points
from clsim.bench.tradeoff.sweep import TradeoffOptions, run_tradeoff
from clsim.events.batch import gather
from clsim.frames.tonemap import ToneMap
from clsim.scene import World
from clsim.scene.motion import Keyframes

QUALITIES = ("draft", "balanced", "accurate")
_STILL = "position = [0.0, 1.0, 3.35]\nlook_at = [0.0, 1.0, 0.0]\n"
_MOVING = """keyframes = [
  { time_s = 0.0, position = [0.0, 1.0, 3.35], look_at = [0.0, 1.0, 0.0] },
  { time_s = 2.0, position = [1.6, 1.0, 3.35], look_at = [0.0, 1.0, 0.0] },
]
"""
_WIDTH, _HEIGHT, _ZOOM, _GAP, _TITLE = 173, 130, 2, 6, 18
_SHOWN_US = 33_000


def both(folder: Path) -> Path:
    """Write Cornell's box before a camera that moves, and return the file."""
    path = Path(clsim.__file__).parent / "scenes" / "cornell.toml"
    text = path.read_text(encoding="utf-8")
    assert text.count(_STILL) == 1
    target = folder / "cornell-moving-camera.toml"
    target.write_text(text.replace(_STILL, _MOVING), encoding="utf-8")
    return target


def measure(room: str, cache: Path) -> None:
    """Print a row for each scene and quality: events, scores, equivalent mismatch, processor time."""
    cache.mkdir(parents=True, exist_ok=True)
    scenes: dict[str, tuple[Any, int, int]] = {
        "the camera moves (two-boxes)": ("two-boxes", 24, 2048),
        "a thing moves (cornell)": ("cornell", 24, 2048),
        "both move (cornell, camera 0.8 m/s)": (both(cache), 24, 2048),
        "hard light (living-room)": (room, 12, 2048),
    }
    print("| scene | quality | events, true | F1 in 1 ms | strict F1 | mismatch | CPU s a megapixel-second |")
    for title, (scene, frames, spp) in scenes.items():
        named = tuple(named_points(0)[name] for name in QUALITIES)
        options = TradeoffOptions(
            scene, cache, quick=True, reference_spp=spp, resolution=(64, 48), frames=frames, points=named
        )
        results = run_tradeoff(options, lambda *_: None)
        for name, point in zip(QUALITIES, results["points"], strict=True):
            mismatch = point["equivalent_mismatch"]
            print(
                f"| {title} | {name} | {point['events']}, {results['reference']['events']['interpolated']} | "
                f"{point['f1_within_1ms']:.2f} | {point['strict_f1']:.2f} | "
                f"{'-' if mismatch is None else f'{100 * mismatch:.1f} %'} | "
                f"{point['cpu_us_per_pixel_second']:.0f} |",
                flush=True,
            )
        ceiling = results["ceiling"]["interpolated"]
        print(f"| {title} | another reference | | {ceiling['f1_within_1ms']:.2f} | {ceiling['strict_f1']:.2f} | | |")


def draw(room: str, target: Path) -> None:
    """Draw two scenes, a row each: what is rendered, and the events of each quality in the same 33 ms."""
    with tempfile.TemporaryDirectory() as folder:
        rows = {
            "Cornell's box: block and camera move": clsim.load_scene(both(Path(folder)), resolution=(_WIDTH, _HEIGHT)),
            "A room lit through windows: the camera moves": _strolled(
                clsim.load_scene(room, resolution=(_WIDTH, _HEIGHT))
            ),
        }
    width, height = _WIDTH * _ZOOM, _HEIGHT * _ZOOM
    sheet = Image.new("RGB", (4 * (width + _GAP) - _GAP, 2 * (height + _TITLE + _GAP) - _GAP), "white")
    pen = ImageDraw.Draw(sheet)
    for row, (title, world) in enumerate(rows.items()):
        panels = {title: _seen(world)} | {name: _drawn(_events(world, name)) for name in QUALITIES}
        top = row * (height + _TITLE + _GAP)
        for column, (text, picture) in enumerate(panels.items()):
            left = column * (width + _GAP)
            pen.text((left + 2, top + 3), text, "black", font_size=13)
            sheet.paste(
                Image.fromarray(picture).resize((width, height), Image.Resampling.NEAREST), (left, top + _TITLE)
            )
    sheet.quantize(64).save(target, optimize=True)


def _strolled(world: World) -> World:
    """Return a room whose camera goes to the right by half a metre a second."""
    pose = world.camera.motion.pose(0.0)
    begin, right = pose[:3, 3], pose[:3, 0]
    turn = _quaternion(pose)
    motion = Keyframes((0.0, 2.0), (tuple(begin), tuple(begin + right)), (turn, turn))
    return replace(world, camera=replace(world.camera, motion=motion))


def _quaternion(pose: npt.NDArray[np.float64]) -> tuple[float, float, float, float]:
    from clsim.scene.rigid import quaternion_of, without_scale

    x, y, z, w = quaternion_of(without_scale(pose)[:3, :3])
    return float(x), float(y), float(z), float(w)


def _events(world: World, quality: Any) -> Any:
    with clsim.stream(world, fps=120.0, frame_count=13, quality=quality) as run:
        events = gather(np.array(batch, copy=True) for batch in run)
    return events[events["t"] > events["t"].max() - _SHOWN_US]


def _seen(world: World) -> npt.NDArray[np.uint8]:
    with clsim.Simulator(world, fps=120.0, quality="accurate", time="fixed") as simulator:
        simulator.step(100_000)
        frame = simulator.frame()
    return ToneMap()(np.stack([frame.plane(name) for name in "RGB"], axis=-1))


def _drawn(events: Any) -> npt.NDArray[np.uint8]:
    """Return all events on white, ON red and OFF blue."""
    picture = np.full((_HEIGHT, _WIDTH, 3), 255, np.uint8)
    picture[events["y"], events["x"]] = np.where(events["on"][:, None], (200, 40, 30), (40, 70, 200))
    return picture


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=("measure", "draw"))
    parser.add_argument("room")
    parser.add_argument("target", nargs="?", type=Path)
    parser.add_argument("--cache", type=Path, default=Path("cache"))
    given = parser.parse_args()
    if given.what == "measure":
        measure(given.room, given.cache)
    else:
        draw(given.room, given.target)
