"""Event files of every kind, opened by the ending of their name."""

from __future__ import annotations

import importlib.util
import inspect
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from clsim.errors import InputError
from clsim.events.batch import Labels, Sink
from clsim.events.formats.filesink import STDOUT, FlushPolicy
from clsim.events.formats.filesource import EventSource, naming_damage

_ONLY_READ = ""
_KEEPS = "a kill loses at most the last flush (10 ms of events or 65536 of them)"
_ALL_OR_NOTHING = "appears under its name only when complete: a kill loses everything"


@dataclass(frozen=True)
class FileFormat:
    """One kind of event file: its name, endings, the module that reads and writes it, and what a kill costs."""

    name: str
    endings: tuple[str, ...]
    module: str
    promise: str
    library: str | None = None
    """What it needs beyond clsim's own requirements."""
    extra: str | None = None
    """The extra that brings it, where that is not called as the format."""

    @property
    def all_or_nothing(self) -> bool:
        """Whether a file appears under its name only when it is complete."""
        return self.promise == _ALL_OR_NOTHING

    def check_library(self, path: Path) -> None:
        """Raise InputError if the library it needs is missing."""
        if self.library is not None and importlib.util.find_spec(self.library) is None:
            raise InputError(
                f"{path}: {self.name.capitalize()} needs {self.library}; "
                f"install it with: pip install 'clsim[{self.extra or self.name}]'"
            )

    def load(self) -> Any:
        """Import the module: LIMITS, ``open_sink(path, width, height, flush, **options)`` and ``open_source(path)``."""
        return importlib.import_module(f"clsim.events.{self.module}")


FORMATS = (
    FileFormat("aedat4", (".aedat4",), "formats.aedat4", _KEEPS),
    FileFormat("text", (".txt", ".csv"), "formats.tables.text", _KEEPS),
    FileFormat("evt3", (".evt3.raw",), "formats.prophesee.evt3", _KEEPS),
    FileFormat("evt2", (".raw",), "formats.prophesee.evt2", _KEEPS),
    FileFormat("dat", (".dat",), "formats.prophesee.dat", _KEEPS),
    FileFormat("es", (".es",), "formats.es", _KEEPS),
    FileFormat("hdf5", (".h5", ".hdf5"), "formats.tables.hdf5", _KEEPS),
    FileFormat("parquet", (".parquet",), "formats.tables.parquet", _ALL_OR_NOTHING, library="pyarrow"),
    FileFormat("npz", (".npz",), "formats.tables.npz", _ALL_OR_NOTHING),
    FileFormat("mcap", (".mcap",), "ros.mcap", _ALL_OR_NOTHING, library="rosbags", extra="ros"),
    FileFormat("db3", (".db3",), "ros.db3", _ALL_OR_NOTHING, library="rosbags", extra="ros"),
    FileFormat("bag", (".bag",), "ros.bag", _ALL_OR_NOTHING, library="rosbags", extra="ros"),
)
"""Every format that is written and read, in the order help texts list them."""
ONLY_READ = (
    FileFormat("aedat", (".aedat", ".aedat2", ".aedat3"), "formats.aedat", _ONLY_READ),
    FileFormat("npy", (".npy",), "formats.tables.npy", _ONLY_READ),
    FileFormat("mat", (".mat",), "formats.tables.mat", _ONLY_READ),
    FileFormat("nmnist", (".bin", ".bs2"), "formats.nmnist", _ONLY_READ),
)
"""Formats of recordings that others made."""
ENDINGS = tuple(ending for each in FORMATS for ending in each.endings)
"""Endings of files that are written."""
READ_ENDINGS = (*ENDINGS, *(ending for each in ONLY_READ for ending in each.endings))
"""Endings of files that are read."""
BAGS = ("mcap", "db3", "bag")
"""Those that are bags of ROS."""
WITH_TOPICS = (*BAGS, "hdf5")
"""Those that may hold the events of several cameras, one of which is named behind the file."""
LABELLED = ("hdf5", "parquet")
"""Those that may hold labels of events."""


def promises() -> str:
    """Return one sentence that tells, ending by ending, what a kill costs."""
    endings: dict[str, list[str]] = {}
    for each in FORMATS:
        endings.setdefault(each.promise, []).extend(each.endings)
    return "; ".join(f"{', '.join(names)}: {promise}" for promise, names in endings.items()) + "."


