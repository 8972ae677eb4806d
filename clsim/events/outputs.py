"""``--out``: files, sockets and standard output by one spelling."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from clsim.errors import InputError
from clsim.events import Sink
from clsim.events.files import BAGS, FORMATS, LABELLED, format_named, format_of, open_sink
from clsim.events.formats.filesink import FlushPolicy
from clsim.events.sockets.address import is_address, is_standard_output, parse_address
from clsim.values import read_fields

TextTime = Literal["us", "s"]
Encoding = Literal["mono", "evt3", "array"]


@dataclass(frozen=True)
class FileOptions:
    """How files are written."""

    format: str | None = None
    """Format of files whose ending shall not decide.

    It is a name in `clsim.events.files.FORMATS`.
    """
    text_time: TextTime | None = None
    """Time in text, on standard output too: whole µs, or seconds with six decimals. [us]"""
    ros_events: Encoding | None = None
    """Events in bags of ROS: EventPacket in encoding mono or evt3, or dvs_msgs' EventArray. [mono]"""
    frames: bool = False
    """Frames, in 8-bit sRGB, along with the events in .aedat4 files."""
    labels: bool = False
    """What caused each event (signal, shot, leak, hot), in a column of .h5 and .parquet files; with ``truth`` labels
    the object too."""
    objects: bool = False
    """Whether they get the number of the object at each event's pixel too; follows from `truth` of a live run."""

    def __post_init__(self) -> None:
        """Refuse values of other types."""
        read_fields(self)

    def check(self, names: Sequence[str]) -> None:
        """Raise InputError where an option concerns none of the outputs ``names``, or the format is unknown."""
        formats = [kind for kind in map(self.format_of, names) if kind is not None]
        known = [each.name for each in FORMATS]
        if self.format is not None and self.format not in known:
            raise InputError(f'`format` "{self.format}" is unknown; expected one of: {", ".join(known)}')
        if self.format is not None and all(map(is_address, names)):
            raise InputError("`format` is for files, but no output is one; name a file in `outputs`")
        if self.text_time is not None and "text" not in formats:
            raise InputError("`text_time` is for text, but no output is text; name one in `outputs`, such as a.txt")
        if self.ros_events is not None and not set(BAGS) & set(formats):
            raise InputError("`ros_events` is for bags of ROS, but no output is one; name one, such as events.mcap")
        if self.labels and not set(LABELLED) & set(formats):
            raise InputError("`labels` go into HDF5 and Parquet, but no output is one; name one, such as events.h5")
        if self.objects:
            raise InputError("`objects` follows from `truth` of a live run; expected it to be left out")
        if self.frames and "aedat4" not in [self.format_of(name) for name in names if not is_address(name)]:
            raise InputError("`frames` go into an AEDAT4 file, but no output is one; name one, such as events.aedat4")

    def format_of(self, name: str) -> str | None:
        """Return the name of the format of an output; None for a socket. Raises InputError for an unknown ending."""
        if is_address(name):
            address = parse_address(name)
            return address.options.get("format", "text") if address.scheme == "-" else None
        if self.format is not None:
            return self.format
        if os.path.isdir(name):
            raise InputError(f"{name} is a folder, expected a file for events")
        try:
            return format_of(Path(name)).name
        except InputError as error:
            raise InputError(f"{error}; or name the format with `format`") from None


def open_outputs(
    names: Sequence[str],
    width: int,
    height: int,
    options: FileOptions,
    open_one: Callable[[str], Sink] | None = None,
) -> dict[str, Sink]:
    """Open all outputs of a run, by name; raises InputError, before any file is touched, if one of them cannot be.

    Opening a file replaces what was there, so the files come last: nothing may be lost because another output is wrong.
    ``open_one`` opens each; by default it is `open_output`.
    """
    ordered = sorted(names, key=lambda name: not is_address(name))
    places: dict[str, str] = {}
    for name in ordered:
        check_output(name, width, height, options)
        place = "-" if is_standard_output(name) else name if is_address(name) else os.path.realpath(name)
        if place in places:
            raise InputError(f"{name}: is the same output as {places[place]}; expected each of them once")
        places[place] = name
    new_files = [Path(os.path.realpath(name)) for name in names if not is_address(name) and not os.path.exists(name)]
    sinks: dict[str, Sink] = {}
    try:
        for name in ordered:
            sinks[name] = open_output(name, width, height, options) if open_one is None else open_one(name)
    except BaseException:
        for sink in sinks.values():
            sink.close()
        for path in new_files:
            path.unlink(missing_ok=True)
        raise
    return sinks


def check_output(name: str, width: int, height: int, options: FileOptions) -> None:
    """Raise InputError where a file could not be opened for events of such a sensor, without touching it."""
    kind = options.format_of(name)
    if is_address(name):
        return
    path = Path(name)
    if kind is not None:
        chosen = format_named(kind)
        chosen.load().LIMITS.check_size(path, width, height)
        chosen.check_library(path)
    if os.path.isdir(path):  # False, unlike Path's, for names that are too long
        raise InputError(f"{name} is a folder, expected a file for events")
    if not os.path.isdir(path.parent):
        raise InputError(f"{name}: there is no folder {path.parent}")
    if not os.access(path if os.path.exists(path) else path.parent, os.W_OK):
        raise InputError(f"{name}: permission denied")


def open_output(name: str, width: int, height: int, options: FileOptions) -> Sink:
    """Open a file, ``tcp://``, ``udp://``, ``unix://`` or ``-`` for events; raises InputError if it cannot be."""
    kind = options.format_of(name)
    if kind == "aedat4" and options.frames and not is_address(name):
        from clsim.events.formats.aedat4 import Aedat4Sink
        from clsim.events.formats.frame_recorder import FrameRecorder

        return FrameRecorder(Aedat4Sink(Path(name), width, height, FlushPolicy(), frames=True))
    own: dict[str, Any] = {}
    if kind == "text" and options.text_time is not None:
        own["time_unit"] = options.text_time
    if kind in BAGS and options.ros_events is not None:
        own["ros_events"] = options.ros_events
    if kind in LABELLED and options.labels:
        own["labels"] = ("cause", "object") if options.objects else ("cause",)
    if is_address(name):
        from clsim.events.socket_sinks import open_socket_sink

        return open_socket_sink(name, width, height, **own)
    return open_sink(name, width, height, format=kind, **own)
