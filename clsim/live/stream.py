"""A live run as a Python iterator."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from clsim.events import EventBatch, SinkError
from clsim.events.queue_sink import QueueSink
from clsim.live.options import LiveOptions
from clsim.live.session import open_live


def stream(scene: str | Path, **options: Any) -> Iterator[EventBatch]:
    """Yield the events of each frame of a scene, as they happen.

    Args:
        scene: name of a bundled scene, or a scene file.
        options: fields of ``LiveOptions``, such as ``spp=8``, ``duration_s=2.0``, ``threshold=(0.2, 0.2)``.

    Yields:
        One EventBatch a frame, possibly empty; the first frame sets the references and fires nothing.

    Raises:
        InputError: a scene or option cannot be used.
        SinkError: in the end, if one of ``outputs`` failed on the way; the events of the run were all yielded.
    """
    queue = QueueSink(capacity=4)
    session = open_live(LiveOptions(scene=scene, **options), extra_sinks=(queue,))
    session.start()
    try:
        while True:
            taken = queue.get(timeout_s=0.05)
            if taken is not None:
                yield taken[0]
            elif session.pipeline.wait(0.0):
                break
        while (taken := queue.get(timeout_s=0.0)) is not None:
            yield taken[0]
        session.write_sidecars(complete=True)
        failures = [output.error for output in session.pipeline.outputs if output.error is not None]
        if failures:
            raise SinkError("; ".join(failures))
    finally:
        queue.close()
        session.pipeline.stop()
