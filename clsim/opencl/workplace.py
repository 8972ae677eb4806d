"""Builds the kernels in ``clsim.kernels`` for one choice of options, and keeps what they work on."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any, Generic, TypeVar

import numpy as np
import numpy.typing as npt

from clsim.errors import Error
from clsim.forks import check_process
from clsim.opencl.device import Device
from clsim.opencl.trial import built, reason_in

_NAME, _COMMENT = re.compile(r"\w+"), re.compile(r"//.*")
_INCLUDE = re.compile(r'^#include "(.+)".*$', re.MULTILINE)


@dataclass(frozen=True)
class Grid:
    """The pixels of an image as kernels see them (types.clh).

    Attributes:
        width: pixels along x.
        height: pixels along y.
        lanes: pixels that a work-item handles side by side.
        real: float32 or float64.
    """

    width: int
    height: int
    lanes: int
    real: npt.DTypeLike

    @property
    def span(self) -> int:
        """Columns of an image, a multiple of ``lanes``."""
        return -(-self.width // self.lanes) * self.lanes

    @property
    def image_shape(self) -> tuple[int, int]:
        """Shape of an image of one plane."""
        return (self.height, self.span)

    @property
    def vectors(self) -> tuple[int, int]:
        """Global size of kernels whose work-item is ``lanes`` neighbours."""
        return (self.span // self.lanes, self.height)


GridT = TypeVar("GridT", bound=Grid, covariant=True)


@dataclass(frozen=True, eq=False)
class Buffer:
    """Device memory and the shape of what it holds.

    Attributes:
        host: where the host sees it (`Workplace.seen`): the same memory, if the device is the host; None where it was
            not asked for.
    """

    memory: Any
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    host: npt.NDArray[Any] | None = None


class Workplace(Generic[GridT]):
    """A device with a queue, a grid of pixels, and the macros that every kernel there is built with."""

    def __init__(self, device: Device, layout: GridT, queue: Any, macros: Mapping[str, object] | None = None) -> None:
        """Keep the options; nothing is compiled before `kernels` is called.

        Those who hand buffers to each other share an in-order ``queue``, of `Device.queue`.
        """
        self.device = device
        self.layout = layout
        self._queue = queue
        self.real = np.dtype(layout.real)
        self._twins: dict[Any, list[tuple[Any, tuple[Any, ...], list[Any]]]] = {}
        """Copies of kernels, with the arguments that they have, as they were given and as OpenCL takes them."""
        self._options: dict[str, object] = {"VW": layout.lanes, **(macros or {})}
        if self.real == np.float64:
            self._options["DOUBLE"] = 1

    @property
    def queue(self) -> Any:
        """The queue of what runs here; raises clsim.Error in a forked child, where it would never run."""
        check_process()
        return self._queue

    def kernels(
        self, file: str, names: tuple[str, ...], macros: Mapping[str, object] | None = None, generated: str = ""
    ) -> list[Any]:
        """Build ``file``.cl, with ``generated`` where it includes that, and return its kernels of these names.

        Macros that the text does not name are left out: OpenCL caches programs by text and options.
        """
        import pyopencl as cl

        text = _text(file, generated)
        named = set(_NAME.findall(_COMMENT.sub("", text)))
        options = {key: value for key, value in {**self._options, **(macros or {})}.items() if key in named}
        program = _build(self.device.context, text, tuple(sorted(options.items())))
        return [cl.Kernel(program, name) for name in names]

    def allocate(self, shape: tuple[int, ...], dtype: npt.DTypeLike | None = None, fill: float = 0) -> Buffer:
        """Return device memory filled with one value; an empty shape still gets a byte, which OpenCL wants."""
        import pyopencl as cl

        kind = np.dtype(self.real if dtype is None else dtype)
        size = max(int(np.prod(shape, dtype=np.int64)) * kind.itemsize, kind.itemsize)
        memory = cl.Buffer(self.device.context, cl.mem_flags.READ_WRITE, size)
        cl.enqueue_fill_buffer(self.queue, memory, np.array(fill, dtype=kind), 0, size)
        return Buffer(memory, shape, kind)

    def allocate_seen(self, shape: tuple[int, ...], dtype: npt.DTypeLike) -> Buffer:
        """Return device memory, whose contents are undefined, for `seen`."""
        import pyopencl as cl

        kind = np.dtype(dtype)
        size = max(int(np.prod(shape, dtype=np.int64)) * kind.itemsize, kind.itemsize)
        flags = cl.mem_flags.READ_WRITE | (cl.mem_flags.ALLOC_HOST_PTR if self.device.is_cpu else 0)
        memory = cl.Buffer(self.device.context, flags, size)
        if not self.device.is_cpu:
            return Buffer(memory, shape, kind, np.empty(shape, kind))
        # Mapped once and for all: to copy would hand it from the host to the host, by way of another thread.
        access: Any = cl.map_flags.READ | cl.map_flags.WRITE
        host, _ = cl.enqueue_map_buffer(self.queue, memory, access, 0, shape, kind)
        return Buffer(memory, shape, kind, host)

    def seen(self, buffer: Buffer, count: int) -> npt.NDArray[Any]:
        """Wait for what was enqueued, and return the first items of a buffer, which the next launch may change."""
        import pyopencl as cl

        assert buffer.host is not None, "of allocate_seen"
        found: npt.NDArray[Any] = buffer.host[:count]
        if self.device.is_cpu:
            self.queue.finish()
        elif found.nbytes:
            cl.enqueue_copy(self.queue, found, buffer.memory)
        return found

    def fill(self, buffer: Buffer, value: float) -> None:
        """Let all items of a buffer have one value."""
        import pyopencl as cl

        pattern = np.array(value, dtype=buffer.dtype)
        cl.enqueue_fill_buffer(self.queue, buffer.memory, pattern, 0, int(np.prod(buffer.shape)) * pattern.itemsize)

    def read(self, buffer: Buffer, out: npt.NDArray[Any] | None = None) -> npt.NDArray[Any]:
        """Copy a buffer (its first ``len(out)`` items) to the host."""
        import pyopencl as cl

        result = np.empty(buffer.shape, buffer.dtype) if out is None else out
        if result.nbytes:
            cl.enqueue_copy(self.queue, result, buffer.memory)
        return result

    def write(self, buffer: Buffer, values: npt.NDArray[Any]) -> None:
        """Copy an array of the host to a buffer."""
        import pyopencl as cl

        if values.nbytes:
            cl.enqueue_copy(self.queue, buffer.memory, np.ascontiguousarray(values, dtype=buffer.dtype))

    def launch(self, kernel: Any, size: tuple[int, ...], *arguments: Any) -> None:
        """Enqueue a kernel over ``size`` work-items; float arguments take the build's precision."""
        import pyopencl as cl

        twin = self._bound_to(kernel, arguments)
        # One work-item a work-group on a CPU: left to choose, PoCL runs many in one loop whose private arrays
        # overflow its threads' stacks.
        cl.enqueue_nd_range_kernel(self.queue, twin, size, (1,) * len(size) if self.device.is_cpu else None)

    def _bound_to(self, kernel: Any, arguments: tuple[Any, ...]) -> Any:
        """Return a kernel like this one that has these arguments.

        There are two of each: from one step to the next some arguments swap places, and to set them takes longer than
        to launch.
        """
        import pyopencl as cl

        twins = self._twins.setdefault(kernel, [])
        for twin, known, _ in twins:
            if known == arguments:
                return twin
        if len(twins) < 2:
            twin = cl.Kernel(kernel.program, kernel.function_name)
            values = [self._argument(a) for a in arguments]
            # Told the types, pyopencl sets numbers fifty times as fast as by way of numpy's buffers.
            twin.set_scalar_arg_dtypes([value.dtype if isinstance(value, np.generic) else None for value in values])
        else:
            twin, known, values = twins.pop(0)
            values = [
                value if old is new else self._argument(new)
                for old, value, new in zip(known, values, arguments, strict=True)
            ]
        twin.set_args(*values)
        twins.append((twin, arguments, values))
        return twin

    def _argument(self, value: Any) -> Any:
        if isinstance(value, Buffer):
            return value.memory
        if isinstance(value, float):
            return np.asarray(value, dtype=self.real)[()]
        if isinstance(value, int):
            return np.int32(value)
        return value


def _text(file: str, generated: str) -> str:
    """Return the text of a program: ``file``.cl with what it includes in place, each file once."""
    included: set[str] = set()

    def resolved(name: str) -> str:
        if name in included:
            return ""
        included.add(name)
        if name == "generated":
            return generated
        return _INCLUDE.sub(lambda line: resolved(line[1]), _read(name))

    return resolved(f"{file}.cl")


@cache
def _read(name: str) -> str:
    return (files("clsim.kernels") / name).read_text(encoding="utf-8")


@lru_cache(maxsize=64)
def _build(context: Any, text: str, options: tuple[tuple[str, object], ...]) -> Any:
    import pyopencl as cl

    try:
        return built(context, text, [f"-D{key}={value}" for key, value in options])
    except cl.Error as error:
        raise Error(f"{context.devices[0].name.strip()} does not build a kernel: {reason_in(error)}") from error
