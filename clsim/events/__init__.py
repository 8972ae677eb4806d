"""Events: the event type, file codecs and sockets."""

from clsim.events.batch import EVENT_DTYPE, EventBatch, Exposed, Hurried, Reporting, Sink, SinkError, empty_batch

__all__ = ["EVENT_DTYPE", "EventBatch", "Exposed", "Hurried", "Reporting", "Sink", "SinkError", "empty_batch"]
