import io
import os
import re
from types import SimpleNamespace

import numpy as np
import pytest

from clsim.events import EVENT_DTYPE, EventBatch
from clsim.live.view import terminal
from clsim.live.view.terminal import TerminalScreen, TerminalView, suits_terminal
from tests.events.event_data import end_of

FULL_COLOUR = {"COLORTERM": "truecolor"}


def cells(lines: list[str]) -> list[list[tuple[str, str, str]]]:
    """Read lines as a terminal does: (character, colour of ink, colour of ground) a cell."""
    screen = []
    for line in lines:
        row, ink, ground = [], "", ""
        for codes, character in re.findall(r"\x1b\[([0-9;]*)m|([^\x1b])", line):
            if character:
                row.append((character, ink, ground))
                continue
            for code in re.findall(r"[34]8;(?:2;\d+;\d+;\d+|5;\d+)|\d+", codes):
                if code == "0":
                    ink = ground = ""
                elif code.startswith("38"):
                    ink = code[3:]
                else:
                    assert code.startswith("48")
                    ground = code[3:]
        screen.append(row)
    return screen


def pixels(lines: list[str]) -> list[list[str]]:
    """Colours of the upper and the lower halves, row by row; empty where nothing is."""
    rows = []
    for row in cells(lines):
        assert {character for character, _, _ in row} <= set(" ▀▄")
        rows.append([ink if character == "▀" else ground for character, ink, ground in row])
        rows.append([ink if character == "▄" else ground for character, ink, ground in row])
    return rows


def many(x: int, y: int, on: bool, t: int = 0, count: int = 50) -> EventBatch:
    batch = np.zeros(count, EVENT_DTYPE)
    batch["t"], batch["x"], batch["y"], batch["on"] = t, x, y, on
    return batch


@pytest.mark.parametrize("name", ["truecolor", "24bit"])
def test_events_appear_where_they_are_and_in_their_colour(name: str) -> None:
    view = TerminalView(8, 6, {"COLORTERM": name})
    events = [(0, 0, True), (7, 0, False), (3, 2, True), (3, 3, False), (7, 5, True)]
    for x, y, on in events:
        view.write(many(x, y, on), end_of(many(x, y, on)))
    seen = pixels(view.picture(8, 3))
    on_colour, off_colour = (";".join(["2", *map(str, terminal._TABLE[level])]) for level in (4, -4))
    expected = [[""] * 8 for _ in range(6)]
    for x, y, on in events:
        expected[y][x] = on_colour if on else off_colour
    assert seen == expected


@pytest.mark.parametrize(("columns", "rows"), [(80, 24), (20, 40), (7, 3), (300, 2), (1, 1)])
def test_pictures_fit_and_keep_their_proportions(columns: int, rows: int) -> None:
    view = TerminalView(120, 90, FULL_COLOUR)
    picture = cells(view.picture(columns, rows))
    assert 1 <= len(picture) <= rows and {len(row) for row in picture} == {len(picture[0])}
    assert len(picture[0]) <= columns
    if min(columns, rows) > 2:
        assert len(picture[0]) / (2 * len(picture)) == pytest.approx(120 / 90, rel=0.35)


def test_old_events_fade_and_vanish() -> None:
    view = TerminalView(2, 2, FULL_COLOUR)
    view.write(many(0, 0, True, t=1000, count=2), end_of(many(0, 0, True, t=1000, count=2)))
    strong = pixels(view.picture(2, 1, now_us=1000))[0][0]
    weak = pixels(view.picture(2, 1, now_us=1000 + int(1.5 * terminal.DECAY_US)))[0][0]
    assert pixels(view.picture(2, 1))[0][0] == weak, "what has faded does not come back"
    gone = pixels(view.picture(2, 1, now_us=1000 + 5 * int(terminal.DECAY_US)))[0][0]
    assert strong != weak != "" and gone == ""
    # Three events that fade here are as strong as three that were that old when they came.
    here, there = (TerminalView(2, 2, FULL_COLOUR) for _ in range(2))
    here.write(many(0, 0, True, count=3), 0)
    there.write(many(0, 0, True, count=3), 20_000)
    assert here.picture(2, 1, now_us=20_000) == there.picture(2, 1, now_us=20_000)


def test_terminals_with_256_colours_get_those() -> None:
    view = TerminalView(2, 2, {})
    view.write(many(0, 0, True), end_of(many(0, 0, True)))
    view.write(many(1, 1, False), end_of(many(1, 1, False)))
    seen = pixels(view.picture(2, 1))
    assert re.fullmatch(r"5;\d+", seen[0][0]) and re.fullmatch(r"5;\d+", seen[1][1]) and seen[0][0] != seen[1][1]
    assert all(16 <= int(code[2:]) <= 231 for code in (seen[0][0], seen[1][1]))


def test_each_of_256_colours_is_the_nearest_that_there_is() -> None:
    """Of the cube behind the first 16: red changes slowest, and its steps are these in all terminals."""
    steps = np.array([0, 95, 135, 175, 215, 255])
    for value in range(256):
        for k in range(3):
            colour = np.roll([value, 128, 255], k).astype(np.uint8)
            number = int(terminal._code(colour, False).removeprefix("5;")) - 16
            shown = steps[[number // 36, number // 6 % 6, number % 6]]
            nearest = np.abs(steps - colour[:, None].astype(int)).min(axis=1)
            assert np.array_equal(np.abs(shown - colour.astype(int)), nearest), (colour, shown)


def test_a_screen_is_painted_over_itself_and_gives_the_cursor_back(monkeypatch: pytest.MonkeyPatch) -> None:
    # Not in shutil itself: pytest asks it too.
    size = os.terminal_size((40, 12))
    monkeypatch.setattr(terminal, "shutil", SimpleNamespace(get_terminal_size=lambda: size))
    stream = io.StringIO()
    screen = TerminalScreen(TerminalView(20, 10, FULL_COLOUR), stream)
    screen.paint("a status line that is longer than forty columns are wide", 0)
    first = stream.getvalue()
    screen.paint("second", 0)
    second = stream.getvalue()[len(first) :]
    size = os.terminal_size((30, 12))
    screen.paint("third", 0)
    screen.close()
    assert stream.getvalue().count("\x1b[2J\x1b[H") == 1 and "\x1b[2J" not in first + second, "cleared when resized"
    assert first.count("\n") <= 11 and "than forty" in first and "columns" not in first
    assert f"\x1b[{first.count(chr(10))}F" in second
    assert stream.getvalue().startswith("\x1b[?25l") and stream.getvalue().endswith("\x1b[?25h")


@pytest.mark.parametrize(
    ("tty", "environment", "suits"),
    [
        (True, {"TERM": "xterm"}, True),
        (False, {"TERM": "xterm"}, False),
        (True, {"TERM": "dumb"}, False),
        (True, {}, False),
        (True, {"TERM": "xterm", "NO_COLOR": "1"}, False),
    ],
)
def test_which_terminals_get_pictures(tty: bool, environment: dict[str, str], suits: bool) -> None:
    stream = io.StringIO()
    stream.isatty = lambda: tty  # type: ignore[method-assign]
    assert suits_terminal(stream, environment) is suits
