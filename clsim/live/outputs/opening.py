"""The outputs of a run, opened. A file that is there already is replaced when the first frame is done, not before."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

from clsim.errors import InputError
from clsim.events import Sink
from clsim.events.files import format_named
from clsim.events.formats.filesink import PartFile
from clsim.events.outputs import FileOptions, open_output, open_outputs
from clsim.events.sidecar import sidecar_path
from clsim.events.sockets.address import is_address
from clsim.live.outputs.delivery import Output


def open_sinks(
    names: Sequence[str],
    options: FileOptions,
    extra_sinks: Sequence[Sink],
    size: tuple[int, int],
    own: Mapping[str, Callable[[str], Sink]] = MappingProxyType({}),
) -> list[Output]:
    """Open the outputs of a run, ``own`` last: not for events alone, and opened with the name to write at first.

    Closes ``extra_sinks`` if one cannot be opened.
    """
    parts: dict[str, PartFile] = {}

    def open_one(name: str) -> Sink:
        part = _part_for(name, options)
        if part is None:
            return own[name](name) if name in own else open_output(name, *size, options)
        parts[name], place = part, str(part.part)
        try:
            if name in own:
                return own[name](place)
            return open_output(place, *size, replace(options, format=options.format_of(name)))
        except InputError as error:
            raise InputError(str(error).replace(place, name)) from None

    try:
        sinks = open_outputs([name for name in names if name not in own], *size, options, open_one)
        sinks |= {name: open_one(name) for name in own}
    except BaseException:
        for sink in extra_sinks:
            sink.close()
        for part in parts.values():
            part.discard()
        raise
    outputs = [Output(f"sink {i}", sink) for i, sink in enumerate(extra_sinks)]
    return outputs + [
        Output(name, sink, sidecar=sidecar_path(name), part=parts.get(name)) for name, sink in sinks.items()
    ]


def _part_for(name: str, options: FileOptions) -> PartFile | None:
    """Return a file to write at first, where there is another under the name that is not to be lost yet.

    Formats that are all or nothing need none, and layouts of truth that are folders refuse what is there.
    """
    place = Path(os.path.realpath(name))
    if is_address(name) or not place.is_file() or place.stat().st_size == 0:
        return None
    try:
        kind = options.format_of(name)
        if kind is None or format_named(kind).all_or_nothing:
            return None
        return PartFile(Path(name), ending=Path(name).suffix)
    except InputError:  # of another layout, or in a folder that takes no new files
        return None
