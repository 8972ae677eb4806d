"""Text and columns that could mean several things: they are read by what they say, or refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from clsim.errors import InputError
from clsim.events.files import open_source
from clsim.events.formats.columns import from_columns


@pytest.mark.parametrize(
    ("units", "us"),
    [
        (("second", "secs"), 1_000_000),
        (("msec", "millis", "millisecond", "Milliseconds"), 1000),
        (("microsec", "microsecond", "Microseconds", "\u03bcs", "\u00b5s"), 1),
    ],
)
@pytest.mark.parametrize("mark", ["t [{}]", "t_{}", "timestamp ({})"])
def test_a_unit_may_be_written_out(tmp_path: Path, mark: str, units: tuple[str, ...], us: int) -> None:
    for unit in units:
        (tmp_path / "a.csv").write_text(f"{mark.format(unit)},x,y,p\n0,1,2,1\n4000,1,2,0\n", encoding="utf-8")
        assert open_source(tmp_path / "a.csv").read()["t"].tolist() == [0, 4000 * us]
    for unit in ("nanosec", "nanosecond", "Nanoseconds"):
        (tmp_path / "a.csv").write_text(f"{mark.format(unit)},x,y,p\n0,1,2,1\n4000,1,2,0\n")
        assert open_source(tmp_path / "a.csv").read()["t"].tolist() == [0, 4]


def test_microseconds_in_latin_1_are_microseconds(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(b"t [\xb5s],x,y,p\n4000,1,2,1\n")
    assert open_source(tmp_path / "a.csv").read()["t"].tolist() == [4000]


@pytest.mark.parametrize("name", ["t [ticks]", "timestamp (10 us)", "t [1e-6 s]", "time [min]"])
def test_a_unit_that_is_not_known_is_refused_and_not_taken_for_microseconds(tmp_path: Path, name: str) -> None:
    (tmp_path / "a.csv").write_text(f"x,{name},y,p\n1,4000,2,1\n")
    with pytest.raises(
        InputError, match="names t in a unit that is not known: .*; expected s, ms, us or ns"
    ):
        open_source(tmp_path / "a.csv").read()


@pytest.mark.parametrize("end", ["\r", "\u2028", "\x0b"])
def test_lines_that_end_in_another_way_are_not_passed_over_with_the_names(tmp_path: Path, end: str) -> None:
    lines = ["t,x,y,p", *(f"{1000 * k},1,2,1" for k in range(20))]
    (tmp_path / "a.csv").write_text(end.join(lines) + end, encoding="utf-8", newline="")
    with pytest.raises(InputError, match=r"a\.csv: "):
        open_source(tmp_path / "a.csv").read()


def test_polarities_of_three_kinds_are_refused() -> None:
    """0 is a fall beside 1, and no polarity beside -1."""
    row = np.arange(4)
    for polarity in ([0, -1, 0, -1], [1, -1, 0, 1]):
        with pytest.raises(InputError, match="column p has both 0 and -1; expected 0 and 1, or -1 and 1"):
            from_columns(row, row, row, np.array(polarity))
    for fine, on in (([-1, 1, 1, -1], [0, 1, 1, 0]), ([0, 0, 0, 0], [0] * 4), ([-1, -1, -1, -1], [0] * 4)):
        assert from_columns(row, row, row, np.array(fine))["on"].tolist() == on
