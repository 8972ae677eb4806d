"""The general case: rooms whose camera moves, then a crate too, then a lamp too, against references of many paths.

python -m tools.accuracy.general_rooms write FOLDER living-room=ROOM/scene.xml staircase=STAIRS/scene.xml
python -m tools.accuracy.general_rooms reference FOLDER --spp 1024       # minutes each; --seed 12 makes the second ones
python -m tools.accuracy.general_rooms runs FOLDER                # --name and --source: of another version
python -m tools.accuracy.general_rooms table FOLDER

``write`` makes three scene files of each room, such as ``living-room-thing.toml``; ``clsim live`` and
``clsim bench tradeoff`` take them too. What was run is kept in the folder, and not run again.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

KINDS = {"camera": "the camera", "thing": "and a crate", "lamp": "and a lamp"}
FRAMES, LONGER = 12, 24
SEEDS = (0, 1, 2)
REFERENCE_SEEDS = (11, 12)
_SIDE_M, _SPEED_M_S, _LASTS_S = 0.6, 1.0, 2.0
_AHEAD_M = 2.5
_BULB_M = 0.1
_AS_BRIGHT_AT_M = 1.5
"""Where the lamp gives a surface as much light as it has on the median in the room itself."""


def write(room: str, name: str, folder: Path) -> None:
    """Write the three scene files of a room."""
    import clsim

    world = clsim.load_scene(room, resolution=(64, 48))
    pose = world.camera.motion.pose(0.0)
    with clsim.Simulator(world, fps=120.0, quality="draft", time="fixed") as simulator:
        simulator.step(1_000)
        frame = simulator.frame()
        radiance = np.stack([frame.plane(plane) for plane in "RGB"], axis=-1)
    median = float(np.median(radiance @ (0.2126, 0.7152, 0.0722)))
    shines = 2 * median * (_AS_BRIGHT_AT_M / _BULB_M) ** 2
    right, up, ahead, eye = pose[:3, 0], pose[:3, 1], -pose[:3, 2], pose[:3, 3]
    base = f'base = "{Path(room).resolve()}"\nfps = 120\n'
    crate = eye + _AHEAD_M * ahead - 0.2 * up - 0.25 * right
    thing = (
        '\n[materials.crate]\ncolor = [0.55, 0.4, 0.25]\n\n[[objects]]\nname = "crate"\nshape = "box"\n'
        f'size = [{_SIDE_M}, {_SIDE_M}, {_SIDE_M}]\nmaterial = "crate"\n{_crossing(crate, right)}'
    )
    bulb = eye + 2.0 * ahead + 0.6 * up + 0.4 * right
    lamp = (
        f'\n[[sphere_lights]]\nname = "bulb"\nradius_m = {_BULB_M}\n'
        f"radiance = [{shines:.4g}, {shines:.4g}, {shines:.4g}]\n{_crossing(bulb, -right)}"
    )
    for kind, added in (("camera", ""), ("thing", thing), ("lamp", thing + lamp)):
        (folder / f"{name}-{kind}.toml").write_text(base + added, encoding="utf-8")


def _crossing(begin: npt.NDArray[np.float64], along: npt.NDArray[np.float64]) -> str:
    keys = ((0.0, begin), (_LASTS_S, begin + _SPEED_M_S * _LASTS_S * along))
    lines = (f"  {{ time_s = {time_s}, position = {place.round(4).tolist()} }},\n" for time_s, place in keys)
    return f"keyframes = [\n{''.join(lines)}]\n"


def live(scene: Path, out: Path, quality: str, seed: int, frames: int, given: argparse.Namespace) -> dict[str, Any]:
    """Record one run, unless it was, and return what it tells of itself."""
    told = out.with_suffix(".told")
    if not told.exists():
        command = [given.python, "-m", "clsim", "live", scene, "--resolution", "64x48", "--fps", "120", "--json"]
        command += ["--frame-count", frames, "--seed", seed, "--quality", quality, "--threads", 1, "--out", out]
        command += ["--spp", given.spp] if quality == "exact" else []
        done = subprocess.run(
            [str(each) for each in command],
            env=os.environ | {"PYTHONPATH": given.source},
            cwd=given.source,
            capture_output=True,
            check=True,
        )
        told.write_bytes(done.stdout)
    figures: dict[str, Any] = json.loads(told.read_text())
    return figures


def measure(given: argparse.Namespace) -> None:
    """Make what is missing: references, then runs of each seed, and a longer one that tells what a frame costs."""
    for scene in scenes(given.folder):
        if given.what == "reference":
            live(scene, scene.with_suffix(f".ref{given.seed}.npz"), "exact", given.seed, FRAMES, given)
        else:
            for seed in given.seeds:
                live(scene, scene.with_suffix(f".{given.name}{seed}.npz"), "balanced", seed, FRAMES, given)
            live(scene, scene.with_suffix(f".{given.name}-longer.npz"), "balanced", given.seeds[0], LONGER, given)


def scenes(folder: Path) -> Iterator[Path]:
    """Yield the scene files, room by room."""
    for first in sorted(folder.glob("*-camera.toml")):
        room = first.stem.removesuffix("-camera")
        yield from (folder / f"{room}-{kind}.toml" for kind in KINDS)


def table(folder: Path, name: str) -> None:
    """Print a row of each scene that has a reference and runs."""
    print("| room | what moves | events, true | F1 | two references | CPU ms | light | told | seeds |")
    print("|---|---|---:|---:|---:|---:|---:|---:|---:|")
    for scene in scenes(folder):
        files = sorted(folder.glob(f"{scene.stem}.{name}[0-9].npz"))
        references = [file for seed in REFERENCE_SEEDS if (file := scene.with_suffix(f".ref{seed}.npz")).exists()]
        if files and references:
            print(row(scene, name, files, references), flush=True)


def row(scene: Path, name: str, files: list[Path], references: list[Path]) -> str:
    """Return what a scene's runs are like, as a row of Markdown."""
    room, _, kind = scene.stem.rpartition("-")
    runs, true = [events(file) for file in files], [events(file) for file in references]
    told = [json.loads(file.with_suffix(".told").read_text()) for file in files]
    longer = json.loads(scene.with_suffix(f".{name}-longer.told").read_text())
    spent, light = (longer[key] - told[0][key] for key in ("cpu_s", "light_s"))
    between = [1 - within(a, b).precision for a, b in itertools.permutations(runs, 2)]
    shares = [each["noise_share"] for each in told if each["noise_share"] is not None]
    cells = [
        f"{np.mean([len(run) for run in runs]):,.0f}, {len(true[0]):,}",
        f"{np.mean([within(run, each).f1 for run in runs for each in true]):.2f}",
        f"{within(*true).f1:.2f}" if len(true) > 1 else "",
        f"{1e3 * spent / (LONGER - FRAMES):.0f}",
        f"{light / spent:.2f}",
        f"{np.mean(shares):.2f}" if shares else "",
        f"{np.mean(between):.2f}" if between else "",
    ]
    return f"| {room} | {KINDS[kind]} | {' | '.join(cells)} |"


