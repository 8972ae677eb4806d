"""Files as public data sets and Python's programs lay them out: cameras in groups, words for polarities, floats."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from clsim.errors import InputError
from clsim.events.files import open_source
from tests.events.formats.test_columns import EVENTS, P, T, X, Y, csv, hdf5, npy, read

FEW = slice(0, 200)


def m3ed(path: Path) -> None:
    """As M3ED: columns in a group for each camera, with its size."""
    with h5py.File(path, "w") as file:
        for side, part in (("left", slice(None)), ("right", FEW)):
            group = file.create_group(f"prophesee/{side}")
            for name, column in (("t", T), ("x", X), ("y", Y), ("p", P)):
                group[name] = column[part]
            group["calib/resolution"] = (1280, 720)
        file["ovc/left/data"] = np.zeros((2, 8, 8, 1), np.uint8)


def mvsec(path: Path) -> None:
    """As MVSEC: a table of x, y, t [s] and p ±1 for each camera."""
    with h5py.File(path, "w") as file:
        for side, part in (("left", slice(None)), ("right", FEW)):
            table = np.stack([X, Y, 1.5e9 + T / 1e6, 2.0 * P - 1], axis=1)
            file[f"davis/{side}/events"] = table[part]
            file[f"davis/{side}/image_raw"] = np.zeros((2, 260, 346), np.uint8)


@pytest.mark.parametrize(
    ("write", "left", "right", "size", "start_us"),
    [
        (m3ed, "/prophesee/left", "/prophesee/right", (1280, 720), 0),
        (mvsec, "/davis/left/events", "/davis/right/events", (346, 260), 1_500_000_000_000_000),
    ],
)
def test_a_camera_of_several_is_named_behind_the_file(tmp_path, write, left, right, size, start_us):
    path = tmp_path / "a.h5"
    write(path)
    for group, part in ((left, slice(None)), (right, FEW)):
        source = open_source(f"{path}#{group}")
        assert (source.width, source.height) == size
        expected = EVENTS[part].copy()
        expected["t"] += start_us
        assert np.array_equal(source.read(), expected)
    with pytest.raises(InputError, match=f"several cameras: {left}, {right}; name one of them: '.*a.h5#{left}'"):
        open_source(path)
    with pytest.raises(InputError, match=f"has no events in /else; expected one of {left}, {right}"):
        open_source(f"{path}#/else")


def test_a_file_with_one_camera_needs_no_name_behind_it(tmp_path):
    m3ed(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "a") as file:
        del file["prophesee/right"]
    assert np.array_equal(read(tmp_path / "a.h5"), EVENTS)


def test_clsims_own_file_may_be_named_with_its_group_too(tmp_path):
    hdf5(tmp_path / "a.h5", {"t": T, "x": X, "y": Y, "p": P})
    assert np.array_equal(open_source(f"{tmp_path / 'a.h5'}#/events").read(), EVENTS)


def test_the_size_may_be_in_metavisions_attribute(tmp_path):
    hdf5(tmp_path / "a.h5", {"t": T, "x": X, "y": Y, "p": P})
    with h5py.File(tmp_path / "a.h5", "a") as file:
        file.attrs["geometry"] = "640x480"
    source = open_source(tmp_path / "a.h5")
    assert (source.width, source.height) == (640, 480)


@pytest.mark.parametrize(("on", "off"), [("True", "False"), ("true", "false"), ("TRUE", "FALSE")])
@pytest.mark.parametrize("head", ["", "t,x,y,p\n", "x,y,p,t\n"])
def test_polarities_may_be_words_of_python(tmp_path, on, off, head):
    lines = [
        f"{x},{y},{p},{t}" if head.startswith("x") else f"{t},{x},{y},{p}"
        for t, x, y, p in zip(T, X, Y, np.where(P, on, off), strict=True)
    ]
    (tmp_path / "a.csv").write_text(head + "\n".join(lines) + "\n")
    assert np.array_equal(read(tmp_path / "a.csv"), EVENTS)


@pytest.mark.parametrize("form", ["%.18e", "%.1f", "%.0f."])
def test_times_that_are_whole_floats_are_microseconds(tmp_path, form):
    """np.savetxt writes 1164 µs as 1.164000000000000000e+03, and pandas 1164.0."""
    np.savetxt(tmp_path / "a.txt", np.stack([T, X, Y, P], axis=1).astype(float), form)
    assert np.array_equal(read(tmp_path / "a.txt"), EVENTS)


@pytest.mark.parametrize("form", ["%.18e", "%.6f", "%.9f"])
def test_times_that_have_fractions_are_seconds(tmp_path, form):
    np.savetxt(tmp_path / "a.txt", np.stack([T / 1e6, X, Y, P], axis=1), [form, "%d", "%d", "%d"])
    assert np.array_equal(read(tmp_path / "a.txt"), EVENTS)


def test_few_whole_times_with_six_decimals_are_seconds(tmp_path):
    (tmp_path / "a.txt").write_text("".join(f"{k}.000000 1 2 1\n" for k in range(50)))
    assert read(tmp_path / "a.txt")["t"].tolist() == [k * 1_000_000 for k in range(50)]
    (tmp_path / "a.txt").write_text("0.0 1 2 1\n1.0 1 2 0\n")
    assert read(tmp_path / "a.txt")["t"].tolist() == [0, 1_000_000]


@pytest.mark.parametrize("write", [csv, hdf5, npy])
def test_times_of_a_clock_in_nanoseconds_are_no_microseconds(tmp_path, write):
    path = tmp_path / {csv: "a.csv", hdf5: "a.h5", npy: "a.npy"}[write]
    now_ns = 1_600_000_000 * 10**9
    write(path, {"t": now_ns + 1000 * T, "x": X, "y": Y, "p": P})
    with pytest.raises(InputError, match=rf"column t has {now_ns + 1000 * T[0]} in row 0 \(nanoseconds\?\)"):
        read(path)
    if write is csv:
        write(path, {"t_ns": now_ns + 1000 * T, "x": X, "y": Y, "p": P})
        assert np.array_equal(read(path)["t"], T + now_ns // 1000)


def evimo2(folder: Path, count: int = len(T)) -> Path:
    np.save(folder / "dataset_events_t.npy", T / 1e6)
    np.save(folder / "dataset_events_xy.npy", np.stack([X, Y], axis=1)[:count].astype(np.uint16))
    np.save(folder / "dataset_events_p.npy", P.astype(np.uint8))
    return folder / "dataset_events_t.npy"


def test_evimo2_s_three_files_are_named_by_that_of_times(tmp_path):
    assert np.array_equal(read(evimo2(tmp_path)), EVENTS)
    with pytest.raises(InputError, match=r"it has 500 times, but dataset_events_xy.npy is \[499, 2\]"):
        read(evimo2(tmp_path, 499))
    (tmp_path / "dataset_events_p.npy").unlink()
    with pytest.raises(InputError, match=r"dataset_events_p\.npy"):
        read(tmp_path / "dataset_events_t.npy")
