"""A pipeline whose source, detector and sinks are as small as may be."""

import time

import numpy as np

from clsim.events import EVENT_DTYPE, EventBatch, SinkError
from clsim.frames import Frame
from clsim.live.outputs.delivery import Output
from clsim.live.pacing.schedule import Schedule
from clsim.live.pipeline import Pipeline

NAMES = ("R", "G", "B")


class CountingSource:
    width, height, names, frame_count = 4, 3, NAMES, None

    def __init__(self, fail_at: int | None = None, seconds: float = 0.0) -> None:
        self.fail_at, self.seconds = fail_at, seconds
        self.filled: list[int] = []
        self.closed = self.cancelled = False

    def fill(self, index: int, out: Frame) -> None:
        if index == self.fail_at:
            raise FloatingPointError("the source broke")
        time.sleep(self.seconds)
        out.planes[...] = index
        self.filled.append(index)

    def cancel(self) -> None:
        self.cancelled = True

    def close(self) -> None:
        self.closed = True


class OneEventDetector:
    """Fires one event a frame, whose x is the source's frame index; each fourth is ON."""

    solved_share, masked, many_crossings, most_crossings, capped, lost = 0.25, 0, 0, 0, 0, 0

    @property
    def stats(self) -> "OneEventDetector":
        return self

    def __init__(self) -> None:
        self.resets: list[int] = []
        self.steps: list[tuple[int, int]] = []
        self.closed = False

    def step(self, frame: Frame) -> EventBatch:
        self.steps.append((frame.index, frame.time_us))
        batch = np.zeros(1, EVENT_DTYPE)
        batch["t"], batch["x"], batch["on"] = frame.time_us, int(frame.planes[0, 0, 0]), frame.index % 4 == 0
        return batch

    def reset(self) -> None:
        self.resets.append(len(self.steps))

    def close(self) -> None:
        self.closed = True


class ListSink:
    def __init__(self, fail_after: int | None = None, error: Exception | None = None) -> None:
        self.batches: list[EventBatch] = []
        self.fail_after = fail_after
        self.error = error or SinkError("disk.txt: no space left")
        self.closed = 0

    def write(self, batch: EventBatch, end_us: int) -> None:
        if self.fail_after is not None and len(self.batches) >= self.fail_after:
            self.fail_after = None  # what it is given later it would take
            raise self.error
        self.batches.append(batch.copy())

    def close(self) -> None:
        self.closed += 1


def run(schedule: Schedule, source: CountingSource | None = None, sinks: tuple[ListSink, ...] = (), **options: object):
    source, detector = source or CountingSource(), OneEventDetector()
    outputs = [Output(f"sink {i}", sink) for i, sink in enumerate(sinks)]
    pipeline = Pipeline(
        lambda: source,
        lambda: detector,
        outputs,
        schedule,
        (NAMES, 3, 4),
        **options,  # type: ignore[arg-type]
    )
    return pipeline, source, detector
