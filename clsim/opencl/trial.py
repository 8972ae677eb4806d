"""Whether a device builds kernels: tried once with a small one, and remembered."""

from __future__ import annotations

import contextlib
import hashlib
import os
import platform
import re
import signal
import subprocess
import sys
import warnings
from collections.abc import Sequence
from functools import cache
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np

from clsim.caches import cache_folder
from clsim.opencl.processor import name_processor
from clsim.version import VERSION

POCL = "Portable Computing Language"
_KERNEL = "kernel void trial(global float16 *x) { x[0] = exp(x[0]); }"
"""Hands a vector to the driver's own library."""
_TOLERANCE = 1e-5
_LONGEST_S = 120.0
_TELLING = re.compile(r"^.*\b(?:error|undefined|unknown|fatal)\b.*$", re.IGNORECASE | re.MULTILINE)
_ABOUT = ("cpu family", "model", "model name", "stepping", "flags", "CPU implementer", "CPU part", "Features")


@cache
def told_name(device: Any) -> str | None:
    """Return what processor PoCL was told to build for; None if it knew, or is not PoCL."""
    if POCL not in device.platform.name:
        return None
    return name_processor(device, set(_processor().get("flags", "").split()))


@cache
def fault_of(device: Any) -> str | None:
    """Return why a device (``pyopencl.Device``) cannot be used; None if it can.

    PoCL that does not know its processor is told what it is first.
    """
    told = told_name(device)
    note = cache_folder() / "opencl" / f"{_key(device, told)}.works"
    if note.is_file():
        return None
    fault = _try_outside(device, told)
    if fault is None:
        with contextlib.suppress(OSError):  # then it is tried again next time
            note.parent.mkdir(exist_ok=True)
            note.touch()
    return fault


def _try_outside(device: Any, told: str | None) -> str | None:
    """Try a device in a program of its own: where the driver crashes, that ends, and not the user's."""
    import pyopencl as cl

    places = [(p, d) for p, each in enumerate(cl.get_platforms()) for d, one in enumerate(_of(each)) if one == device]
    if not places or not sys.executable or getattr(sys, "frozen", False):
        return _try(device)
    command = [sys.executable, "-m", __name__, *map(str, places[0]), *([told] if told else [])]
    about = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    try:
        ended = subprocess.run(command, env=about, capture_output=True, text=True, timeout=_LONGEST_S)
    except subprocess.TimeoutExpired:
        return f"it does not build a small kernel in {_LONGEST_S:.0f} s"
    except OSError:  # no program can be started
        return _try(device)
    if ended.returncode < 0:
        with contextlib.suppress(ValueError):
            return f"it crashes where it builds a small kernel ({signal.Signals(-ended.returncode).name})"
    return _try(device) if ended.returncode else ended.stdout.strip() or None


def _of(driver: Any) -> list[Any]:
    import pyopencl as cl

    try:
        return list(driver.get_devices())
    except cl.Error:
        return []


def _main() -> None:
    """Try one device, ``python -m clsim.opencl.trial PLATFORM DEVICE [NAME]``, and print what is wrong with it."""
    import pyopencl as cl

    number, place, *told = sys.argv[1:]
    device = _of(cl.get_platforms()[int(number)])[int(place)]
    if told:
        told_name(device)
    print(_try(device) or "", flush=True)
    os._exit(0)  # what drivers do at the end is not asked for


def _try(device: Any) -> str | None:
    """Build a kernel, run it, and look at what it computes."""
    import pyopencl as cl

    before = np.linspace(-4.0, 4.0, 16, dtype=np.float32)
    after = np.zeros_like(before)
    try:
        context = cl.Context([device])
        queue = cl.CommandQueue(context)
        flags = cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR
        memory = cl.Buffer(context, flags, hostbuf=before)
        program = built(context, _KERNEL)
        cl.Kernel(program, "trial")(queue, (1,), (1,), memory)
        cl.enqueue_copy(queue, after, memory)
    except cl.Error as error:
        return f"it builds no kernel ({reason_in(error)})"
    if not np.allclose(after, np.exp(before.astype(np.float64)), rtol=_TOLERANCE):
        return "it computes something wrong"
    return None


def built(context: Any, text: str, options: Sequence[str] = ()) -> Any:
    """Return a program of this text; compilers that have something to say, and no error, say it to nobody."""
    import pyopencl as cl

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cl.CompilerWarning)
        # -w: PoCL's warns of how vectors are passed between functions, and prints it over the user's terminal.
        return cl.Program(context, text).build(options=["-w", *options])


def reason_in(error: Exception) -> str:
    """Return the line of an OpenCL error that tells most."""
    text = str(error).strip()
    found = _TELLING.search(text)
    return (found[0] if found else text.partition("\n")[0]).strip()


def _key(device: Any, told: str | None) -> str:
    """Return a name for what a trial tells of: a device, its driver, and the processor."""
    driver = device.platform
    facts = (VERSION, device.name, device.version, device.driver_version, driver.name, driver.version, told)
    return hashlib.sha256(repr((facts, platform.machine(), sorted(_processor().items()))).encode()).hexdigest()[:16]


@cache
def _processor() -> dict[str, str]:
    """Return what Linux tells of the first processor; nothing elsewhere."""
    try:
        with Path("/proc/cpuinfo").open(encoding="utf-8", errors="replace") as lines:
            rows = [line.partition(":") for line in takewhile(str.strip, lines)]
    except OSError:
        return {}
    return {name.strip(): value.strip() for name, _, value in rows if name.strip() in _ABOUT}


if __name__ == "__main__":
    _main()
