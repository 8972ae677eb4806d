"""Files of times."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from clsim.errors import InputError
from clsim.footage.times import read_times_us

_UNITS = {"s": 1_000_000, "ms": 1000, "us": 1, "ns": Fraction(1, 1000)}


@given(
    st.lists(st.integers(0, 10**12), min_size=1, max_size=20, unique=True),
    st.sampled_from(["s", "ms", "us", "ns"]),
    st.sampled_from(" ,;\t"),
)
def test_text_is_read_exactly(tmp_path_factory, times_us, unit, between):
    # Seconds with 6 digits after the point have more than a double holds.
    path = tmp_path_factory.mktemp("times") / "a.txt"
    lines = []
    for time_us in sorted(times_us):
        number = Fraction(time_us) / _UNITS[unit]
        digits = {"s": 6, "ms": 3, "us": 0, "ns": 0}[unit]
        whole, rest = divmod(number, 1)
        lines.append(f"{whole}" + (f".{int(rest * 10**digits):0{digits}d}" if digits else "") + f"{between}frame.png")
    path.write_text("# time file\n" + "\n".join(lines) + "\n\n")
    assert read_times_us(path, unit) == sorted(times_us)


@given(st.integers(0, 10**9), st.integers(0, 6), st.integers(-3, 6))
def test_powers_of_ten_are_read_exactly_with_and_without_a_point(tmp_path_factory, number, digits, power):
    """As programs write times: 1.6e+09 is as 1600000000."""
    path = tmp_path_factory.mktemp("times") / "a.txt"
    whole, rest = divmod(number, 10**digits)
    path.write_text(f"{whole}" + (f".{rest:0{digits}d}" if digits else "") + f"e{power:+03d} frame.png\n")
    exact = Fraction(number) * Fraction(10) ** (power - digits) * 1000
    (found,) = read_times_us(path, "ms")
    assert abs(found - exact) <= Fraction(1, 2)


@given(st.binary(max_size=200))
def test_any_bytes_are_times_or_one_sentence(tmp_path_factory, data):
    for name in ("a.txt", "a.npy"):
        path = tmp_path_factory.mktemp("times") / name
        path.write_bytes(data)
        try:
            assert all(isinstance(time, int) for time in read_times_us(path, "s"))
        except InputError as error:
            assert str(path) in str(error)


@pytest.mark.parametrize(("unit", "per_us"), [("s", 1e-6), ("ms", 1e-3), ("us", 1.0), ("ns", 1e3)])
def test_arrays_of_floating_point_are_rounded_to_the_nearest_microsecond(tmp_path, unit, per_us):
    np.save(tmp_path / "a.npy", np.array([0.4, 1.6, 33_300.0, 99_999.9, 1e9 + 0.2]) * per_us)
    assert read_times_us(tmp_path / "a.npy", unit) == [0, 2, 33_300, 100_000, 1_000_000_000]


@pytest.mark.parametrize("text", ["", "x", "1\n1", "1e99", "1.5.2", ".", "nan", "inf", "--3", "1e9999999999", "0x10"])
def test_what_is_no_time(tmp_path, text):
    (tmp_path / "a.txt").write_text(text)
    with pytest.raises(InputError):
        read_times_us(tmp_path / "a.txt", "s")


def test_a_file_that_is_no_text_is_told_in_words(tmp_path):
    (tmp_path / "a.npz").write_bytes(b"PK\x03\x04\0\0")
    with pytest.raises(InputError, match=r"a\.npz: is no text; expected times of frames, one a line, or a \.npy array"):
        read_times_us(tmp_path / "a.npz", "s")


def test_a_byte_order_mark_before_the_first_time_is_passed_over(tmp_path):
    (tmp_path / "a.txt").write_bytes("1.5\n2.5\n".encode("utf-8-sig"))
    assert read_times_us(tmp_path / "a.txt", "ms") == [1500, 2500]


@pytest.mark.parametrize(("text", "us"), [(".5", 500_000), ("5.", 5_000_000), ("+1.25", 1_250_000), ("0", 0)])
def test_a_number_needs_digits_on_one_side_of_its_point_alone(tmp_path, text, us):
    (tmp_path / "a.txt").write_text(f"{text}\n")
    assert read_times_us(tmp_path / "a.txt", "s") == [us]


@pytest.mark.parametrize("text", ["-5", "-0.25", "-1e-3", "-5\n-4", "-1\n0\n1"])
@pytest.mark.parametrize("unit", _UNITS)
def test_times_before_0_are_refused_as_what_they_are(tmp_path, text, unit):
    """In text and in arrays alike; what rounds to 0 is 0."""
    (tmp_path / "a.txt").write_text(text)
    numbers = [Fraction(line) for line in text.splitlines()]
    np.save(tmp_path / "a.npy", np.array([float(number) for number in numbers]))
    first = round(numbers[0] * _UNITS[unit])
    for name in ("a.txt", "a.npy"):
        if first == 0 and len(numbers) == 1:
            assert read_times_us(tmp_path / name, unit) == [0]
            continue
        with pytest.raises(InputError, match=f"the first time is {first} µs|expected later than"):
            read_times_us(tmp_path / name, unit)
