"""A data set of two random sequences, and what a network is fed: voxel grids of events, with flow as the label.

It needs Dask: pip install 'clsim[cluster]'. The batches are tensors where PyTorch is installed, and else numpy arrays.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from pictures import grey_picture, save

from clsim.datasets.load import Slices

SPECIFICATION = """
count = 2
[run]
duration_s = 0.1
fps = 240
resolution = [96, 72]
quality = "draft"
truth = ["flow"]
frame_rate = 40
[scene]
base = "two-boxes"
[scene.camera]
wander = { seed = { integers = [0, 1000000] }, duration_s = 0.5, reach_m = [0.4, 0.3, 0.3] }
[write]
layout = "h5"
"""

with tempfile.TemporaryDirectory() as folder:
    specification, out = Path(folder) / "small.toml", Path(folder) / "small"
    specification.write_text(SPECIFICATION)
    subprocess.run([sys.executable, "-m", "clsim", "dataset", specification, "--out", out], check=True)
    slices = Slices(out, truth=("flow", "flow_valid"), bins=5, shuffle_seed=1)
    try:
        from torch.utils.data import DataLoader

        from clsim.datasets.pytorch import TorchSlices

        batch = {name: value.numpy() for name, value in next(iter(DataLoader(TorchSlices(slices), 4))).items()
                 if name in ("voxels", "flow")}  # fmt: skip
    except ImportError:
        parts = [part for part, _ in zip(slices, range(4), strict=False)]
        batch = {name: np.stack([part[name] for part in parts]) for name in ("voxels", "flow")}

print("voxels", batch["voxels"].shape, "flow", batch["flow"].shape)
voxels, flow = batch["voxels"][0], batch["flow"][0]
panels = {f"voxels, bin {k}": grey_picture(voxels[k], -2, 2) for k in range(5)}
save(panels | {"length of the flow": grey_picture(np.hypot(*np.moveaxis(flow, -1, 0)))}, "voxel_grids.png", columns=3)
