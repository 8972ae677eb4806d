"""A bound on what a USD file may take to open.

A few hundred bytes can unfold to more prims than any memory holds: each refers twice to the next, or inherits from many
in long chains. Text that is nested very deep makes usd-core's parser crash. usd-core has no bound of its own and cannot
be stopped, so files that may do so are opened first by a process of its own, within limits of time and memory. So are
those that refer to others: one that is a pipe is waited for without end.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from pxr import Sdf, Tf

from clsim.errors import InputError

CPU_S = 60
"""Processor time that opening may take: some two million prims."""
WALL_S = 600
"""Time that opening may take in all: ten times that of the processor, for others may use it too."""
MAX_BYTES = 8 << 30
SMALL_BYTES = 1 << 14
"""Text no longer than that cannot be nested deep enough for a crash; some ten thousand levels are needed."""
_NOT_ORDINARY = 3
"""Exit code of that process where a file is referred to that is no ordinary one."""
_BINARY = b"PXR-USDC"
_ARCS = {"references", "payload", "inheritPaths", "specializes", "clips"}


def check_bounds(path: Path) -> Any:
    """Return the layer of a file, which usd-core need not read again while it is kept; None where it cannot be read.

    Raises:
        InputError: it takes too much to open.
    """
    parsed = _may_be_deep(path)
    if parsed:
        _try_to_open(path)
    try:
        layer = Sdf.Layer.FindOrOpen(str(path))
    except Tf.ErrorException:
        return None  # it says why when the file is opened as a stage
    if not parsed and layer is not None and _refers(layer):
        _try_to_open(path)
    return layer


def _may_be_deep(path: Path) -> bool:
    """Whether a file is long, and text, or a package, which may hold text."""
    with path.open("rb") as file:
        return file.read(len(_BINARY)) != _BINARY and path.stat().st_size > SMALL_BYTES


def _refers(layer: Any) -> bool:
    """Whether a layer brings along others, or a prim of it what stands elsewhere."""
    found = bool(len(layer.subLayerPaths))

    def look(path: Any) -> None:
        nonlocal found
        if not found and (path.IsPrimPath() or path.IsPrimVariantSelectionPath()):
            found = not _ARCS.isdisjoint(layer.GetObjectAtPath(path).ListInfoKeys())

    layer.Traverse(Sdf.Path.absoluteRootPath, look)
    return found


def _try_to_open(path: Path) -> None:
    """Let a process of its own open a file within the limits; an embedded Python has none to start.

    Raises:
        InputError: it did not come to an end, or would not.
    """
    if not sys.executable or getattr(sys, "frozen", False):
        return
    script = Path(__file__).with_name("usd_trial.py")
    folders = json.dumps([folder for folder in sys.path if isinstance(folder, str)])
    words = [sys.executable, "-I", str(script), str(path), folders, str(CPU_S), str(MAX_BYTES), str(_NOT_ORDINARY)]
    nothing = subprocess.DEVNULL
    # Each thread else reserves 64 MiB of addresses, which with a hundred cores are all that there may be.
    env = os.environ | {"MALLOC_ARENA_MAX": "2"}
    try:
        trial = subprocess.run(
            words, stdin=nothing, stdout=subprocess.PIPE, stderr=nothing, env=env, timeout=WALL_S, check=False
        )
    except subprocess.TimeoutExpired:
        raise InputError(f"{path}: usd-core has not opened it after {WALL_S} s: it waits for something") from None
    if trial.returncode == _NOT_ORDINARY:
        raise InputError(f"{path}: refers to {trial.stdout.decode(errors='replace')}, which is no ordinary file")
    if trial.returncode != 0:
        raise InputError(
            f"{path}: usd-core cannot open it within {CPU_S} s of processor time and {MAX_BYTES / 2**30:g} GiB: "
            "what it refers to may unfold without end, or it is nested too deep"
        )
