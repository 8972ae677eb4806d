"""Events in a terminal: half blocks, two pixels to a character, with a status line under them."""

from __future__ import annotations

import os
import shutil
import threading
from collections.abc import Mapping
from typing import TextIO

import numpy as np
import numpy.typing as npt

from clsim.events import EventBatch
from clsim.live.view.accumulate import FloatImage, signed_image
from clsim.live.view.colormaps import ZERO, lut

DECAY_US = 20_000.0
"""Age [µs of event time] at which an event has faded to 1/e."""
LEVELS = 4
"""Steps of brightness for each polarity."""
_FULL_PER_SIDE = 2.0
"""An edge through a cell of n × n pixels fires about n events: this many times n make the brightest."""
_CUBE = (0, 95, 135, 175, 215, 255)
"""Values of red, green and blue that terminals with 256 colours have."""
_TABLE = {level: lut()[ZERO + round(85 * level / LEVELS)] for level in range(-LEVELS, LEVELS + 1) if level}


class TerminalView:
    """A sink whose events fade; ``picture`` shows what is left as lines of text. Any threads may use it."""

    def __init__(self, width: int, height: int, environment: Mapping[str, str] = os.environ) -> None:
        """Show a sensor of ``width`` × ``height`` pixels; the environment tells which colours the terminal has."""
        self.width, self.height = width, height
        self._lock = threading.Lock()
        self._sums: FloatImage = np.zeros((height, width))
        self._now_us = 0
        full_colour = environment.get("COLORTERM") in ("truecolor", "24bit")
        self._codes = {level: _code(colour, full_colour) for level, colour in _TABLE.items()}

    def write(self, events: EventBatch, end_us: int) -> None:
        """Add the events until ``end_us``; see Sink.write."""
        with self._lock:
            self._fade(end_us)
            if len(events):
                self._sums += signed_image(events, self.width, self.height, end_us=self._now_us, decay_us=DECAY_US)

    def close(self) -> None:
        """Do nothing: there is nothing to release."""

    def picture(self, columns: int, rows: int, now_us: int = 0) -> list[str]:
        """Return lines of text with escape codes that fill ``columns`` × ``rows`` characters, in proportion."""
        scale = min(columns / self.width, 2 * rows / self.height)
        cells = max(1, int(self.width * scale)), max(2, 2 * int(self.height * scale / 2))
        with self._lock:
            self._fade(now_us)
            left, top = (np.arange(n) * size // n for n, size in zip(cells, (self.width, self.height), strict=True))
            sums = np.add.reduceat(np.add.reduceat(self._sums, top, axis=0), left, axis=1)
        side = max(1.0, 1 / scale)
        strength = np.clip(sums / (_FULL_PER_SIDE * side), -1, 1) * LEVELS
        levels = np.where(np.abs(strength) < 0.35, 0, np.copysign(np.ceil(np.abs(strength)), strength)).astype(int)
        return [self._line(levels[k], levels[k + 1]) for k in range(0, cells[1], 2)]

    def _fade(self, now_us: int) -> None:
        if now_us > self._now_us:
            self._sums *= np.exp((self._now_us - now_us) / DECAY_US)
            self._now_us = now_us

    def _line(self, upper: npt.NDArray[np.int_], lower: npt.NDArray[np.int_]) -> str:
        """Join two rows of cells. Nothing is left to the terminal's own ground, be it dark or light."""
        parts: list[str] = []
        state = None
        for above, below in zip(upper.tolist(), lower.tolist(), strict=True):
            if above:
                ink, ground, sign = above, below, "▀"
            elif below:
                ink, ground, sign = below, 0, "▄"
            else:
                ink, ground, sign = 0, 0, " "
            if (ink, ground) != state:
                state = (ink, ground)
                codes = ["0", f"38;{self._codes[ink]}" if ink else "", f"48;{self._codes[ground]}" if ground else ""]
                parts.append(f"\x1b[{';'.join(filter(None, codes))}m")
            parts.append(sign)
        return "".join(parts) + "\x1b[0m"


class TerminalScreen:
    """Paints a view and a status line in place, again and again, below what the terminal already shows."""

    period_s = 1 / 20
    """Time between two pictures that is short enough to look like motion and long enough to cost little [s]."""

    def __init__(self, view: TerminalView, stream: TextIO) -> None:
        """Hide the cursor; ``close`` brings it back and leaves the last picture standing."""
        self._view, self._stream = view, stream
        self._painted = 0
        self._size = shutil.get_terminal_size()
        stream.write("\x1b[?25l")

    def paint(self, status: str, now_us: int = 0) -> None:
        """Paint the newest picture and a line of plain text, cut to the terminal's width."""
        size = shutil.get_terminal_size()
        lines = self._view.picture(size.columns, max(1, size.lines - 2), now_us)
        lines.append(f"\x1b[36m{status[: size.columns - 1]}\x1b[0m")
        start = f"\x1b[{self._painted}F" if self._painted else ""
        if size != self._size:  # what was painted may have been wrapped: clear it
            start = "\x1b[2J\x1b[H"
        self._size, self._painted = size, len(lines)
        # Between these two marks, terminals that know them show nothing half painted.
        self._stream.write("\x1b[?2026h" + start + "".join(f"{line}\x1b[K\n" for line in lines) + "\x1b[J\x1b[?2026l")
        self._stream.flush()

    def close(self) -> None:
        """Give the cursor back."""
        self._stream.write("\x1b[0m\x1b[?25h")
        self._stream.flush()


def suits_terminal(stream: TextIO, environment: Mapping[str, str] = os.environ) -> bool:
    """Tell whether a stream is a terminal that can show pictures and whose user wants colours."""
    return stream.isatty() and environment.get("TERM", "dumb") != "dumb" and not environment.get("NO_COLOR")


def _code(rgb: npt.NDArray[np.uint8], full_colour: bool) -> str:
    red, green, blue = (int(value) for value in rgb)
    if full_colour:
        return f"2;{red};{green};{blue}"
    cube = [min(range(6), key=lambda k: abs(_CUBE[k] - value)) for value in (red, green, blue)]
    return f"5;{16 + 36 * cube[0] + 6 * cube[1] + cube[2]}"
