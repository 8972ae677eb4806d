"""Truth beside the events: depth, flow and objects of each pixel, in one file with the events.

Any program that reads HDF5 reads it. The layouts of DSEC, MVSEC and others are written in the same way: name an output
run.dsec or run.mvsec.
"""

import tempfile
from pathlib import Path

import h5py
import numpy as np
from pictures import events_picture, grey_picture, save

import clsim

with tempfile.TemporaryDirectory() as folder:
    out = Path(folder) / "run.h5"
    with clsim.stream(
        "two-boxes", resolution=(173, 130), quality="draft", fps=120.0, frame_count=13, frame_rate=30.0,
        truth=("depth", "flow", "ids"), outputs=str(out),
    ) as run:  # fmt: skip
        events = np.concatenate([batch.copy() for batch in run])
    with h5py.File(out) as file:
        times_us = file["frames/t"][:]
        depth_m, flow_px, objects = (file[f"frames/{name}"][1] for name in ("depth", "flow", "object"))
        names = [name.decode() for name in file["objects/name"][:]]

print("frames of truth at", times_us, "µs; objects:", ", ".join(name for name in names if name))
print(f"depth from {depth_m.min():.2f} m; flow up to {np.hypot(*np.moveaxis(flow_px, -1, 0)).max():.1f} pixels")

near = events[abs(events["t"] - times_us[1]) < 8_000]
panels = {
    "events about a frame of truth": events_picture(near, 173, 130),
    "depth": grey_picture(np.where(np.isfinite(depth_m), depth_m, np.nan), high=8.0),
    "length of the flow": grey_picture(np.hypot(*np.moveaxis(flow_px, -1, 0))),
    "objects": grey_picture(objects.astype(float)),
}
save(panels, "truth_beside_events.png")
