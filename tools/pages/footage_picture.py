"""The picture of docs/video.md: a video, and its events with and without its transfer function undone.

python tools/pages/footage_picture.py docs/images/video.png
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import av
import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

import clsim
from clsim.events.batch import gather
from clsim.frames import page_aligned
from clsim.frames.frame import Frame
from clsim.live.options import LiveOptions
from clsim.live.stages import plan_stages
from clsim.render import View

WIDTH, HEIGHT, FRAMES, FPS = 320, 240, 24, 240


def render() -> list[npt.NDArray[np.float32]]:
    """Return the linear light of a bundled scene, frame by frame ``[H, W, 3]``."""
    options = LiveOptions("two-boxes", resolution=(WIDTH, HEIGHT), fps=FPS, sampling="uniform", spp=32)
    stages = plan_stages(options)
    view = View(stages.scene_data(), stages.render)
    frame = Frame(page_aligned((len(stages.planes), HEIGHT, WIDTH)), stages.planes)
    found = []
    for index in range(FRAMES):
        view.fill(index, frame)
        found.append(np.stack([frame.plane(name) for name in "RGB"], axis=-1))
    view.close()
    return found


def write_video(path: Path, light: list[npt.NDArray[np.float32]]) -> npt.NDArray[np.uint8]:
    """Write 8-bit video in BT.709; returns the middle frame."""
    exposure = 0.8 / np.percentile(light[0], 95)
    pictures = []
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", rate=FPS, options={"crf": "10"})
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        for each in light:
            y = np.clip(each * exposure, 0, 1)
            stored = np.where(y < 0.018, 4.5 * y, 1.099 * y**0.45 - 0.099)
            pictures.append(np.round(stored * 255).astype(np.uint8))
            out.mux(stream.encode(av.VideoFrame.from_ndarray(pictures[-1], format="rgb24")))
        out.mux(stream.encode(None))
    return pictures[FRAMES // 2]


def drawn(events: Any) -> npt.NDArray[np.uint8]:
    picture = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)
    some = events[(events["t"] > 40_000) & (events["t"] < 55_000)]
    picture[some["y"], some["x"]] = np.where(some["on"][:, None], (200, 40, 30), (40, 70, 200))
    return picture


def main(target: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.mp4"
        middle = write_video(path, render())
        panels = [("a frame of the video", middle)]
        for title, transfer in (("--transfer bt709", "bt709"), ("--transfer as-is", "as-is")):
            events = gather(clsim.events_from(str(path), transfer=transfer))
            panels.append((f"{title}: {len(events):,} events in 0.1 s, 15 ms drawn", drawn(events)))
    sheet = Image.new("RGB", (3 * (WIDTH + 8), HEIGHT + 24), "white")
    draw = ImageDraw.Draw(sheet)
    for k, (title, picture) in enumerate(panels):
        sheet.paste(Image.fromarray(picture), (k * (WIDTH + 8) + 4, 20))
        draw.text((k * (WIDTH + 8) + 4, 4), title, fill="black")
    sheet.save(target)


if __name__ == "__main__":
    main(sys.argv[1])
