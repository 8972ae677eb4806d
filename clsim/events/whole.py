"""A file that appears under its name only when all went well; what stood there stays until then."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from clsim.errors import InputError
from clsim.events.batch import Causes, EventBatch, Labelling, Labels, Objects, Sink, SinkError
from clsim.events.files import format_named
from clsim.events.formats.filesink import FileSink, PartFile
from clsim.events.outputs import FileOptions, open_output
from clsim.events.sockets.address import is_address


class WholeFile:
    """Writes beside the file, and gives what was written its name at ``close``; ``abandon`` leaves all as it was.

    Where the name is a symbolic link, the file it points at is replaced and the link stays.
    """

    def __init__(self, name: str, width: int, height: int, options: FileOptions) -> None:
        """Open the file under another name; raises InputError when it cannot be."""
        kind = options.format_of(name)
        self._name = self._part_name = name
        self._part: PartFile | None = None
        if kind is None or not format_named(kind).all_or_nothing:
            self._part = PartFile(Path(name), ending=Path(name).suffix)
            self._part_name = str(self._part.part)
        try:
            with self._naming():
                self._sink = open_output(self._part_name, width, height, replace(options, format=kind))
        except BaseException:
            if self._part is not None:
                self._part.discard()
            raise

    @property
    def labelled(self) -> Labels:
        """Which labels it keeps beside events."""
        return self._sink.labelled if isinstance(self._sink, Labelling) else ()

    def write(
        self, events: EventBatch, end_us: int, causes: Causes | None = None, objects: Objects | None = None
    ) -> None:
        """Take the events, and labels that it keeps, until ``end_us``; see Sink.write."""
        with self._naming():
            if isinstance(self._sink, Labelling):
                self._sink.write(events, end_us, causes, objects)
            else:
                self._sink.write(events, end_us)

    def close(self) -> None:
        """Complete the file and give it its name; raises SinkError when that cannot be."""
        with self._naming():
            self._sink.close()
            if self._part is not None:
                self._part.complete()

    def abandon(self) -> None:
        """Remove what was written."""
        with contextlib.suppress(SinkError, OSError):
            if isinstance(self._sink, FileSink):
                self._sink.abandon()
            else:
                self._sink.close()
        if self._part is not None:
            self._part.discard()

    @contextlib.contextmanager
    def _naming(self) -> Iterator[None]:
        """Tell of failures under the name that the user gave."""
        try:
            yield
        except (InputError, SinkError) as error:
            raise type(error)(str(error).replace(self._part_name, self._name)) from error.__cause__
        except OSError as error:
            raise SinkError(f"{self._name}: writing failed ({error.strerror or error})") from error


def open_whole(name: str, width: int, height: int, options: FileOptions) -> Sink:
    """Open an output that is a file as a WholeFile; pipes, devices, standard output and addresses as they are."""
    place = Path(os.path.realpath(name))
    if not is_address(name) and (place.is_file() or not place.exists()):
        return WholeFile(name, width, height, options)
    return open_output(name, width, height, options)
