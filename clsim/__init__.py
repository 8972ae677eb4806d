"""clsim: live event-camera simulation from path-traced 3-D scenes.

>>> import clsim
>>> with clsim.stream("two-boxes", duration_s=0.1) as run:  # doctest: +SKIP
...     for events in run:
...         print(len(events), "events")
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from clsim.errors import Error, InputError
from clsim.version import VERSION

if TYPE_CHECKING:
    from clsim.events import EVENT_DTYPE, SinkError
    from clsim.events.open import open_events as open
    from clsim.events.write import EventWriter as write  # noqa: N813 - called like a function
    from clsim.live.footage import events_from
    from clsim.live.stream import stream
    from clsim.scene import World, WorldBuilder
    from clsim.scene import load_world as load_scene
    from clsim.simulator import RigSimulator, Simulator
    from clsim.simulator.batch import Batch as batch  # noqa: N813 - called like a function

__version__ = VERSION

__all__ = [
    "EVENT_DTYPE",
    "Error",
    "InputError",
    "RigSimulator",
    "Simulator",
    "SinkError",
    "World",
    "WorldBuilder",
    "__version__",
    "batch",
    "events_from",
    "load_scene",
    "open",
    "stream",
    "write",
]

_WHERE = {
    "EVENT_DTYPE": ("clsim.events", "EVENT_DTYPE"),
    "RigSimulator": ("clsim.simulator", "RigSimulator"),
    "Simulator": ("clsim.simulator", "Simulator"),
    "SinkError": ("clsim.events", "SinkError"),
    "World": ("clsim.scene", "World"),
    "WorldBuilder": ("clsim.scene", "WorldBuilder"),
    "batch": ("clsim.simulator.batch", "Batch"),
    "events_from": ("clsim.live.footage", "events_from"),
    "load_scene": ("clsim.scene", "load_world"),
    "open": ("clsim.events.open", "open_events"),
    "stream": ("clsim.live.stream", "stream"),
    "write": ("clsim.events.write", "EventWriter"),
}
"""What is imported only when it is asked for: the light rooms must not wait for the heavy ones."""


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module 'clsim' has no attribute {name!r}")
    module, attribute = _WHERE[name]
    return getattr(import_module(module), attribute)


def __dir__() -> list[str]:
    return __all__
