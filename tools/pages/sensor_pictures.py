"""The pictures of docs/sensor.md: what each stage does to a moving disc, what causes its events, and the live view.

python tools/pages/sensor_pictures.py stages docs/images/sensor-stages.png
python tools/pages/sensor_pictures.py causes docs/images/sensor-causes.png  # needs Chromium
python tools/pages/sensor_pictures.py view docs/images/sensor-view.png      # needs Chromium
python tools/pages/sensor_pictures.py costs      # prints what a step of the disc costs with each stage [ms of CPU]
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from clsim.events.files import open_sink
from clsim.sensor import SensorSettings, load_sensor
from clsim.sensor.lab import Lab
from clsim.sensor.pixel_stages import Defects, Delay, FrontEnd, Leak, Noise, Refractory, Threshold
from clsim.sensor.settings import Readout

SIZE = (160, 120)
STEP_US, SHOWN_US, END_US = 1000, 15_000, 120_000
ON, OFF = (30, 90, 200), (200, 50, 40)
STAGES = {
    "ideal": SensorSettings(),
    "threshold: mismatch of 0.06": SensorSettings(threshold=Threshold(mismatch=0.06)),
    "front_end: 0.3 lux, 300 Hz per lux": SensorSettings(front_end=FrontEnd(0.0, 300.0, 3000.0)),
    "front_end: dark_lux as bright as the scene": SensorSettings(front_end=FrontEnd(100.0)),
    "noise: 2 events/s of either polarity": SensorSettings(noise=Noise((2.0,), (2.0,))),
    "noise: shot, 0.08": SensorSettings(front_end=FrontEnd(0.0, None, 300.0), noise=Noise(shot=0.08)),
    "leak: 3 events/s": SensorSettings(leak=Leak(3.0, 0.25)),
    "defects: 1 % hot, 5 % dead": SensorSettings(defects=Defects(0.01, 200.0, 0.3, 0.05)),
    "refractory: 20 ms": SensorSettings(refractory=Refractory(20_000.0)),
    "delay: 10 ms, jitter 3 ms": SensorSettings(delay=Delay(10_000.0, 3000.0)),
    "readout: a bus of 0.1 million events/s": SensorSettings(readout=Readout(event_us=10.0, most_wait_us=2000.0)),
    "davis346": load_sensor("davis346"),
}
DIM = {"front_end: 0.3 lux, 300 Hz per lux": 0.3}


def disc(time_us: int) -> npt.NDArray[np.float64]:
    """Return the log brightness of a disc that moves over a background with a gradient, ``[H, W]``."""
    y, x = np.mgrid[0 : SIZE[1], 0 : SIZE[0]] + 0.5
    centre = 30 + 0.8e-3 * time_us
    inside = 1 / (1 + np.exp(np.hypot(x - centre, y - 60) - 28))
    return np.asarray(0.6 * x / SIZE[0] + inside * (1.0 + 0.25 * np.sin(0.5 * (x - centre))))


def picture(events: npt.NDArray[Any], size: tuple[int, int]) -> npt.NDArray[np.uint8]:
    """Return ON events in blue and OFF events in red on white, ``[H, W, 3]``."""
    out = np.full((size[1], size[0], 3), 255, np.uint8)
    out[events["y"], events["x"]] = np.where(events["on"][:, None], ON, OFF)
    return out


def titled(image: npt.NDArray[np.uint8], title: str, scale: int) -> Image.Image:
    """Return an image with a line of text above it."""
    large = Image.fromarray(image).resize((image.shape[1] * scale, image.shape[0] * scale), Image.Resampling.NEAREST)
    out = Image.new("RGB", (large.width + 10, large.height + 28), "white")
    out.paste(large, (5, 24))
    draw = ImageDraw.Draw(out)
    draw.rectangle((4, 23, 5 + large.width, 24 + large.height), outline=(190, 190, 190))
    draw.text((6, 5), title, "black", ImageFont.load_default(13))
    return out


def sheet(images: list[Image.Image], columns: int) -> Image.Image:
    """Return images in rows."""
    width, height = images[0].size
    out = Image.new("RGB", (columns * width, -(-len(images) // columns) * height), "white")
    for k, image in enumerate(images):
        out.paste(image, (k % columns * width, k // columns * height))
    return out


def stages() -> Image.Image:
    """Return the disc's events of the last milliseconds, as each stage alone leaves them."""
    shown = []
    for title, settings in STAGES.items():
        lab = Lab(settings, *SIZE, lux=DIM.get(title, 100.0))
        batches = [lab.to(t, disc(t)).events for t in range(0, END_US + 1, STEP_US)]
        events = np.concatenate(batches)
        shown.append(titled(picture(events[events["t"] > END_US - SHOWN_US], SIZE), title, 2))
    return sheet(shown, 3)


