"""OpenCL devices: which there are, which one is used, and how wide its kernels are built."""

from __future__ import annotations

import contextlib
import warnings
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

from clsim.caches import prepare_caches
from clsim.errors import InputError, Notice
from clsim.forks import check_process, open_here
from clsim.opencl.trial import POCL, fault_of, told_name

_PACKAGES = "apt-get install pocl-opencl-icd or conda install -c conda-forge pocl"
INSTALL = f"install PoCL, as by {_PACKAGES}, or the GPU's own driver"
"""What to do where there is no device."""

CPU_WIDTHS = (4, 8, 16)
"""Vector widths that OpenCL C knows and that CPUs have registers for, in float32."""


@dataclass(frozen=True)
class Device:
    """An OpenCL device with its context.

    Attributes:
        name: device and platform, as listed.
        is_cpu: whether it shares this process's memory and wants few large work-items.
        lanes: float32 pixels that one work-item handles side by side (1 on a GPU).
        context: the ``pyopencl.Context``.
    """

    name: str
    is_cpu: bool
    lanes: int
    context: Any

    def queue(self) -> Any:
        """Return a new in-order command queue; raises clsim.Error in a forked child."""
        import pyopencl as cl

        check_process()
        return cl.CommandQueue(self.context)


@dataclass(frozen=True)
class Found:
    """What is known of a device without opening it.

    Attributes:
        name: as `choose_device` takes it, or a part of it.
        fault: why it cannot be used; None if it can.
        advice: what to do then; None if it can be used.
        told: the processor that PoCL builds for, since it does not know the one there is; None if it knows.
    """

    name: str
    fault: str | None
    advice: str | None
    told: str | None


def find_devices() -> list[Found]:
    """Return all OpenCL devices, those first that are chosen first.

    Each is tried when it is seen for the first time, with this driver on this processor.

    Raises:
        InputError: OpenCL cannot be loaded.
        clsim.Error: this process was forked from one in which devices were opened.
    """
    found = []
    for device in _devices():
        fault = fault_of(device)
        found.append(Found(_name(device), fault, None if fault is None else _advice(device), told_name(device)))
    return found


def choose_device(name: str | None = None) -> Device:
    """Return the device whose name contains ``name`` (any case); by default a GPU if there is one, else PoCL.

    What cannot build kernels is passed over; by default with a warning.

    Raises:
        InputError: there is no OpenCL device, none of that name, or none of these works.
        clsim.Error: this process was forked from one in which devices were opened.
    """
    devices = _devices()
    if not devices:
        raise InputError(f"no OpenCL device was found; {INSTALL}")
    wanted = [device for device in devices if name is None or name.lower() in _name(device).lower()]
    if not wanted:
        known = "; ".join(_name(device) for device in devices)
        raise InputError(f"no OpenCL device is named {name!r}; expected part of one of: {known}")
    faults: list[str] = []
    for device in wanted:
        fault = fault_of(device)
        if fault is None:
            _say_passed_over(tuple(faults) if name is None else ())
            return _open(device)
        faults.append(f"{_name(device)}: {fault}; {_advice(device)}")
    raise InputError(f"no OpenCL device {'works' if name is None else f'named {name!r} works'}: {'. '.join(faults)}")


@cache
def _say_passed_over(faults: tuple[str, ...]) -> None:
    for fault in faults:
        warnings.warn(f"passed over an OpenCL device, {fault}", Notice, stacklevel=3)


def _devices() -> list[Any]:
    """Return all devices, those first that are chosen first."""
    open_here()
    prepare_caches()
    try:
        import pyopencl as cl
    except ImportError as error:
        raise InputError(f"OpenCL cannot be loaded ({error}); {INSTALL}") from None
    devices: list[Any] = []
    try:
        platforms = cl.get_platforms()
    except cl.Error:  # the loader finds no platform at all
        return []
    for platform in platforms:
        with contextlib.suppress(cl.Error):  # a driver without a device
            devices += platform.get_devices()
    return sorted(devices, key=_preference)


def _name(device: Any) -> str:
    return f"{device.name.strip()} ({device.platform.name.strip()}, {device.version.strip()})"


def _preference(device: Any) -> int:
    import pyopencl as cl

    if device.type & cl.device_type.GPU:
        return 0
    return 1 if POCL in device.platform.name else 2


def _advice(device: Any) -> str:
    import pyopencl as cl

    if device.type & cl.device_type.CPU:
        return f"install another PoCL, as by {_PACKAGES}"
    return "install the driver of its maker"


@lru_cache(maxsize=8)
def _open(device: Any) -> Device:
    import pyopencl as cl

    is_cpu = bool(device.type & cl.device_type.CPU)
    native = device.native_vector_width_float
    lanes = (native if native in CPU_WIDTHS else 8) if is_cpu else 1
    return Device(_name(device), is_cpu, lanes, cl.Context([device]))
