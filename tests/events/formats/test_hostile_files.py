"""Files from strangers: whatever their bytes, there are events or one InputError, in bounded time and memory."""

import contextlib
import io
import tracemalloc
import zipfile
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from clsim.errors import InputError
from clsim.events.files import open_source
from clsim.events.sidecar import read_sidecar, sidecar_path, sidecar_size
from clsim.events.sockets.address import parse_address
from tests.events.event_data import ENDINGS, HEIGHT, WIDTH, events, read, write

pytestmark = pytest.mark.filterwarnings("ignore::clsim.errors.Notice")

edits = st.lists(st.tuples(st.floats(0, 1), st.binary(min_size=0, max_size=8), st.integers(0, 8)), max_size=6)


@cache
def whole(folder: Path, ending: str) -> bytes:
    return write(folder / f"whole{ending}", [events(60)]).read_bytes()


def spoilt(data: bytes, changes: list[tuple[float, bytes, int]]) -> bytes:
    """Return the data with some bytes at some places replaced by others, more or fewer."""
    for place, new, old in changes:
        at = int(place * len(data))
        data = data[:at] + new + data[at + old :]
    return data


@pytest.mark.parametrize("ending", ENDINGS)
@settings(deadline=None, max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(changes=edits)
def test_any_damage_is_one_sentence_or_harmless(
    tmp_path: Path, ending: str, changes: list[tuple[float, bytes, int]]
) -> None:
    path = tmp_path / f"a{ending}"
    path.write_bytes(spoilt(whole(tmp_path, ending), changes))
    try:
        with open_source(path) as source:
            for batch in source:
                assert (batch["t"][1:] >= batch["t"][:-1]).all()
                for axis, size in (("x", source.width), ("y", source.height)):
                    assert size is None or batch[axis].max() < size
    except InputError as error:
        assert str(path) in str(error) and "\n" not in str(error)


@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(text=st.text(st.sampled_from("0123456789 .,-+e\n#\ttxyp\0\x85é"), max_size=80))
def test_any_text_is_read_or_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(text.encode())
    with contextlib.suppress(InputError):
        read(path)


def npy(descr: object, shape: tuple[int, ...], body: bytes = b"") -> bytes:
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, {"descr": descr, "fortran_order": False, "shape": shape})
    return file.getvalue() + body


@pytest.mark.parametrize(
    ("descr", "shape"),
    [
        ("|V1000000000", (4,)),
        pytest.param("<U100000000", (4,), marks=pytest.mark.slow),
        ("<i8", (1 << 60,)),
        pytest.param("<i8", (1 << 40, 1), marks=pytest.mark.slow),
        pytest.param("|O", (4,), marks=pytest.mark.slow),
    ],
)
def test_an_archive_that_claims_much_costs_little(tmp_path: Path, descr: str, shape: tuple[int, ...]) -> None:
    path = tmp_path / "a.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in "txyp":
            archive.writestr(f"{name}.npy", npy(descr, shape, bytes(50_000_000)))
    tracemalloc.start()
    try:
        with pytest.raises(InputError), open_source(path) as source:
            assert sum(map(len, source)) == 50_000_000 // 8
        assert tracemalloc.get_traced_memory()[1] < 30_000_000
    finally:
        tracemalloc.stop()


def test_an_archive_whose_arrays_all_end_at_the_same_row_too_early_is_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        for name in "txyp":
            archive.writestr(f"{name}.npy", npy("<i8", (5,), bytes(4 * 8)))
    with pytest.raises(InputError, match="its array t ends early"):
        read(tmp_path / "a.npz")


@settings(deadline=None)
@given(st.text(max_size=40).map(lambda text: "tcp://" + text) | st.text(max_size=40))
def test_any_address_is_taken_apart_or_refused(text: str) -> None:
    with contextlib.suppress(InputError):
        assert parse_address(text).text == text


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.binary(max_size=60) | st.sampled_from([b'{"camera": {"width": 1e400, "height": 3}}', b"1e400"]))
def test_any_sidecar_tells_a_size_or_none(tmp_path: Path, content: bytes) -> None:
    path = sidecar_path(tmp_path / "a.raw")
    assert path is not None
    path.write_bytes(content)
    assert sidecar_size(read_sidecar(tmp_path / "a.raw")) is None


def test_a_sidecar_that_nests_deeply_tells_nothing(tmp_path: Path) -> None:
    (tmp_path / "a.raw.json").write_bytes(b"[" * 100_000)
    assert read_sidecar(tmp_path / "a.raw") == {}


def test_the_undamaged_files_hold_their_events(tmp_path: Path) -> None:
    for ending in ENDINGS:
        path = tmp_path / f"a{ending}"
        path.write_bytes(whole(tmp_path, ending))
        assert np.array_equal(read(path), events(60)) and (WIDTH, HEIGHT) == (346, 260)
