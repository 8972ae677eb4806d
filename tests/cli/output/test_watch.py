"""Where a run can be watched."""

from __future__ import annotations

import io
import sys
import threading
import webbrowser

import pytest

from clsim.cli.output.watch import announce


class Screen(io.StringIO):
    """A terminal."""

    def isatty(self) -> bool:
        """It is one."""
        return True


@pytest.mark.parametrize(
    ("stream", "there", "opens"),
    [
        (Screen, {"DISPLAY"}, True),
        (Screen, {"WAYLAND_DISPLAY"}, True),
        (Screen, {"DISPLAY", "SSH_CONNECTION"}, False),
        (Screen, set(), False),
        (io.StringIO, {"DISPLAY"}, False),
    ],
)
def test_a_page_opens_by_itself_for_who_sits_at_a_screen(
    monkeypatch: pytest.MonkeyPatch, stream: type[io.StringIO], there: set[str], opens: bool
) -> None:
    """Over SSH it would open on a screen that its user does not see."""
    opened: list[str] = []
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SSH_CONNECTION"):
        (monkeypatch.setenv(name, ":0") if name in there else monkeypatch.delenv(name, raising=False))
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(sys, "stderr", stream())
    monkeypatch.setattr(webbrowser, "open", opened.append)
    monkeypatch.setattr(threading.Thread, "start", threading.Thread.run)
    announce("http://127.0.0.1:8787/")
    assert opened == ["http://127.0.0.1:8787/"] * opens
