"""How far truth is from float64 by brute force: the table of docs/truth-figures.md.

python tools/accuracy/truth_errors.py
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.render.truth import test_truth
from tests.render.truth import truth_reference as reference

_SIZE = 346, 260


def main() -> None:
    """Render the world of the tests at the size of a davis346, and print median, 99th percentile and largest error."""
    world = test_truth.a_world()
    world = replace(world, camera=replace(world.camera, width=_SIZE[0], height=_SIZE[1]))
    found = test_truth.filled(world)
    expected = reference.truth(world, world.camera, test_truth.T0_US * 1e-6, test_truth.T1_US * 1e-6)
    same = found["Id.object"] == expected["owner"]
    hit = same & (expected["owner"] > 0)
    flow = test_truth.vectors(found, "Flow.forward.X", "Flow.forward.Y")
    normal = test_truth.vectors(found, "Truth.Nx", "Truth.Ny", "Truth.Nz")
    albedo = test_truth.vectors(found, "Truth.Albedo.R", "Truth.Albedo.G", "Truth.Albedo.B")
    errors = {
        "depth, share of it": np.abs(found["Z"][hit] / expected["depth"][hit] - 1),
        "distance, share of it": np.abs(found["Truth.Depth"][hit] / expected["distance"][hit] - 1),
        "normal, difference of unit vectors": np.linalg.norm(normal - expected["normal"], axis=-1)[hit],
        "albedo": np.abs(albedo - expected["albedo"]).max(axis=-1)[same],
        "flow [px]": np.linalg.norm(flow - expected["flow"], axis=-1)[same],
    }
    print("| plane | median | 99th percentile | largest |\n|---|---|---|---|")
    for name, values in errors.items():
        print(f"| {name} | {np.median(values):.1e} | {np.percentile(values, 99):.1e} | {values.max():.1e} |")
    lengths = np.linalg.norm(expected["flow"], axis=-1)
    print(f"objects: {100 * (1 - same.mean()):.3f} % of pixels differ; median flow {np.median(lengths):.1f} px")
    covisible = found["Flow.forward.covisible"] > 0
    should = expected["inside"] & (expected["margin"] < 1e-4)
    print(f"covisible: {100 * (covisible != should)[same].mean():.3f} % of pixels differ")


if __name__ == "__main__":
    main()
