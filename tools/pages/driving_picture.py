"""The picture of docs/robots.md: MuJoCo's pendulum before a DAVIS346, frames above, events of 4 ms below.

python tools/pages/driving_picture.py docs/images/driving.png
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import mujoco
import numpy as np
import numpy.typing as npt
from PIL import Image

import clsim
from clsim.bridges.mujoco import MujocoScene
from clsim.frames.tonemap import ToneMap

PAGE = Path(__file__).parents[2] / "docs" / "robots.md"
SIZE = (346, 260)
SHOWN_US = (100_000, 300_000, 500_000, 700_000)
GAP = 6


def picture(events: npt.NDArray[np.void]) -> npt.NDArray[np.uint8]:
    """Return ON events in blue and OFF events in red on white, ``[H, W, 3]``."""
    out = np.full((SIZE[1], SIZE[0], 3), 255, np.uint8)
    out[events["y"], events["x"]] = np.where(events["on"][:, None], (30, 90, 200), (200, 50, 40))
    return out


def main(target: str) -> None:
    found = re.search(r'PENDULUM = """(.*?)"""', PAGE.read_text(), re.DOTALL)
    assert found is not None, "the page has the model"
    model = mujoco.MjModel.from_xml_string(found[1])
    data = mujoco.MjData(model)
    data.joint("hinge").qpos, data.joint("hinge").qvel = 1.0, -3.0
    scene = MujocoScene(model, data, camera="eye", resolution=SIZE)
    columns, tone = [], ToneMap(0.0)
    with clsim.Simulator(scene.world, clock="caller", quality="balanced", sensor="davis346") as simulator:
        scene.follow(simulator)
        simulator.step(0)
        while scene.time_us < SHOWN_US[-1]:
            for _ in range(4):
                mujoco.mj_step(model, data)
                scene.follow(simulator)
            events = simulator.step(scene.time_us)
            if scene.time_us in SHOWN_US:
                rendered = tone(np.moveaxis(simulator.frame().planes[:3], 0, 2))
                between = np.full((GAP, SIZE[0], 3), 255, np.uint8)
                columns.append(np.concatenate([rendered, between, picture(events)]))
    between = np.full((columns[0].shape[0], GAP, 3), 255, np.uint8)
    row = np.concatenate([part for column in columns for part in (column, between)][:-1], axis=1)
    Image.fromarray(row).save(target, optimize=True)


if __name__ == "__main__":
    main(sys.argv[1])