def costs(rounds: int = 2) -> None:
    """Print the medians of all steps' CPU time, sensors taken in turn."""
    sensors = STAGES | {"davis346, shot noise instead of rates": replace(STAGES["davis346"], noise=Noise(shot=0.05))}
    taken: dict[str, list[float]] = {title: [] for title in sensors}
    for _ in range(rounds):
        for title, settings in sensors.items():
            lab = Lab(settings, *SIZE, lux=DIM.get(title, 100.0))
            for t in range(0, END_US + 1, STEP_US):
                levels, began = disc(t), time.process_time()
                lab.to(t, levels)
                taken[title].append(time.process_time() - began)
    for title, seconds in taken.items():
        print(f"| {title} | {1e3 * float(np.median(seconds)):.1f} |")


def view() -> Image.Image:
    """Return the live view's page before the ideal sensor and before a camera's, through the same lens."""
    optics = load_sensor("davis346").optics
    with tempfile.TemporaryDirectory() as folder:
        ideal = Path(folder, "ideal.toml")
        ideal.write_text(f"[optics]\nwidth = {optics.width}\nheight = {optics.height}\nfov_deg = {optics.fov_deg}\n")
        shown = []
        for sensor in (str(ideal), "davis346"):
            shot = Path(folder, "page.png")
            how = ("--live", "--wait", "25", "--size", "1100x760", "--theme", "light", "--sensor", sensor)
            script = Path(__file__).with_name("screenshot_view.py")
            subprocess.run([sys.executable, str(script), "two-boxes", str(shot), *how], check=True)
            shown.append(Image.open(shot).convert("RGB"))
    out = sheet(shown, 2)
    return out.resize((1800, 1800 * out.height // out.width), Image.Resampling.LANCZOS).quantize(128, dither=0)


def causes() -> Image.Image:
    """Return the page of a recording of the disc, whose sensor errs often, coloured by what caused each event."""
    with tempfile.TemporaryDirectory() as folder:
        name, shot = Path(folder, "disc.h5"), Path(folder, "page.png")
        sink = open_sink(name, *SIZE, labels=("cause",))
        often = {"noise": Noise((1.0,), (1.0,)), "leak": Leak(1.0, 0.25), "defects": Defects(0.002, 200.0)}
        lab = Lab(replace(STAGES["davis346"], **often), *SIZE, lux=10.0)
        for t in range(0, END_US + 1, STEP_US):
            fired = lab.to(t, disc(t))
            sink.write(fired.events, t, fired.causes)
        sink.close()
        script = Path(__file__).with_name("screenshot_view.py")
        how = ("--wait", "6", "--size", "1200x620", "--theme", "light", "--colours", "cause")
        settings = ("--settings", '{"windowUs": 15000, "depthUs": 120000, "full": 2}')
        last = ("--script", "for (const id of ['loop', 'play']) document.getElementById(id).click()")
        subprocess.run([sys.executable, str(script), str(name), str(shot), *how, *settings, *last], check=True)
        return Image.open(shot).convert("RGB")


if __name__ == "__main__":
    if sys.argv[1] == "costs":
        costs()
    else:
        {"stages": stages, "causes": causes, "view": view}[sys.argv[1]]().save(sys.argv[2], optimize=True)
