from collections.abc import Callable

import pytest

from clsim.cli.commands.bench_tradeoff import parse_seeds
from clsim.cli.commands.detect import _features
from clsim.cli.options import parse
from clsim.errors import InputError


@pytest.mark.parametrize(
    ("text", "seconds"), [("2s", 2.0), ("500ms", 0.5), ("2", 2.0), ("1.5 min", 90.0), ("250us", 250e-6), ("3µs", 3e-6)]
)
def test_durations(text: str, seconds: float) -> None:
    assert parse.duration_s(text) == pytest.approx(seconds)


@pytest.mark.parametrize("text", ["", "s", "-1s", "0", "nan", "inf", "2h", "1e999"])
def test_wrong_durations(text: str) -> None:
    with pytest.raises(InputError, match="--duration must be a positive time"):
        parse.duration_s(text)


def test_resolutions() -> None:
    assert parse.resolution("346x260") == parse.resolution("346 X 260") == (346, 260)
    for text in ("0x10", "10x0", "10", "x", "-1x5", "1e3x4", "10x10x10"):
        with pytest.raises(InputError, match="WIDTHxHEIGHT"):
            parse.resolution(text)


def test_thresholds() -> None:
    assert parse.threshold("0.2") == (0.2, 0.2)
    assert parse.threshold("0.2,0.25") == (0.2, 0.25)
    for text in ("-0.1", "0", "a", "0.1,0.2,0.3", "nan", "0.2,", "inf"):
        with pytest.raises(InputError, match="--threshold must be one or two positive numbers"):
            parse.threshold(text)


@pytest.mark.parametrize(("unit", "per_us"), [("us", 1), ("µs", 1), ("ms", 10**3), ("s", 10**6)])
def test_windows_are_whole_microseconds_however_they_are_told(unit: str, per_us: int) -> None:
    """8.19 ms are 8190 µs, though 1e6 · 0.00819 is a little less."""
    for window_us in (1, 3, 29, 57, 290, 1_001, 4_350, 8_190, 1_150_000):
        told = f"{window_us / per_us:.6f}{unit}"
        assert parse.windows_us(told, "--within") == (window_us,)


def test_several_windows_are_each_taken_once_and_the_smallest_first() -> None:
    assert parse.windows_us("3ms,300us,0.3ms,1ms", "--within") == (300, 1_000, 3_000)
    for text in ("0.4us", "1ms,0.4us"):
        with pytest.raises(InputError, match="--within must be times of at least 1us"):
            parse.windows_us(text, "--within")


@pytest.mark.parametrize(
    ("read", "text"),
    [
        (parse.threshold, "0.2,0.25"),
        (parse.names, "depth,flow"),
        (parse_seeds, "0,1,2"),
        (_features, "Depth,Nx"),
        (lambda text: parse.windows_us(text, "--within"), "1ms,3ms"),
        (lambda text: parse.numbers(text, "--lux"), "0.5,2,10"),
    ],
)
def test_spaces_in_a_list_change_nothing(read: Callable[[str], object], text: str) -> None:
    """As people write lists: behind a comma, before it, or around the whole."""
    assert read(text.replace(",", ", ")) == read(text.replace(",", " , ")) == read(f" {text} ") == read(text)
