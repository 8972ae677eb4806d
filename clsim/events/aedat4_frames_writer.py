"""The process that writes for aedat4_frames: records from standard input into an AEDAT4 file, until the input ends."""

from __future__ import annotations

import sys
from typing import BinaryIO

import numpy as np

from clsim.events.aedat4_frames import EVENTS, RECORD_HEAD
from clsim.events.batch import EVENT_DTYPE
from clsim.events.convert import to_event_store


def copy(records: BinaryIO, path: str, width: int, height: int) -> None:
    """Write all whole records; a last one that a kill tore is left out."""
    import dv_processing as dv

    config = dv.io.MonoCameraWriter.Config("clsim")
    config.addEventStream((width, height))
    config.addFrameStream((width, height))
    writer = dv.io.MonoCameraWriter(path, config)
    while len(head := records.read(RECORD_HEAD.size)) == RECORD_HEAD.size:
        kind, time_us, size = RECORD_HEAD.unpack(head)
        data = records.read(size)
        if len(data) < size:
            return
        if kind == EVENTS:
            writer.writeEvents(to_event_store(np.frombuffer(data, EVENT_DTYPE)))
        else:
            writer.writeFrame(dv.Frame(time_us, np.frombuffer(data, np.uint8).reshape(height, width, 3)))


if __name__ == "__main__":
    copy(sys.stdin.buffer, sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
