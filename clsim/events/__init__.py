"""Events: the event type, file codecs and sockets."""

from clsim.events.batch import (
    CAUSES,
    EVENT_DTYPE,
    BriefFlush,
    Causes,
    EventBatch,
    Exposed,
    Labelling,
    Labels,
    Objects,
    Reporting,
    Sink,
    SinkError,
    empty_batch,
    with_causes,
)

__all__ = [
    "CAUSES",
    "EVENT_DTYPE",
    "BriefFlush",
    "Causes",
    "EventBatch",
    "Exposed",
    "Labelling",
    "Labels",
    "Objects",
    "Reporting",
    "Sink",
    "SinkError",
    "empty_batch",
    "with_causes",
]
