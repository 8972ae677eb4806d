"""What all examples draw with: events on white, grey pictures, and sheets of them."""

import sys
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw


def events_picture(events, width, height):
    """Return events as a picture [H, W, 3]: ON red, OFF blue, the last one of a pixel counts."""
    picture = np.full((height, width, 3), 255, np.uint8)
    picture[events["y"], events["x"]] = np.where(events["on"][:, None], (200, 40, 30), (40, 70, 200))
    return picture


def grey_picture(values, low=None, high=None):
    """Return numbers [H, W] as a picture [H, W, 3], from black to white; what is not finite is white."""
    known = values[np.isfinite(values)]
    low = known.min() if low is None else low
    high = known.max() if high is None else high
    grey = np.nan_to_num((values - low) / max(high - low, 1e-9), nan=1.0, posinf=1.0).clip(0, 1)
    return np.repeat((255 * grey).astype(np.uint8)[..., None], 3, axis=2)


def light_picture(frame):
    """Return a rendered frame as a screen shows it [H, W, 3]."""
    light = np.stack([frame.plane(name) for name in "RGB"], axis=-1)
    return (255 * (light / np.percentile(light, 99)).clip(0, 1) ** (1 / 2.2)).astype(np.uint8)


def save(panels, default, columns=4, zoom=2):
    """Write pictures with their titles, in the order given, to the path on the command line, or to the default."""
    target = Path(sys.argv[1] if len(sys.argv) > 1 else default)
    height, width = (zoom * size for size in next(iter(panels.values())).shape[:2])
    rows = -(-len(panels) // columns)
    size = (min(columns, len(panels)) * (width + 6) - 6, rows * (height + 22) - 4)
    sheet = Image.new("RGB", size, "white")
    for k, (title, picture) in enumerate(panels.items()):
        left, top = k % columns * (width + 6), k // columns * (height + 22)
        ImageDraw.Draw(sheet).text((left + 2, top + 2), title, "black", font_size=13)
        sheet.paste(Image.fromarray(picture).resize((width, height), Image.Resampling.NEAREST), (left, top + 18))
    sheet.quantize(64).save(target, optimize=True)
    print("written:", target)
