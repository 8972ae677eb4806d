"""An event camera behind any renderer: pictures of linear light in, events out."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.detect.config import DetectorConfig, EventRule
from clsim.detector import Detector
from clsim.errors import Error, InputError
from clsim.events import EventBatch
from clsim.frames import RADIANCE, Frame, page_aligned
from clsim.live.sensors import RecordedSensor
from clsim.opencl.device import choose_device
from clsim.scene.light.spectral import spectral_weights
from clsim.scene.world import Spectral
from clsim.sensor.settings import SensorSettings
from clsim.values import from_plain, read_value

_THRESHOLD = 0.2
_LATEST_US = 1 << 62
"""What is much later does not fit the times of events."""
_ON_HOST = (1, 3)
"""DLPack's devices whose memory a CPU reads: its own, and what is pinned for CUDA."""


class RadianceCamera:
    """Turns pictures that others render into events; see `clsim.Simulator.from_radiance`.

    Attributes:
        width, height: of the sensor [pixels].
        time_us: time of the last picture; None before the first.
    """

    def __init__(
        self,
        width: int,
        height: int,
        *,
        threshold: float | tuple[float, float] | None = None,
        sensor: str | Path | SensorSettings | None = None,
        lux_per_unit: float = 100.0,
        seed: int = 0,
        event_rule: EventRule = "interpolated",
        scale: float = 1.0,
        floor: float = 1e-4,
        opencl: str | None = None,
    ) -> None:
        """Build the pixels.

        Args:
            width: of the sensor [pixels].
            height: of the sensor [pixels].
            threshold: contrast threshold of ON and OFF events [natural-log units], or of each; None takes the sensor's,
                or .2.
            sensor: its name, its file or its settings, as for `clsim.stream`; None is the ideal one.
            lux_per_unit: illuminance of the sensor where luminance is 1 [lux], for sensors to whom it matters.
            seed: of the sensor's random numbers.
            event_rule: "interpolated" gives each crossing its own time between two pictures, "frame" the later one's.
            scale: L = ln max(scale·Y, floor), Y the luminance.
            floor: the darkest that a pixel tells.
            opencl: part of the name of the OpenCL device.

        Raises:
            InputError: a value cannot be.
        """
        self.width, self.height = read_value("width", width, int), read_value("height", height, int)
        if min(self.width, self.height) < 1:
            raise InputError(f"`width` and `height` must be at least 1, got {width} and {height}")
        told = from_plain(RecordedSensor, {"sensor": sensor, "seed": seed, "lux_per_unit": lux_per_unit})
        settings = told.sensor
        on, off = _thresholds(read_value("threshold", threshold, float | tuple[float, float] | None), settings)
        spectral: Spectral | None = None if settings is None else settings.optics.spectral
        config = DetectorConfig(
            method="esim", event_rule=event_rule, threshold_on=on, threshold_off=off, scale=scale, floor=floor,
            luminance=spectral_weights(spectral or "luminance"),
            mosaic=None if settings is None else settings.optics.mosaic,
        )  # fmt: skip
        # Its level is the logarithm of scaled luminance, which is 0 where luminance is 1 / scale.
        specimen = told.specimen(config.scale)
        device = choose_device(read_value("opencl", opencl, str | None))
        self._detector = Detector(config, self.width, self.height, RADIANCE, device=device, specimen=specimen)
        self._own = page_aligned((len(RADIANCE), self.height, self.width))
        self._closed = False
        self._count = 0
        self.time_us: int | None = None

    def push(self, radiance: Any, t_us: int) -> EventBatch:
        """Show the pixels the next picture, and return the events since the one before; the first fires none.

        Args:
            radiance: linear light, any factor of it, as ``[H, W]`` luminance, ``[H, W, 3]`` or ``[3, H, W]`` in linear
                Rec. 709; of numpy, Warp, or whatever speaks DLPack, on the CPU or a CUDA device. Float32 ``[3, H, W]``
                without gaps in the CPU's memory is read where it lies; all else is copied once. NaN has no value.
            t_us: its time [µs], from 0 on and later than that of the picture before.

        Raises:
            InputError: the picture has another shape, or its time is not later, or negative.
            clsim.Error: the camera is closed.
        """
        if self._closed:
            raise Error("the camera is closed")
        t_us = read_value("t_us", t_us, int)
        if t_us < 0:
            raise InputError(f"`t_us` must be 0 or later, got {t_us}")
        if t_us > _LATEST_US:
            raise InputError(f"`t_us` must be at most {_LATEST_US}, got {t_us}")
        if self.time_us is not None and t_us <= self.time_us:
            raise InputError(f"`t_us` must be after the picture before, at {self.time_us} µs, got {t_us}")
        planes = self._planes(on_host(radiance))
        events: EventBatch = self._detector.step(Frame(planes, RADIANCE, t_us, self._count)).copy()
        self._count += 1
        self.time_us = t_us
        return events

    def reset(self) -> None:
        """Forget all pictures: the next one fires nothing, and may be of any time."""
        self._detector.restart()
        self.time_us = None

    def close(self) -> None:
        """Release the device's memory; safe to call twice."""
        if not self._closed:
            self._closed = True
            self._detector.close()

    def __enter__(self) -> RadianceCamera:
        """Return the camera, which is closed with the block."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        self.close()

    def _planes(self, radiance: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
        """Return the picture as float32 ``[3, H, W]``: itself if it is that, else our own memory with a copy."""
        size = (self.height, self.width)
        if radiance.shape == (3, *size):
            ready = radiance.dtype == np.float32 and radiance.flags.c_contiguous and radiance.flags.aligned
            if ready:
                return radiance
            source = radiance
        elif radiance.shape == (*size, 3):
            source = np.moveaxis(radiance, 2, 0)
        elif radiance.shape == size:
            source = radiance[None]
        else:
            raise InputError(
                f"`radiance` has shape {radiance.shape}, expected {size}, {(*size, 3)} or {(3, *size)} for a sensor of "
                f"{self.width}×{self.height}"
            )
        if radiance.dtype.kind not in "fiu":
            raise InputError(f"`radiance` holds {radiance.dtype}, expected numbers")
        np.copyto(self._own, source, casting="unsafe")
        return self._own


def _thresholds(given: float | tuple[float, float] | None, sensor: SensorSettings | None) -> tuple[float, float]:
    """Return the thresholds of ON and OFF events: those given, else the sensor's, else .2."""
    if given is not None:
        return given if isinstance(given, tuple) else (given, given)
    on, off = (None, None) if sensor is None else (sensor.threshold.on, sensor.threshold.off)
    return _THRESHOLD if on is None else on, _THRESHOLD if off is None else off


def on_host(array: Any) -> npt.NDArray[Any]:
    """Return an array in the CPU's memory, without a copy if it is there already.

    Raises:
        InputError: it is no array.
    """
    try:
        if isinstance(array, np.ndarray) or not hasattr(array, "__dlpack_device__"):
            return np.asarray(array)
        device, _ = array.__dlpack_device__()
        if int(device) in _ON_HOST:
            return np.from_dlpack(array)
        import warp as wp

        on_device: Any = wp.from_dlpack(array)
        found: npt.NDArray[Any] = on_device.numpy()
        return found
    except (TypeError, ValueError, RuntimeError, BufferError) as error:
        raise InputError(f"`radiance` cannot be read as an array ({error})") from None
