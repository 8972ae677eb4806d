"""Warp start-up and the devices it renders on."""

from __future__ import annotations

import os
import sys
import tempfile
import threading
from typing import Any, Literal

import warp as wp

from clsim.caches import prepare_caches
from clsim.errors import InputError
from clsim.forks import open_here
from clsim.render.device.compiler import keep_headers

_NO_DRIVER = b"Could not find or load the NVIDIA CUDA driver"
_init_warp: Any = wp.init
_started = False
_lock = threading.Lock()


def start_warp() -> None:
    """Initialise Warp once, without its banner and without its complaint that there is no GPU.

    That complaint is printed by native code straight to file descriptor 2, so the descriptor is diverted while Warp
    starts; whatever else was written meanwhile is passed on.

    Raises:
        InputError: kernels can be kept nowhere.
        clsim.Error: this process was forked from one in which devices were opened.
    """
    global _started
    open_here()
    with _lock:
        if _started:
            return
        prepare_caches()
        wp.config.log_level = wp.LOG_ERROR
        sys.stderr.flush()
        try:
            terminal = os.dup(2)
        except OSError:  # the process has no standard error at all
            _init_warp()
            keep_headers()
            _started = True
            return
        with tempfile.TemporaryFile() as diverted:
            os.dup2(diverted.fileno(), 2)
            try:
                _init_warp()
            finally:
                os.dup2(terminal, 2)
                os.close(terminal)
                diverted.seek(0)
                for line in diverted:
                    if _NO_DRIVER not in line:
                        os.write(2, line)
        keep_headers()
        _started = True


def list_render_devices() -> list[str]:
    """Return the names of the devices there are, "cpu" first, then "cuda:0" and so on."""
    start_warp()
    return [str(device.alias) for device in wp.get_devices()]


def check_device(name: str) -> None:
    """Raise InputError unless there is a render device of that name."""
    known = list_render_devices()
    if name not in known:
        raise InputError(f"`render_device` {name}: no such render device, expected one of {', '.join(known)}")


def usable_cores() -> int:
    """Return how many processor cores this process may use; all of them where the system does not tell."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def fastest_tree(device: str) -> Literal["bvh16", "warp"]:
    """Return how rays find triangles fastest on a device: our 16-wide tree on a CPU, Warp's own on a GPU."""
    return "bvh16" if device == "cpu" else "warp"
