"""A bound on what a USD file may take to open.

A few hundred bytes can unfold to more prims than any memory holds: each refers twice to the next, or inherits from many
in long chains. usd-core has no bound of its own and cannot be stopped, so a file that refers to anything is opened
first by a process of its own, within limits of time and memory.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Sdf, Tf

from clsim.errors import InputError

CPU_S = 60
"""Processor time that opening may take: some two million prims."""
MAX_BYTES = 8 << 30
MAX_NESTING = 1000
"""Levels of braces in a file of text; usd-core's parser crashes at some tens of thousands."""
_CHUNK = 1 << 24
_ARCS = {"references", "payload", "inheritPaths", "specializes"}


def check_bounds(path: Path) -> Any:
    """Return the layer of a file, which usd-core need not read again while it is kept; None where it cannot be read.

    Raises:
        InputError: it is nested too deep, or takes too much to open.
    """
    if _nesting(path) > MAX_NESTING:
        raise InputError(f"{path}: is nested more than {MAX_NESTING} levels deep")
    try:
        layer = Sdf.Layer.FindOrOpen(str(path))
    except Tf.ErrorException:
        return None  # it says why when the file is opened as a stage
    if _refers(layer) and not _opens(path):
        raise InputError(
            f"{path}: usd-core cannot open it within {CPU_S} s of processor time and {MAX_BYTES / 2**30:g} GiB: "
            "what it refers to may unfold without end"
        )
    return layer


def _nesting(path: Path) -> int:
    """Return how deep braces stand in each other in a file of text."""
    depth = most = 0
    with path.open("rb") as file:
        chunk = file.read(_CHUNK)
        while chunk and (most or chunk.startswith(b"#usda")):
            text = np.frombuffer(chunk, np.uint8)
            steps = np.cumsum((text == ord("{")).astype(np.int32) - (text == ord("}")))
            most = max(most, 1, depth + int(steps.max()))
            depth += int(steps[-1])
            chunk = file.read(_CHUNK)
    return most


def _refers(layer: Any) -> bool:
    """Whether a layer brings along others, or a prim of it what stands elsewhere."""
    found = bool(len(layer.subLayerPaths))

    def look(path: Any) -> None:
        nonlocal found
        if not found and (path.IsPrimPath() or path.IsPrimVariantSelectionPath()):
            found = not _ARCS.isdisjoint(layer.GetObjectAtPath(path).ListInfoKeys())

    layer.Traverse(Sdf.Path.absoluteRootPath, look)
    return found


def _opens(path: Path) -> bool:
    """Whether a process of its own opens a file within the limits."""
    script = Path(__file__).with_name("usd_trial.py")
    words = [sys.executable, "-I", str(script), str(path), json.dumps(sys.path), str(CPU_S), str(MAX_BYTES)]
    return subprocess.run(words, stdin=subprocess.DEVNULL, capture_output=True, check=False).returncode == 0