def events(file: Path) -> Any:
    """Return all events of a file."""
    from clsim.events.batch import gather
    from clsim.events.files import open_source

    return gather(open_source(str(file)))


def within(a: Any, b: Any) -> Any:
    """Score events against others: one partner each at the same pixel, 25 ms apart at most."""
    from clsim.score import score

    return score(a, b, 64, 48, 120.0, within_us=(25_000,)).within[25_000]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("write", "reference", "runs", "table"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("rooms", nargs="*", help="NAME=FILE")
    parser.add_argument("--spp", type=int, default=1024, help="light paths a pixel of the reference")
    parser.add_argument("--seed", type=int, default=REFERENCE_SEEDS[0], help="of the reference")
    parser.add_argument("--seeds", type=lambda text: [int(each) for each in text.split(",")], default=SEEDS)
    parser.add_argument("--name", default="now", help="of the version that runs")
    parser.add_argument("--python", default=sys.executable)
    parser.add_argument("--source", default=str(Path(__file__).parents[2]))
    arguments = parser.parse_args()
    if arguments.what == "write":
        for pair in arguments.rooms:
            name, _, room = pair.partition("=")
            write(room, name, arguments.folder)
    elif arguments.what == "table":
        table(arguments.folder, arguments.name)
    else:
        measure(arguments)
