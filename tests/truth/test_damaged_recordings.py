"""Recordings with truth that are damaged or were made to do harm: each ends in one sentence."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path

import h5py
import numpy as np
import pytest
from PIL import Image

from clsim.cli.commands.convert import convert
from clsim.errors import InputError, Notice
from clsim.events.files import open_source
from clsim.truth.layouts import open_layout
from clsim.truth.recording import convert_recording, read_recording
from tests.truth import recordings


def recorded(path: Path) -> None:
    recordings.feed(open_layout(str(path), recordings.about()))


def test_a_damaged_recording_is_told_in_a_sentence(tmp_path: Path) -> None:
    recorded(tmp_path / "a.dsec")
    (tmp_path / "a.dsec/flow/forward/000002.png").write_bytes(b"\x89PNG\r\n\x1a\nrubbish")
    with pytest.raises(InputError, match=r"000002\.png: is no PNG"):
        convert_recording(str(tmp_path / "a.dsec"), str(tmp_path / "b.h5"))
    (tmp_path / "a.dsec/calibration/cam_to_cam.yaml").write_text("nothing: here\n")
    with pytest.raises(InputError, match=r"a\.dsec: is damaged or of another format \(.*has no resolution"):
        convert_recording(str(tmp_path / "a.dsec"), str(tmp_path / "b.h5"))
    recorded(tmp_path / "a.ecd")
    (tmp_path / "a.ecd/images.txt").write_text("0.0 ../../secret.png\n")
    with pytest.raises(InputError, match="expected a time and a file beside"):
        convert_recording(str(tmp_path / "a.ecd"), str(tmp_path / "b.h5"))
    assert not (tmp_path / "b.h5").exists()


def test_a_picture_of_dsec_that_no_line_tells_of_yet_is_left_out(tmp_path: Path) -> None:
    """A run that is killed has written its last picture before the line."""
    recorded(tmp_path / "a.dsec")
    text = tmp_path / "a.dsec/disparity/timestamps.txt"
    whole = [shot for shot in read_recording(str(tmp_path / "a.dsec")).shots() if "depth" in shot.planes]
    text.write_text("".join(text.read_text().splitlines(keepends=True)[:-1]))
    cut = [shot for shot in read_recording(str(tmp_path / "a.dsec")).shots() if "depth" in shot.planes]
    assert [shot.time_us for shot in cut] == [shot.time_us for shot in whole[:-1]] != []


def test_whatever_is_wrong_with_a_recording_is_one_sentence(tmp_path: Path) -> None:
    recorded(tmp_path / "a.tumvie")
    calibration, images = (tmp_path / "a.tumvie" / name for name in ("camera-calibration.json", "left_images"))
    told = calibration.read_text()
    value = json.loads(told)["value0"]
    for wrong in (
        "[]",
        '{"value0": {"intrinsics": []}}',
        '{"value0": []}',
        json.dumps({"value0": value | {"resolution": [[0, 9]]}}),
    ):
        calibration.write_text(wrong)
        with pytest.raises(InputError, match=r"a\.tumvie: is damaged or of another format"):
            read_recording(str(tmp_path / "a.tumvie"))
    calibration.write_text(told)
    Image.fromarray(np.zeros((9, 9), np.uint8)).save(images / "00001.jpg")
    with pytest.raises(InputError, match=r"image at \d+ µs is \[9, 9\], expected \[16, 24\]"):
        convert_recording(str(tmp_path / "a.tumvie"), str(tmp_path / "b.h5"))
    assert not (tmp_path / "b.h5").exists()
    recorded(tmp_path / "c.h5")
    with h5py.File(tmp_path / "c.h5", "r+") as file:
        camera = json.loads(file.attrs["camera"])
        file.attrs["camera"] = json.dumps({"intrinsics_px": camera["intrinsics_px"], "model": "perspective"})
    with pytest.raises(InputError, match="needs the camera's intrinsics"):
        convert_recording(str(tmp_path / "c.h5"), str(tmp_path / "d.tumvie"))


def test_files_that_claim_more_than_they_hold_are_told(tmp_path: Path) -> None:
    home = tmp_path / "a.mvsec"
    recorded(home)
    with h5py.File(home / "a_gt.hdf5", "r+") as file:
        del file["davis/left/flow_dist"]
    flow = np.zeros((1, recordings.HEIGHT, recordings.WIDTH))
    told = home / "a_gt_flow_dist.npz"
    np.savez(told, timestamps=np.arange(5) * 0.1, x_flow_dist=flow, y_flow_dist=flow)
    recording = read_recording(str(home))
    with pytest.raises(InputError, match="5 times of flow, but fewer frames"):
        list(recording.shots())
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
    with zipfile.ZipFile(told, "w") as archive:
        archive.writestr("timestamps.npy", head.getvalue())
    with pytest.raises(InputError, match="0 timestamps, but tells of"):
        read_recording(str(home))
    with h5py.File(home / "a_data.hdf5", "r+") as file:
        del file["davis/left/image_raw_ts"]
        file.create_dataset("davis/left/image_raw_ts", (10**12,), "f8", chunks=(1024,))
    with pytest.raises(InputError, match="has 8000000000000 bytes"):
        read_recording(str(home))
    recorded(tmp_path / "b.h5")
    with h5py.File(tmp_path / "b.h5", "r+") as file:
        del file["frames/depth"]
        file.create_dataset("frames/depth", (4, 1 << 16, 1 << 16), "f4", chunks=(1, 16, 16))
    with pytest.raises(InputError, match="frames/depth has 17179869184 bytes"):
        next(read_recording(str(tmp_path / "b.h5")).shots())


@pytest.mark.parametrize(
    ("place", "value", "told"),
    [
        ("events/ts", np.zeros((5, 2)), "events have the shapes"),
        ("events/ts", np.zeros(1), "events have the shapes"),
        ("events/ts", np.nan, "a time is not finite"),
        ("events/ts", 1e300, "a time is not finite or too late"),
        ("events/ts", -1.0, "not in the order of time"),
        ("events/xs", -5, "outside the sensor's 24x16 pixels"),
        ("events/ys", 16, "outside the sensor's 24x16 pixels"),
        ("images/image000000001", np.zeros((16, 24)), "holds float64, expected uint8"),
    ],
)
def test_event_utils_takes_no_events_that_cannot_be(tmp_path: Path, place: str, value: object, told: str) -> None:
    home = tmp_path / "a.event_utils"
    recorded(home)
    with h5py.File(home / "a.h5", "r+") as file:
        column, told_of = file[place][:], dict(file[place].attrs)
        if np.ndim(value):
            column = value
        else:
            column[len(column) // 2] = value
        del file[place]
        file[place] = column
        file[place].attrs.update(told_of)
    with pytest.raises(InputError, match=rf"\A[^\n]*a\.event_utils: is damaged or of another format \(.*{told}"):
        convert_recording(str(home), str(tmp_path / "b.h5"))
    assert not (tmp_path / "b.h5").exists()


@pytest.mark.parametrize("ending", [".ecd", ".dsec"])
def test_events_of_a_recording_that_are_out_of_order_are_told_and_refused_if_strict(
    tmp_path: Path, ending: str
) -> None:
    """As of event files: one that is a little late is moved, one that is late by seconds is left out."""
    home, target = tmp_path / f"a{ending}", tmp_path / "b.h5"
    recorded(home)
    rows = [(t, 1, 1, 1) for t in (5_000_000, 5_000_020, 5_000_010, 1, 5_000_030, 5_000_040)]
    if ending == ".ecd":
        (home / "events.txt").write_text("".join(f"{t * 1e-6:.6f} {x} {y} {p}\n" for t, x, y, p in rows))
    else:
        with h5py.File(home / "events/left/events.h5", "r+") as file:
            for name, column in zip("txyp", np.array(rows).T, strict=True):
                file[f"events/{name}"].resize((len(rows),))
                file[f"events/{name}"][:] = column
            file["t_offset"][()] = 0
            file["ms_to_idx"].resize((0,))
    with open_source(home) as found:
        assert (found.width, found.height) == (recordings.WIDTH, recordings.HEIGHT)
        assert found.read()["t"].tolist() == [5_000_000, 5_000_010, 5_000_020, 5_000_030, 5_000_040]
        assert (found.moved_events, found.dropped_events) == (1, 1)
    with pytest.raises(InputError, match="expected rising times"):
        open_source(home, strict=True).read()
    with pytest.warns(Notice, match=rf"a{ending}: 1 events came after later ones, 1 were left out"):
        assert convert_recording(str(home), str(target))[0] == 5
    target.unlink()
    with pytest.raises(InputError, match="expected rising times"):
        convert_recording(str(home), str(target), strict=True)
    with pytest.raises(InputError, match="expected rising times"):
        convert(str(home), str(target), strict=True)
    assert not target.exists()
