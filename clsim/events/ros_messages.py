"""The old name of `clsim.events.ros.messages`, understood for one version."""

from __future__ import annotations

import warnings
from typing import Any

from clsim.events.ros import messages


def __getattr__(name: str) -> Any:
    found = getattr(messages, name)
    warnings.warn("clsim.events.ros_messages is now clsim.events.ros.messages", DeprecationWarning, stacklevel=2)
    return found
