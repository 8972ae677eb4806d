"""Builds the kernels in ``clsim.kernels`` for one choice of options, and lays out what they work on."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.opencl.device import Device

BORDER = 32
"""Columns and rows around a packed image (common.clh)."""
FIRST_FEATURE = 2
"""Planes of a packed image before the features: mask and brightness (common.clh)."""

_NAME, _COMMENT = re.compile(r"\w+"), re.compile(r"//.*")
_USES_BRIGHTNESS = re.compile(r"\b(natural_log|response|level_of|levels_of)\(")


@dataclass(frozen=True)
class Layout:
    """Sizes of everything that the kernels share; the comments of common.clh say what they mean.

    Attributes:
        width: pixels along x.
        height: pixels along y.
        features: feature planes besides pixel x and y.
        lanes: pixels that a work-item handles side by side.
        real: float32 or float64.
        extra: planes of a packed image after the features: 1 if the variance of luminance is there.
    """

    width: int
    height: int
    features: int
    lanes: int
    real: npt.DTypeLike
    extra: int = 0

    @property
    def span(self) -> int:
        """Columns of an image without border, a multiple of ``lanes``."""
        return -(-self.width // self.lanes) * self.lanes

    @property
    def pitch(self) -> int:
        """Columns of a packed image."""
        return self.span + 2 * BORDER

    @property
    def packed_shape(self) -> tuple[int, int, int]:
        """Shape of a packed frame."""
        return (self.height + 2 * BORDER, FIRST_FEATURE + self.features + self.extra, self.pitch)

    def image_shape(self, planes: int) -> tuple[int, int, int]:
        """Shape of an image without border."""
        return (self.height, planes, self.span)

    @property
    def vectors(self) -> tuple[int, int]:
        """Global size of kernels whose work-item is ``lanes`` neighbours."""
        return (self.span // self.lanes, self.height)


@dataclass(frozen=True)
class Buffer:
    """Device memory and the shape of what it holds."""

    memory: Any
    shape: tuple[int, ...]
    dtype: np.dtype[Any]


class Workplace:
    """A device with a queue and the macros that every kernel of one detector is built with."""

    def __init__(self, device: Device, layout: Layout, macros: dict[str, object]) -> None:
        """Keep the options; nothing is compiled before `kernels` is called."""
        self.device = device
        self.layout = layout
        self.queue = device.queue()
        self.real = np.dtype(layout.real)
        self._options = {"VW": layout.lanes, "F": layout.features, **macros}
        if self.real == np.float64:
            self._options["DOUBLE"] = 1

    def kernels(
        self, file: str, names: tuple[str, ...], macros: Mapping[str, object] | None = None, prefix: str = ""
    ) -> list[Any]:
        """Build ``file``.cl, with ``prefix`` between the headers and it, and return its kernels of these names.

        Macros that the text does not name are left out: OpenCL caches programs by text and options.
        """
        import pyopencl as cl

        text = _text(file, prefix)
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
        # One work-item a work-group on a CPU: left to choose, PoCL runs many in one loop whose private arrays
        # overflow its threads' stacks.
        local = (1,) * len(size) if self.device.is_cpu else None
        kernel(self.queue, size, local, *(self._argument(a) for a in arguments))

    def _argument(self, value: Any) -> Any:
        if isinstance(value, Buffer):
            return value.memory
        if isinstance(value, float):
            return np.asarray(value, dtype=self.real)[()]
        if isinstance(value, int):
            return np.int32(value)
        return value


def _text(file: str, prefix: str) -> str:
    """Return the text of a program: the headers that it needs, ``prefix``, and ``file``.cl."""
    source = _read(f"{file}.cl")
    headers = ["common.clh", *(["brightness.clh"] if _USES_BRIGHTNESS.search(source) else [])]
    return "\n".join([*map(_read, headers), prefix, source])


@cache
def _read(name: str) -> str:
    return (files("clsim.kernels") / name).read_text(encoding="utf-8")


@lru_cache(maxsize=64)
def _build(context: Any, text: str, options: tuple[tuple[str, object], ...]) -> Any:
    import pyopencl as cl

    # -w: PoCL's compiler warns of how vectors are passed between functions, and prints it over the user's terminal.
    return cl.Program(context, text).build(options=["-w", *(f"-D{key}={value}" for key, value in options)])
