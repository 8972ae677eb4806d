"""clsim: live event-camera simulation from path-traced 3-D scenes.

>>> import clsim
>>> for batch in clsim.stream("two-boxes", spp=8):  # doctest: +SKIP
...     print(len(batch), "events")
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from clsim.errors import Error, InputError
from clsim.version import VERSION

if TYPE_CHECKING:
    from clsim.events.open import open_events as open
    from clsim.events.write import EventWriter as write  # noqa: N813 - called like a function
    from clsim.live.stream import stream

__version__ = VERSION

__all__ = ["Error", "InputError", "__version__", "open", "stream", "write"]


def __getattr__(name: str) -> Any:
    """Import the pipeline only when it is asked for: the light rooms must not wait for it."""
    if name == "stream":
        from clsim.live.stream import stream

        return stream
    if name == "open":
        from clsim.events.open import open_events

        return open_events
    if name == "write":
        from clsim.events.write import EventWriter

        return EventWriter
    raise AttributeError(f"module 'clsim' has no attribute {name!r}")
