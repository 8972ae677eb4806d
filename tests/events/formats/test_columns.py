"""Columns of numbers become events through one door: by name, checked, or refused with column, row and value."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from clsim.errors import InputError
from clsim.events import EVENT_DTYPE, EventBatch
from clsim.events.files import open_source
from clsim.events.formats.columns import from_columns

CASES = Path(__file__).parents[4] / "shared" / "cases"
COUNT = 500
RNG = np.random.default_rng(0)
EVENTS = np.zeros(COUNT, EVENT_DTYPE)
EVENTS["t"] = np.sort(RNG.integers(0, 100_000, COUNT))
EVENTS["x"], EVENTS["y"] = RNG.integers(0, 240, COUNT), RNG.integers(0, 180, COUNT)
EVENTS["on"] = RNG.random(COUNT) < 0.5
T, X, Y, P = (EVENTS[name].astype(np.int64) for name in ("t", "x", "y", "on"))
GOOD = {"t": T, "x": X, "y": Y, "p": P}


def read(path: Path) -> EventBatch:
    return open_source(path).read()


def hdf5(path: Path, columns: dict[str, npt.NDArray[Any]]) -> None:
    with h5py.File(path, "w") as file:
        for name, column in columns.items():
            file[f"events/{name}"] = column


def parquet(path: Path, columns: dict[str, npt.NDArray[Any]]) -> None:
    import pyarrow
    import pyarrow.parquet

    pyarrow.parquet.write_table(pyarrow.table({name: list(column) for name, column in columns.items()}), path)


def csv(path: Path, columns: dict[str, npt.NDArray[Any]], between: str = ",", mark: str = "") -> None:
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    lines = [mark + between.join(columns), *(between.join(map(str, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n")


def npy(path: Path, columns: dict[str, npt.NDArray[Any]]) -> None:
    kinds = [(name, column.dtype) for name, column in columns.items()]
    np.save(path, np.array(list(zip(*columns.values(), strict=True)), kinds))


def mat(path: Path, columns: dict[str, npt.NDArray[Any]]) -> None:
    from scipy.io import savemat

    savemat(path, {"TD": {name: column.reshape(-1, 1) for name, column in columns.items()}, "other": 3})


def npz(path: Path, columns: dict[str, npt.NDArray[Any]]) -> None:
    np.savez(path, **columns)


WRITERS = {".h5": hdf5, ".npz": npz, ".csv": csv, ".parquet": parquet, ".npy": npy, ".mat": mat}
SIGNLESS = r"(\.0)? in row \d+ \(-1 without its sign\); expected 0 and 1"
WRONG = {
    "-1 without its sign": ("p", np.where(P > 0, 1, -1).astype("i1").view("u1"), rf"column p has 255{SIGNLESS}"),
    "-1 in 32 bits": ("p", np.where(P > 0, 1, -1).astype("i4").view("u4"), rf"column p has 4294967295{SIGNLESS}"),
    "-1 of 32 bits in 64": ("p", np.where(P > 0, 1, 2**32 - 1), rf"column p has 4294967295{SIGNLESS}"),
    "counts": ("p", np.arange(COUNT) % 4, r"column p has 2(\.0)? in row 2; expected 0 and 1, or -1 and 1"),
    "seconds": ("t", T * 1e-6, r"column t has .* in row \d+ \(seconds\?\); expected whole µs"),
    "negative": ("x", np.where(np.arange(COUNT) == 7, -1, X), r"column x has -1(\.0)? in row 7; expected 0 to 65535"),
    "fractions": ("y", Y + 0.5, r"column y has \d+\.5 in row 0"),
    "too large": ("x", np.where(np.arange(COUNT) == 499, 70_000, X), r"column x has 70000(\.0)? in row 499"),
    "no number": ("y", np.where(np.arange(COUNT) == 3, np.nan, Y), r"column y has nan in row 3"),
}


@pytest.mark.parametrize("ending", WRITERS)
@pytest.mark.parametrize("wrong", WRONG)
def test_what_is_no_event_is_refused_with_column_row_and_value(tmp_path: Path, ending: str, wrong: str) -> None:
    name, column, message = WRONG[wrong]
    path = tmp_path / f"a{ending}"
    WRITERS[ending](path, GOOD | {name: column})
    if ending == ".csv" and wrong == "seconds":  # text in seconds has a decimal point
        assert np.array_equal(read(path), EVENTS)
        return
    with pytest.raises(InputError, match=message) as caught:
        read(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("ending", WRITERS)
def test_rows_are_those_of_the_file_whatever_the_portions_it_is_read_in(
    tmp_path: Path, ending: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = {".h5": "hdf5", ".csv": "text"}.get(ending, ending[1:])
    name = "_CHUNK_BYTES" if ending == ".csv" else "CHUNK_EVENTS"
    monkeypatch.setattr(f"clsim.events.formats.tables.{module}.{name}", 100)
    path = tmp_path / f"a{ending}"
    WRITERS[ending](path, GOOD)
    assert np.array_equal(read(path), EVENTS)
    WRITERS[ending](path, GOOD | {"x": np.where(np.arange(COUNT) == 321, 70_000, X)})
    with pytest.raises(InputError, match=r"column x has 70000(\.0)? in row 321;"):
        read(path)


@pytest.mark.parametrize("ending", WRITERS)
@pytest.mark.parametrize("names", ["t x y p", "t y x p", "x y t p", "polarity timestamp y x", "ps ts xs ys"])
def test_columns_go_by_their_names(tmp_path: Path, ending: str, names: str) -> None:
    columns = {name: {"t": T, "x": X, "y": Y, "p": P}[name[0]] for name in names.split()}
    path = tmp_path / f"a{ending}"
    WRITERS[ending](path, columns)
    assert np.array_equal(read(path), EVENTS)


@pytest.mark.parametrize("ending", WRITERS)
@pytest.mark.parametrize("polarity", [P.astype(bool), 2 * P - 1, P.astype(np.float64), P.astype("u1")])
def test_polarity_is_0_and_1_or_minus_1_and_1_whatever_the_type(
    tmp_path: Path, ending: str, polarity: npt.NDArray[Any]
) -> None:
    path = tmp_path / f"a{ending}"
    if ending == ".csv":
        polarity = polarity.astype(np.int64)
    WRITERS[ending](path, GOOD | {"p": polarity})
    assert np.array_equal(read(path), EVENTS)


@pytest.mark.parametrize("ending", WRITERS)
def test_a_column_that_is_missing_is_named(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"a{ending}"
    WRITERS[ending](path, {"t": T, "x": X, "y": Y, "q": P})
    with pytest.raises(InputError, match=r"expected t, x, y(,| and) p"):
        read(path)


ROWS = list(zip(T, X, Y, P, strict=True))
LINES = "\n".join(f"{t},{x},{y},{p}" for t, x, y, p in zip(T, X, Y, P, strict=True)) + "\n"
SECONDS = "\n".join(f"{t * 1e-6:.6f} {x} {y} {p}" for t, x, y, p in zip(T, X, Y, P, strict=True)) + "\n"


@pytest.mark.parametrize(
    ("name", "text"),
    {
        "the size first, as e2vid has it": ("a.txt", "240 180\n" + SECONDS),
        "Windows' line ends": ("a.txt", SECONDS.replace("\n", "\r\n")),
        "a byte order mark": ("a.csv", "\ufefft,x,y,p\n" + LINES),
        "semicolons": ("a.csv", "t;x;y;p\n" + LINES.replace(",", ";")),
        "an index, as pandas has it": (
            "a.csv",
            ",t,x,y,p\n" + "".join(f"{k},{line}\n" for k, line in enumerate(LINES.splitlines())),
        ),
        "whole numbers with a point": ("a.txt", SECONDS.replace("\n", ".0\n")),
        "names in a comment": ("a.txt", "# made by hand\n# columns: t x y p\n" + LINES.replace(",", " ")),
        "a unit in the name": ("a.csv", "timestamp [us],x,y,polarity\n" + LINES),
        "ns": ("a.csv", "t_ns,x,y,p\n" + "".join(f"{t}000,{x},{y},{p}\n" for t, x, y, p in ROWS)),
        "seconds without a point": (
            "a.txt",
            "".join(f"{t}e-6 {x} {y} {p}\n" for t, x, y, p in ROWS),
        ),
        "short seconds": (
            "a.txt",
            "".join(f"{t * 1e-6:g} {x} {y} {p}\n" for t, x, y, p in zip(T, X, Y, P, strict=True)),
        ),
    }.values(),
)
def test_text_is_read_however_people_write_it(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text, encoding="utf-8", newline="")
    found = open_source(tmp_path / name)
    assert (found.width, found.height) == ((240, 180) if text.startswith("240") else (None, None))
    assert np.array_equal(found.read(), EVENTS)


@pytest.mark.filterwarnings("ignore::clsim.errors.Notice")
@pytest.mark.parametrize("mark", ["", "%geometry:240,180\n", "%geometry:240,180\nx,y,polarity,timestamp_us\n"])
@pytest.mark.parametrize("count", [1, 3, COUNT])
def test_metavisions_order_is_known_where_it_cannot_be_another(tmp_path: Path, mark: str, count: int) -> None:
    """x, y, p, t, as metavision_file_to_csv writes it; with a first line, also where t could be a polarity."""
    events = EVENTS[:count].copy()
    if mark:
        events["t"][0] = 1
    rows = events[["x", "y", "on", "t"]].tolist()
    (tmp_path / "a.csv").write_text(mark + "".join(f"{x},{y},{p:d},{t}\n" for x, y, p, t in rows) + "12,3")
    found = open_source(tmp_path / "a.csv")
    assert (found.width, found.height) == ((240, 180) if mark else (None, None))
    np.testing.assert_array_equal(found.read(), events)


@pytest.mark.parametrize("polarity", ["0", "1", "-1", "1.0", "+1"])
def test_rows_at_the_top_of_the_sensor_are_no_polarities(tmp_path: Path, polarity: str) -> None:
    (tmp_path / "a.csv").write_text(f"5,7,1,{polarity}\n6,8,0,{polarity}\n")
    found = read(tmp_path / "a.csv")
    assert (found["t"].tolist(), found["x"].tolist(), found["y"].tolist()) == ([5, 6], [7, 8], [1, 0])


@pytest.mark.parametrize(
    ("ending", "order"),
    [(ending, order) for ending in (".csv", ".txt", ".npy") for order in ((1, 2, 0, 3), (0, 2, 1))]
    + [(".npy", (1, 2, 3, 0))],
)
def test_columns_without_names_in_another_order_are_refused(
    tmp_path: Path, ending: str, order: tuple[int, ...]
) -> None:
    columns = [(T // 2, X, Y, P)[k] for k in order]  # times that could be pixels
    path = tmp_path / f"a{ending}"
    if ending == ".npy":
        np.save(path, np.stack(columns, axis=1))
    else:
        between = "," if ending == ".csv" else " "
        path.write_text("\n".join(between.join(map(str, row)) for row in zip(*columns, strict=True)))
    with pytest.raises(InputError, match=r"column|expected lines of t x y p"):
        read(path)


def test_v2e_s_own_file_and_others_are_read_by_what_they_have(tmp_path: Path) -> None:
    table = np.stack([T, X, Y, P], axis=1).astype("u4")
    records = np.array(list(zip(X, Y, 2 * P - 1, T, strict=True)), [("x", "u2"), ("y", "u2"), ("p", "i2"), ("t", "i8")])
    for name, place, data in (("v2e", "events", table), ("openeb", "CD/events", records)):
        with h5py.File(tmp_path / f"{name}.h5", "w") as file:
            file[place] = data
        assert np.array_equal(read(tmp_path / f"{name}.h5"), EVENTS)
    with h5py.File(tmp_path / "event_utils.h5", "w") as file:
        for name, column in (("ts", T * 1e-6), ("xs", X.astype("i2")), ("ys", Y.astype("i2")), ("ps", P > 0)):
            file[f"events/{name}"] = column
        file.attrs["sensor_resolution"] = (180, 240)
    source = open_source(tmp_path / "event_utils.h5")
    assert (source.width, source.height) == (240, 180) and np.array_equal(source.read(), EVENTS)
    table[3, 3] = 2**32 - 1
    with h5py.File(tmp_path / "old.h5", "w") as file:
        file["events"] = table
    with pytest.raises(InputError, match=r"column p has 4294967295 in row 3"):
        read(tmp_path / "old.h5")


@pytest.mark.skipif(not CASES.is_dir(), reason="the shared cases are not beside the checkout")
def test_the_shared_cases() -> None:
    for name, message in {
        "p_255.npz": "column p has 255 in row",
        "t_float.h5": "column t has .* in row .*whole",
        "x_neg.h5": "column x has -1 in row 5",
    }.items():
        with pytest.raises(InputError, match=message):
            read(CASES / name)
    found = read(CASES / "tyxp.csv")
    assert len(found) == 1000 and found["x"].max() == 239 and found["y"].max() == 179


KINDS = [np.int8, np.uint8, np.int16, np.uint16, np.int64, np.uint64, np.float32, np.float64, np.bool_]
NUMBERS = st.sampled_from(KINDS)


@settings(deadline=None, max_examples=200)
@given(st.integers(0, 12).flatmap(lambda n: st.tuples(*[NUMBERS.flatmap(lambda kind: hnp.arrays(kind, n))] * 4)))
def test_any_columns_are_events_or_one_sentence(columns: tuple[npt.NDArray[Any], ...]) -> None:
    try:
        found = from_columns(*columns)
    except ValueError as error:
        assert "\n" not in str(error) and "column" in str(error)
        return
    for name, column in zip(("t", "x", "y"), columns, strict=False):
        assert [int(value) for value in column] == found[name].tolist()
    assert [int(value) == 1 for value in columns[3]] == found["on"].tolist()


@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.sampled_from(["t,x,y,p", "p,y,x,t", "# t x y p", "240 180", ""]),
    st.lists(st.lists(st.one_of(st.integers(-3, 300), st.floats(width=16)), min_size=3, max_size=5), max_size=12),
    st.sampled_from([",", " ", ";", "\t"]),
)
def test_any_table_of_text_is_events_in_order_or_one_sentence(
    tmp_path: Path, head: str, rows: list[list[float]], between: str
) -> None:
    path = tmp_path / "a.txt"
    path.write_text(head + "\n" + "".join(between.join(map(str, row)) + "\n" for row in rows))
    try:
        found = read(path)
    except InputError as error:
        assert str(path) in str(error) and "\n" not in str(error)
        return
    assert (np.diff(found["t"]) >= 0).all() and (found["t"] >= 0).all() and len(found) <= len(rows)


@pytest.mark.parametrize("mark", ["_{}", " [{}]", " ({})"])
@pytest.mark.parametrize(
    ("units", "per_s"),
    [(("s", "sec", "seconds"), 1), (("ms",), 10**3), (("us", "µs", "usec"), 10**6), (("ns", "nsec"), 10**9)],
)
def test_a_units_name_tells_how_many_of_it_are_a_second(
    tmp_path: Path, mark: str, units: tuple[str, ...], per_s: int
) -> None:
    """Times of 0, 2 and 3.000004 s; in the coarse units as numbers with a point."""
    times_us = [0, 2_000_000, 3_000_004]
    told = [f"{t * per_s / 10**6:.6f}" if per_s < 10**6 else f"{t * per_s // 10**6}" for t in times_us]
    for unit in units:
        (tmp_path / "a.csv").write_text(f"timestamp{mark.format(unit)},x,y,p\n" + "".join(f"{t},1,2,1\n" for t in told))
        assert read(tmp_path / "a.csv")["t"].tolist() == times_us, unit


def test_hdf5_columns_may_lie_in_no_group(tmp_path):
    """As in the EDS data set: p, t, x, y at the top, beside the index of milliseconds."""
    with h5py.File(tmp_path / "events.h5", "w") as file:
        for name, column in {**GOOD, "ms_to_idx": np.arange(100)}.items():
            file[name] = column
    np.testing.assert_array_equal(read(tmp_path / "events.h5"), EVENTS)


def test_an_archive_may_hold_one_array_with_fields(tmp_path):
    """As in N-ImageNet: `event_data` with x, y, t, p."""
    kinds = [("x", "<u2"), ("y", "<u2"), ("t", "<i8"), ("p", "?")]
    table = np.array(list(zip(X, Y, T, P, strict=True)), kinds)
    np.savez_compressed(tmp_path / "a.npz", event_data=table)
    np.testing.assert_array_equal(read(tmp_path / "a.npz"), EVENTS)
    for wrong in (table[["x", "y", "t"]], np.zeros((4, 5)), np.zeros(3), np.array(["a"]), np.zeros(2, [("t", "O")])):
        np.savez(tmp_path / "a.npz", allow_pickle=True, event_data=wrong)
        with pytest.raises(InputError, match="expected"):
            read(tmp_path / "a.npz")
