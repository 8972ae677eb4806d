"""Options of detection on recorded frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from clsim.detect.config import DetectorConfig
from clsim.errors import InputError
from clsim.events.outputs import FileOptions
from clsim.live.sensors import RecordedSensor
from clsim.values import from_plain, read_fields


@dataclass(frozen=True)
class RecordingOptions:
    """Options of detection on recorded frames."""

    frames: str
    """Folder or glob pattern of an EXR sequence."""
    config: DetectorConfig
    fps: float | None = None
    """Frames per second; None takes the times that the files carry."""
    opencl: str | None = None
    outputs: tuple[str, ...] = field(default=())
    files: FileOptions = field(default_factory=FileOptions)
    rendered_fps: float | None = None
    """Frames per second by which the frames were rendered, if known: their times are whole µs and tell it less well."""
    seen_by: RecordedSensor = field(default_factory=RecordedSensor)

    def __post_init__(self) -> None:
        """Refuse values that cannot work; see InputError for how messages name fields."""
        read_fields(self)
        if self.fps is not None and self.fps <= 0:
            raise InputError(f"`fps` must be a positive number, got {self.fps}")
        self.files.check(self.outputs)

    def as_dict(self) -> dict[str, Any]:
        """Return the options as plain values, for a sidecar; `from_dict` takes them back."""
        return asdict(self)

    @classmethod
    def from_dict(cls, plain: Mapping[str, Any]) -> RecordingOptions:
        """Return options from plain values, such as ``options`` of a sidecar; see `from_dict` of `LiveOptions`."""
        return from_plain(cls, plain)
