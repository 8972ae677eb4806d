"""Mitsuba 3, an optional package, in a variant that renders on this machine."""

from __future__ import annotations

import ctypes.util
import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

from clsim.errors import InputError

LLVM, SCALAR = "llvm_ad_rgb", "scalar_rgb"

_TRIAL = """
import sys
sys.tracebacklimit = 0
import mitsuba, numpy
mitsuba.set_variant(sys.argv[1])
scene = mitsuba.cornell_box()
scene["sensor"]["film"] |= {"width": 8, "height": 8}
numpy.array(mitsuba.render(mitsuba.load_dict(scene), spp=1))
"""
_TRIAL_S = 100.0
"""How long that may take; it takes seconds."""


def load_mitsuba(*variants: str) -> Any:
    """Return the module with the first of these variants set that works here.

    With none named it is LLVM's or nothing, as what is timed must not be the slow one by chance.

    Raises:
        InputError: it is not installed, or none of them works.
    """
    try:
        import mitsuba
    except ImportError:
        raise InputError("Mitsuba 3 is not installed; pip install 'clsim[oracle]'") from None
    _choose_llvm()
    faults = []
    for variant in variants or (LLVM,):
        if not (fault := variant_fault(variant)):
            mitsuba.set_variant(variant)
            return mitsuba
        faults.append(f"{variant} {fault}")
    raise InputError(f"Mitsuba 3 does not render here: {'; '.join(faults)}")


@cache
def variant_fault(variant: str) -> str:
    """Return what happens to a program that renders a small scene with the variant, empty if it does well.

    It is a program of its own, because LLVM ends the whole process where it cannot compile what Mitsuba asks for. LLVM
    15 and 16 cannot, and show it only with kernels as large as those of rendering.
    """
    command = [sys.executable, "-c", _TRIAL, variant]
    try:
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=_TRIAL_S)
    except subprocess.TimeoutExpired:
        return f"took more than {_TRIAL_S:g} s"
    if done.returncode == 0:
        return ""
    # The first line names the cause; what follows are LLVM's graphs, or consequences.
    said = next(iter(done.stderr.strip().splitlines()), "nothing")
    return f"ended with status {done.returncode} and said: {said}"


def _choose_llvm() -> None:
    """Name the newest LLVM library to Mitsuba, unless the user has named one."""
    if "DRJIT_LIBLLVM_PATH" in os.environ:
        return
    libraries = sorted(Path("/usr/lib").glob("*/libLLVM-*.so"), key=lambda path: float(path.stem.split("-")[-1]))
    found = str(libraries[-1]) if libraries else ctypes.util.find_library("LLVM")
    if found is not None:
        os.environ["DRJIT_LIBLLVM_PATH"] = found
