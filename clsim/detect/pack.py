"""Host side of pack.cl: reads frames where they are and packs them for the other kernels."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.detect.config import DetectorConfig
from clsim.detect.features import mosaic_weights
from clsim.detect.layout import Place
from clsim.frames import COVERAGE, DEPTH, LUMINANCE_VARIANCE, RADIANCE, Frame
from clsim.opencl.device import Device

_CACHED_FRAMES = 8


class FrameMemory:
    """OpenCL buffers over the memory of frames: no copy on a CPU.

    The buffer of an address is kept, with a reference to the array so that the address cannot be given away; a ring's
    slots are therefore registered once. Outside `lend` the memory belongs to the host: it is mapped, unless the device
    is the host itself.
    """

    def __init__(self, device: Device, queue: Any) -> None:
        """Start with nothing registered."""
        self._device, self._queue = device, queue
        self._known: OrderedDict[tuple[int, int], tuple[Any, Any, Any]] = OrderedDict()

    def lend(self, frame: Frame) -> Any:
        """Hand the frame's planes to the device and return their buffer."""
        import pyopencl as cl

        planes = frame.planes
        key = _place_of(planes)
        if key in self._known:
            memory, _, mapped = self._known[key]
            if mapped is not None:
                mapped.base.release(self._queue)
        else:
            flags = cl.mem_flags.READ_ONLY | cl.mem_flags.USE_HOST_PTR
            memory = cl.Buffer(self._device.context, flags, hostbuf=planes)
        self._known[key] = (memory, planes, None)
        self._known.move_to_end(key)
        if len(self._known) > _CACHED_FRAMES:
            self._let_go([self._known.popitem(last=False)[1]])
        return memory

    def take_back(self, frame: Frame) -> None:
        """Give the frame's memory back to the host, which has it when it has waited for a later command."""
        import pyopencl as cl

        if self._device.is_cpu:
            return  # to map would hand it from the host to the host, by way of another thread
        planes = frame.planes
        key = _place_of(planes)
        memory = self._known[key][0]
        flags: Any = cl.map_flags.READ | cl.map_flags.WRITE
        mapped, _ = cl.enqueue_map_buffer(self._queue, memory, flags, 0, planes.shape, planes.dtype, is_blocking=False)
        self._known[key] = (memory, planes, mapped)

    def close(self) -> None:
        """Forget all buffers."""
        self._let_go(list(self._known.values()))
        self._known.clear()

    def _let_go(self, entries: list[tuple[Any, Any, Any]]) -> None:
        """Release buffers, and only then the arrays below them: the device has to be done with handing them back."""
        for _, _, mapped in entries:
            if mapped is not None:
                mapped.base.release(self._queue)
        self._finish()
        for memory, _, _ in entries:
            memory.release()

    def _finish(self) -> None:
        self._queue.finish()


def _place_of(planes: npt.NDArray[np.float32]) -> tuple[int, int]:
    """Return where planes lie, and how many bytes they are; ``ctypes.data`` takes ten times as long."""
    return planes.__array_interface__["data"][0], planes.nbytes


class Pack:
    """Packs frames into ring slots ``[slots][H + 2·border][planes][pitch]`` of mask, brightness and features."""

    def __init__(
        self, place: Place, config: DetectorConfig, names: tuple[str, ...],
        features: tuple[str, ...], quiet: tuple[str, ...], slots: int,
    ) -> None:  # fmt: skip
        """Prepare for frames with planes ``names``; ``quiet`` are candidates that have been constant so far."""
        self._place = place
        self._quiet = quiet
        self._coverage = COVERAGE[0] in names
        (self._kernel,) = place.kernels("detect/pack", ("pack",))
        planes = (*RADIANCE, *features, *quiet, *(COVERAGE if self._coverage else ()))
        self._source = place.allocate((len(planes),), np.int32)
        place.write(self._source, np.array([names.index(name) for name in planes], dtype=np.int32))
        weights = np.array(mosaic_weights(config), dtype=place.real).ravel() * config.scale
        self._weights = place.allocate(weights.shape)
        place.write(self._weights, weights.astype(place.real))
        self._variance = names.index(LUMINANCE_VARIANCE) if place.layout.extra else -1
        self._variance_scale = config.scale**2
        height = place.layout.height
        self.packed = place.allocate((slots, *place.layout.packed_shape))
        self._invalid = place.allocate((height,), np.int32)
        self._range = place.allocate((height, len(quiet), 2), np.float32)
        self._host_invalid = np.zeros(height, dtype=np.int32)
        self._host_range = np.zeros((height, len(quiet), 2), dtype=np.float32)

    def run(self, memory: Any, slot: int) -> None:
        """Pack one frame."""
        layout = self._place.layout
        self._place.launch(
            self._kernel, (layout.height,), memory, self._source, layout.width, layout.height, layout.pitch,
            len(self._quiet), int(self._coverage), self._weights, self._variance, self._variance_scale,
            np.int64(self.offset(slot)),
            self.packed, self._invalid, self._range,
        )  # fmt: skip

    def found(self) -> tuple[int, npt.NDArray[np.float32]]:
        """Return how many pixels of the frame are invalid, and the extremes of each quiet plane, ``[quiet, 2]``."""
        invalid = int(self._place.read(self._invalid, self._host_invalid).sum())
        if not self._quiet:
            return invalid, np.zeros((0, 2), dtype=np.float32)
        extremes = self._place.read(self._range, self._host_range)
        return invalid, np.stack([extremes[..., 0].min(axis=0), extremes[..., 1].max(axis=0)], axis=1)

    def offset(self, slot: int) -> int:
        """Where a slot starts, in values."""
        return slot * self._place.layout.packed_size


def first_features(frame: Frame, candidates: tuple[str, ...]) -> tuple[str, ...]:
    """Return the candidates that are features from the first frame on: those not constant over its finite values.

    Depth of a miss is relative to its window: where misses are possible it is never known to be constant.
    """
    sticky = DEPTH[0] if COVERAGE[0] in frame.names else None
    result = []
    for name in candidates:
        values = frame.plane(name)
        finite = values[np.isfinite(values)]
        if name == sticky or (finite.size and finite.min() != finite.max()):
            result.append(name)
    return tuple(result)
