"""How long a socket may take, when it closes, to hand over what waits for its readers."""

from __future__ import annotations

from clsim.events.batch import BriefFlush, Sink

CLOSE_TIMEOUT_S = 30.0
"""At most, however busy its readers are."""
PATIENCE_S = 1.0
"""While no reader takes anything: it is stuck then."""
BRIEF_FLUSH_S = 0.3
"""At most, once somebody pressed Ctrl-C."""


def close_at_once(sink: Sink) -> None:
    """Close a sink without patience for its readers."""
    if isinstance(sink, BriefFlush):
        sink.flush_briefly()
    sink.close()
