"""Measured points on disk, one JSON object a line, so that an interrupted sweep goes on where it stopped."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any


class PointStore:
    """An append-only file of figures by key; whole lines survive whatever ends the program."""

    def __init__(self, path: Path) -> None:
        """Read what is there. A line that was cut short, as by a kill, is left out and measured again."""
        self.path = path
        self._figures: dict[str, dict[str, Any]] = {}
        text = path.read_text() if path.exists() else ""
        self._torn = text != "" and not text.endswith("\n")
        for line in text.splitlines():
            try:
                entry = json.loads(line)
                self._figures[entry["key"]] = entry["figures"]
            except (ValueError, KeyError, TypeError):
                continue

    def __contains__(self, key: str) -> bool:
        """Tell whether a key's figures are there."""
        return key in self._figures

    def __getitem__(self, key: str) -> dict[str, Any]:
        """Return the figures of a key; KeyError if there are none."""
        return self._figures[key]

    def append(self, key: str, figures: dict[str, Any]) -> None:
        """Add figures and wait until they are on the disk."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self.path.open("a") as file:
            file.write(("\n" if self._torn else "") + json.dumps({"key": key, "figures": figures}) + "\n")
            file.flush()
            os.fsync(file.fileno())
        self._torn = False
        self._figures[key] = figures
