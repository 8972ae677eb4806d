"""From any file or stream of events to any other, batch by batch."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from clsim.errors import InputError
from clsim.events import SinkError
from clsim.events.batch import EventBatch, Labelling, Labels, Sink
from clsim.events.files import LABELLED, read_format_of, split_topic
from clsim.events.formats.filesource import EventSource
from clsim.events.open import open_events, sensor_size
from clsim.events.outputs import FileOptions, check_output, open_output
from clsim.events.sidecar import sidecar_path, write_sidecar
from clsim.events.sockets.address import is_address
from clsim.events.sockets.closing import close_at_once
from clsim.events.sockets.stream_source import SocketSource
from clsim.events.whole import WholeFile, open_whole
from clsim.version import VERSION


class Copied(NamedTuple):
    """What a conversion has done so far."""

    events: int = 0
    time_us: int = 0
    """Of the last of them."""
    dropped_events: int = 0
    """Left out, because they lie outside the sensor or came too late."""
    moved_events: int = 0
    """Put in their place, because they came after later ones."""
    lost_labels: Labels = ()
    """Which labels the target cannot hold."""


def convert_events(
    source_name: str,
    target_name: str,
    resolution: tuple[int, int] | None = None,
    progress: Callable[[Copied], None] = lambda copied: None,
    files: FileOptions | None = None,
    *,
    strict: bool = False,
) -> Copied:
    """Copy all events with their labels, in bounded memory; returns how many. ``progress`` hears of each batch.

    ``files`` says how a target file is written; ``strict`` refuses a source file whose events are out of order, or
    whose end is missing.

    A target file is there in the end only if all was well, and what stood under its name stays until then. One that
    records a stream is written in place and kept, whatever ends it: a stream comes once. The sidecar comes along.

    Raises:
        InputError: the source or the target cannot be used, or the source is damaged.
        SinkError: the target can no longer be written.
    """
    if not is_address(target_name) and not is_address(source_name) and _same_file(source_name, target_name):
        raise InputError(f"{target_name}: is the file to read; expected another name to write")
    files = files or FileOptions()
    files.check([target_name])
    about = _source_sidecar(source_name)
    records_stream = is_address(source_name)
    labelled = _labels_of(source_name)
    labels = labelled if "cause" in labelled and files.format_of(target_name) in LABELLED else ()
    if labels:
        files = replace(files, labels=True, objects="object" in labels)
    with open_events(source_name, labels=labels, strict=strict) as source:
        size = sensor_size(source_name, source, resolution)
        batches = iter(source)
        batch = next(batches, None)  # most of what can be wrong with a source shows here, before the target is touched
        check_output(target_name, *size, files)
        sink = (open_output if records_stream else open_whole)(target_name, *size, files)
        done = Copied(lost_labels=() if labels else labelled)
        try:
            while batch is not None:
                end_us = int(batch["t"][-1])
                _write(sink, batch, end_us, labels)
                done = _left(done._replace(events=done.events + len(batch), time_us=end_us), source)
                progress(done)
                batch = next(batches, None)
            done = _left(done, source)  # of the last words, which held no others
            sink.close()
        except BaseException as error:
            with contextlib.suppress(SinkError, OSError):  # the first failure is the one to tell
                if isinstance(sink, WholeFile):
                    sink.abandon()
                else:
                    close_at_once(sink)
            if records_stream and isinstance(error, KeyboardInterrupt | InputError):
                _write_sidecar(source_name, target_name, about, size, done.events)
            raise
    _write_sidecar(source_name, target_name, about, size, done.events)
    return done


def _left(done: Copied, source: EventSource | SocketSource) -> Copied:
    moved = source.moved_events if isinstance(source, EventSource) else 0
    return done._replace(dropped_events=source.dropped_events, moved_events=moved)


def _labels_of(source: str) -> Labels:
    """Return which labels stand beside the events of a file, if its format has any: a pipe cannot be opened twice."""
    if is_address(source) or Path(source).is_dir() or read_format_of(split_topic(source)[0]).name not in LABELLED:
        return ()
    with open_events(source) as opened:
        return opened.labelled if isinstance(opened, EventSource) else ()


def _write(sink: Sink, batch: EventBatch, end_us: int, labels: Labels) -> None:
    if isinstance(sink, Labelling) and labels:
        sink.write(batch, end_us, *(batch[name] for name in labels))
    else:
        sink.write(batch, end_us)


def _same_file(source: str, target: str) -> bool:
    try:
        return Path(target).samefile(split_topic(source)[0])
    except OSError:
        return False


def _source_sidecar(name: str) -> dict[str, Any]:
    path = sidecar_path(name)
    if path is None or not path.exists():
        return {}
    try:
        about: dict[str, Any] = dict(json.loads(path.read_text(encoding="utf-8-sig")))
        return about
    except (OSError, ValueError, TypeError, RecursionError) as error:
        raise InputError(f"{path}: is no sidecar ({error}); expected a JSON object, or no such file") from None


def _write_sidecar(source: str, target: str, about: dict[str, Any], size: tuple[int, int], events: int) -> None:
    path = sidecar_path(target)
    if path is None:
        return
    for key in ("poses", "scene_from_here"):  # paths from the folder of the sidecar
        if isinstance(about.get(key), str):
            about[key] = os.path.relpath(Path(source).parent / about[key], path.parent)
    about = {"clsim_version": VERSION, "camera": {"width": size[0], "height": size[1]}} | about
    write_sidecar(path, about | {"converted_from": source, "events": events})
