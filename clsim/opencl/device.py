"""OpenCL devices: which there are, which one is used, and how wide its kernels are built."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from clsim.errors import InputError

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
        """Return a new in-order command queue."""
        import pyopencl as cl

        return cl.CommandQueue(self.context)


def list_devices() -> list[str]:
    """Return the names of all OpenCL devices, as `choose_device` takes them."""
    return [_name(device) for device in _devices()]


def choose_device(name: str | None = None) -> Device:
    """Return the device whose name contains ``name`` (any case); by default a GPU if there is one, else PoCL.

    Raises:
        InputError: there is no OpenCL device, or none of that name.
    """
    devices = _devices()
    if not devices:
        raise InputError("no OpenCL device was found; expected at least PoCL (pip install 'pyopencl[pocl]')")
    if name is not None:
        for device in devices:
            if name.lower() in _name(device).lower():
                return _open(device)
        known = "; ".join(_name(device) for device in devices)
        raise InputError(f"no OpenCL device is named {name!r}; expected part of one of: {known}")
    return _open(min(devices, key=_preference))


def _devices() -> list[Any]:
    import pyopencl as cl

    try:
        return [device for platform in cl.get_platforms() for device in platform.get_devices()]
    except cl.LogicError:  # the loader finds no platform at all
        return []


def _name(device: Any) -> str:
    return f"{device.name.strip()} ({device.platform.name.strip()}, {device.version.strip()})"


def _preference(device: Any) -> int:
    import pyopencl as cl

    if device.type & cl.device_type.GPU:
        return 0
    return 1 if "Portable Computing Language" in device.platform.name else 2


@lru_cache(maxsize=8)
def _open(device: Any) -> Device:
    import pyopencl as cl

    is_cpu = bool(device.type & cl.device_type.CPU)
    native = device.native_vector_width_float
    lanes = (native if native in CPU_WIDTHS else 8) if is_cpu else 1
    return Device(_name(device), is_cpu, lanes, cl.Context([device]))