def open_sink(
    path: str | os.PathLike[str],
    width: int,
    height: int,
    *,
    format: str | None = None,
    flush: FlushPolicy | None = None,
    **options: Any,
) -> Sink:
    """Open an event file for writing, replacing one that is there; ``-`` is standard output, as text by default.

    ``format`` names one of FORMATS where the ending of the name shall not decide. ``options`` are the format's own.
    Raises InputError for an unknown ending or option, a sensor the format cannot hold, and a path that cannot be
    written, all before any event is asked for.
    """
    target = Path(path)
    chosen = format_named(format) if format else format_named("text") if target == STDOUT else format_of(target)
    chosen.check_library(target)
    opener = chosen.load().open_sink
    if flush is None:  # who reads along waits for it
        flush = FlushPolicy(interval_us=0) if target == STDOUT else FlushPolicy()
    known = list(inspect.signature(opener).parameters)[4:]
    for option in options:
        if option not in known:
            raise InputError(
                f"{target}: {chosen.name} has no option {option}; expected one of: {', '.join(known) or 'none'}"
            )
    sink: Sink = opener(target, width, height, flush, **options)
    return sink


def open_source(
    path: str | os.PathLike[str], *, format: str | None = None, labels: Labels = (), strict: bool = False
) -> EventSource:
    """Open an event file, or a folder with truth, for reading in bounded memory; see EventSource.

    `split_topic` tells how a topic of a bag or a group of HDF5 is named. ``strict`` makes events out of order
    an error, and a missing end.

    Raises InputError for an unknown ending, a file that cannot be read or is not of its format, and one whose events
    have not all of ``labels``.
    """
    target, topic = split_topic(path)
    if format is None and not labels and (folder := _open_folder(target)) is not None:
        if strict:
            folder.be_strict()
        return folder
    chosen = format_named(format, (*FORMATS, *ONLY_READ)) if format else read_format_of(target)
    if topic is not None and chosen.name not in WITH_TOPICS:
        raise InputError(f"{target}: has no topics, so that {topic} is none of them; expected a bag of ROS, or HDF5")
    chosen.check_library(target)
    options: dict[str, Any] = {} if topic is None else {"topic": topic}
    if labels and chosen.name in LABELLED:
        options["labels"] = labels
    with naming_damage(target):
        source: EventSource = chosen.load().open_source(target, **options)
    if missing := [name for name in labels if name not in source.labelled]:
        source.close()
        raise InputError(
            f"{target}: its events have no {', '.join(missing)}; expected HDF5 or Parquet written with `labels`"
        )
    if strict:
        source.be_strict()
    return source


def _open_folder(path: Path) -> EventSource | None:
    """Return the events of a recording with truth that is a folder, such as DSEC's; None for what is none."""
    from clsim.truth.recording import read_recording, recording_kind

    if not os.path.isdir(path) or recording_kind(str(path)) is None:
        return None
    found = read_recording(str(path))
    events = found.events()
    if not isinstance(events, EventSource):
        return EventSource(path, found.about.width, found.about.height, events)
    events.width, events.height = found.about.width, found.about.height
    return events


def split_topic(name: str | os.PathLike[str]) -> tuple[Path, str | None]:
    """Return a file, and the topic or group named behind it: ``stereo.bag#/davis/left/events``; None without one."""
    path, mark, topic = os.fspath(name).partition("#/")
    return (Path(path), f"/{topic}") if mark and not Path(name).exists() else (Path(name), None)


def format_of(path: Path) -> FileFormat:
    """Return the format that is written under a name's ending; InputError for an unknown one."""
    for candidate in FORMATS:
        if path.name.lower().endswith(candidate.endings):
            return candidate
    if any(path.name.lower().endswith(each.endings) for each in ONLY_READ):
        raise InputError(f'{path}: files that end in "{path.suffix}" are only read; expected {_listed(FORMATS)}')
    raise InputError(
        f'{path}: the ending "{path.suffix}" is no known event format; expected one of: {_listed(FORMATS)}'
    )


def read_format_of(path: Path) -> FileFormat:
    """Return the format that a name's ending tells of a file to read; InputError for an unknown one."""
    for candidate in (*FORMATS, *ONLY_READ):
        if path.name.lower().endswith(candidate.endings):
            return candidate
    if os.path.isdir(path):
        is_set = os.path.isfile(path / "dataset.json")
        hint = "; to read a data set, use clsim.datasets.load.Slices, or name a file in it" if is_set else ""
        raise InputError(f"{path}: is a folder, expected a file of events{hint}")
    raise InputError(
        f'{path}: the ending "{path.suffix}" is no known event format; expected one of: '
        f"{_listed((*FORMATS, *ONLY_READ))}"
    )


def _listed(formats: tuple[FileFormat, ...]) -> str:
    return ", ".join(ending for each in formats for ending in each.endings)


def format_named(name: str, known: tuple[FileFormat, ...] = FORMATS) -> FileFormat:
    """Return the format that has this name, of those ``known``; InputError for an unknown one."""
    for candidate in known:
        if candidate.name == name:
            return candidate
    raise InputError(f'event format "{name}" is unknown; expected one of: {", ".join(each.name for each in known)}')
