"""What a page may say over its WebSocket, and nothing else: whoever reaches the address can send anything."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import Literal, NoReturn

LARGEST_MESSAGE = 4096
"""Bytes of a message; the page's own have fewer than a hundred."""
_LATEST_US = 1 << 53
"""Times beyond are none that JavaScript could name exactly (285 years)."""


@dataclass(frozen=True)
class Seen:
    """The page has shown so many packets in all."""

    packets: int


@dataclass(frozen=True)
class WantFrames:
    """Whether the page can show images at the moment."""

    wanted: bool


@dataclass(frozen=True)
class Switch:
    """Play or pause; play again at the end, or not."""

    name: Literal["play", "loop"]
    on: bool


@dataclass(frozen=True)
class Speed:
    """Seconds of events in a second; positive."""

    value: float


@dataclass(frozen=True)
class Seek:
    """Go to a time [µs], not before 0."""

    time_us: int


Control = Switch | Speed | Seek
Message = Seen | WantFrames | Control


def parse_message(text: str | bytes) -> Message | None:
    """Return what a page says; None for anything that ours would not say."""
    try:
        said = json.loads(text, parse_constant=_refuse)
    except (ValueError, RecursionError):
        return None
    if not isinstance(said, dict):
        return None
    command, value = said.get("command"), said.get("value")
    if command in ("play", "loop") and isinstance(value, bool):
        return Switch(command, value)
    if command == "speed" and (speed := _number(value)) is not None and speed > 0:
        return Speed(speed)
    if command == "seek" and (time_us := _number(value)) is not None:
        return Seek(int(min(max(time_us, 0), _LATEST_US)))
    if (packets := _number(said.get("seen"))) is not None:
        return Seen(int(packets))
    if isinstance(said.get("frames"), bool):
        return WantFrames(said["frames"])
    return None


def _number(value: object) -> float | None:
    """Return a finite number as one, anything else as None (JSON's 1e999 is infinite, and true is no number)."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def _refuse(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number")
