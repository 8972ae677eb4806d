"""From one layout of truth to another and back, and events alone out of recordings with truth."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import clsim as library
from clsim.cli.app import app
from clsim.cli.output.status import OUTPUT_FAILED
from clsim.errors import InputError
from clsim.events import SinkError
from clsim.truth.layouts import LAYOUTS, LayoutKind, layout_of, open_layout
from clsim.truth.record import Shot
from clsim.truth.recording import convert_recording, read_recording
from clsim.truth.writing.lines import rate_of, seconds
from tests.truth import recordings

FOLDERS = [kind.endings[0] for kind in LAYOUTS if kind.folder]


def recorded(path: Path) -> recordings.Given:
    return recordings.feed(open_layout(str(path), recordings.about()))


def same(a: Shot, b: Shot, exact: bool, levels: int = 0, ulps: int = 0) -> None:
    """Assert that frames are alike; pictures up to so many levels, flow up to roundings of float32."""
    assert (a.time_us, a.event_index) == (b.time_us, b.event_index)
    for name in set(a.planes) & set(b.planes):
        if name == "image":
            assert np.abs(a.planes[name].astype(int) - b.planes[name]).max() <= levels
        elif name == "flow" and ulps:
            known = a.planes[name][..., 2] > 0
            assert np.array_equal(known, b.planes[name][..., 2] > 0)
            np.testing.assert_array_max_ulp(a.planes[name][known][:, :2], b.planes[name][known][:, :2], ulps)
        elif name in ("object", "material") or exact:
            assert np.array_equal(a.planes[name], b.planes[name]), name
    if "depth" in b.planes:
        assert np.array_equal(np.isfinite(a.planes["depth"]), np.isfinite(b.planes["depth"]))


@pytest.mark.parametrize("kind", LAYOUTS, ids=lambda kind: kind.name)
def test_endings_are_read_whatever_their_case(kind: LayoutKind) -> None:
    assert [layout_of(f"RUN{ending.upper()}") for ending in kind.endings] == [kind] * len(kind.endings)
    assert [layout_of(f"run{ending}//") for ending in kind.endings] == [kind] * len(kind.endings), "as of folders"


@pytest.mark.parametrize("ending", FOLDERS)
def test_a_round_trip_loses_nothing_that_both_hold(tmp_path: Path, ending: str) -> None:
    """To another layout and back, and there again: the second and the third are the same to the bit."""
    names = ("a.h5", f"b{ending}", "c.h5", f"d{ending}")
    start, there, back, again = (str(tmp_path / name) for name in names)
    jpeg, speeds = 3 if ending == ".tumvie" else 0, 2 if ending == ".event_utils" else 0  # px and px/s
    given_events = recorded(Path(start)).events
    kind = layout_of(there)
    count, left_out = convert_recording(start, there)
    assert count == len(given_events) and not set(left_out) & set(kind.holds)
    convert_recording(there, back)
    convert_recording(back, again)
    first, second, third, fourth = map(read_recording, (start, there, back, again))
    for other in (second, third, fourth):
        assert np.concatenate(list(other.events())).tobytes() == given_events.tobytes()
    for a, b in zip(first.shots(), second.shots(), strict=True):
        same(a, b, exact=False, levels=jpeg, ulps=speeds)
    for a, b, c in zip(second.shots(), third.shots(), fourth.shots(), strict=True):
        same(a, b, exact=True)
        same(b, c, exact=True, levels=jpeg, ulps=speeds)
    tracks = {track.name: track for track in first.tracks()}
    for mine, theirs in ((second, third), (second, fourth)):
        for a, b in zip(mine.tracks(), theirs.tracks(), strict=True):
            assert a.name == b.name and np.array_equal(a.times_us, b.times_us)
            assert np.abs(a.poses - b.poses).max() < 1e-8 and np.abs(a.poses - tracks[a.name].poses).max() < 1e-8
            for told in (a.velocities, b.velocities):  # what a layout has no place for is unknown, not 0
                assert np.allclose(told, tracks[a.name].velocities, atol=1e-6) or np.isnan(told).all()
        samples = zip(first.imu(), mine.imu(), theirs.imu(), strict=True) if "imu" in kind.holds else ()
        for a, b, c in samples:
            assert np.array_equal(a.times_us, b.times_us) and np.abs(a.acceleration - b.acceleration).max() < 1e-6
            assert np.abs(b.angular_velocity - c.angular_velocity).max() < 1e-12
    assert second.about.camera["intrinsics_px"] == pytest.approx(first.about.camera["intrinsics_px"])
    assert not [path for path in tmp_path.rglob("*") if path.name.startswith(".")]


@pytest.mark.parametrize("ending", FOLDERS)
def test_events_before_a_frame_are_counted_whatever_the_portions_they_are_read_in(
    tmp_path: Path, ending: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = recorded(tmp_path / f"run{ending}")
    for name, value in (
        ("events.formats.order._BLOCK", 10), ("events.formats.order.WINDOW_US", 300),
        ("events.formats.tables.hdf5.CHUNK_EVENTS", 30), ("events.formats.tables.text._CHUNK_BYTES", 600),
        ("truth.formats.event_utils.CHUNK_EVENTS", 30), ("truth.formats.mvsec.CHUNK_EVENTS", 30),
    ):  # fmt: skip
        monkeypatch.setattr(f"clsim.{name}", value)
    found = read_recording(str(tmp_path / f"run{ending}"))
    batches = list(found.events())
    assert len(batches) > 3 and np.concatenate(batches).tobytes() == expected.events.tobytes()
    assert [shot.event_index for shot in found.shots()] == [shot.event_index for shot in expected.shots]
    copied, _ = convert_recording(str(tmp_path / f"run{ending}"), str(tmp_path / "copy.h5"))
    assert copied == len(expected.events)


@pytest.mark.parametrize("ending", FOLDERS)
def test_depth_of_a_mirrored_camera_is_in_front_of_it(tmp_path: Path, ending: str) -> None:
    about = recordings.about()
    px = about.camera["intrinsics_px"]
    about = replace(about, camera=about.camera | {"intrinsics_px": px | {"fx": -px["fx"]}})
    expected = recordings.feed(open_layout(str(tmp_path / f"run{ending}"), about))
    found = read_recording(str(tmp_path / f"run{ending}"))
    assert found.about.camera["intrinsics_px"] == pytest.approx(px | {"fx": -px["fx"]})
    for shot, given in zip(found.shots(), expected.shots, strict=True):
        if "depth" in shot.planes:
            np.testing.assert_allclose(shot.planes["depth"], given.planes["depth"], rtol=0.02)


@pytest.mark.parametrize("time_us", [-1_500_000, -1, 0, 1, 999_999, 1_500_000_000_000_001])
def test_seconds_in_text_are_exact_before_0_too(time_us: int) -> None:
    assert Decimal(seconds(time_us)) * 10**6 == time_us


@pytest.mark.parametrize(("times_us", "rate"), [([0, 20_000, 40_000, 240_000], 50.0), ([7], 30.0), ([], 30.0)])
def test_a_frame_that_is_missing_does_not_change_the_rate(times_us: list[int], rate: float) -> None:
    assert rate_of(times_us) == rate


def test_convert_from_the_command_line(tmp_path: Path) -> None:
    recorded(tmp_path / "a.h5")
    run = CliRunner().invoke(app, ["convert", str(tmp_path / "a.h5"), str(tmp_path / "b.ecd")])
    assert run.exit_code == 0 and "500 events" in run.stderr
    assert "cannot hold albedo, backward-flow, distance, flow, ids, labels, normal" in run.stderr
    with pytest.raises(InputError, match="is there already"):
        convert_recording(str(tmp_path / "b.ecd"), str(tmp_path / "b.ecd"))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.h5", "b.ecd"]


@pytest.mark.parametrize("ending", [".dsec", ".mvsec"])
def test_events_of_a_folder_are_read_as_those_of_files(tmp_path: Path, ending: str) -> None:
    folder = tmp_path / f"run{ending}"
    given = recorded(folder)
    with library.open(folder) as source:
        assert (source.width, source.height) == (recordings.WIDTH, recordings.HEIGHT)
        np.testing.assert_array_equal(source.read(), given.events)
    for words in ("view", str(folder), "--to", str(tmp_path / "a.png")), ("convert", str(folder), f"{folder}.npz"):
        assert CliRunner().invoke(app, [*words]).exit_code == 0
    np.testing.assert_array_equal(library.open(f"{folder}.npz").read(), given.events)


def test_a_recording_that_cannot_be_written_to_its_end_is_told_and_is_no_success(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: str, strict: bool) -> None:
        raise SinkError("b.dsec: cannot be written (No space left on device)")

    recorded(tmp_path / "a.h5")
    monkeypatch.setattr("clsim.truth.recording.convert_recording", full)
    run = CliRunner().invoke(app, ["convert", str(tmp_path / "a.h5"), str(tmp_path / "b.dsec")], standalone_mode=False)
    assert run.return_value == OUTPUT_FAILED != 0
    assert run.stderr == "clsim: b.dsec: cannot be written (No space left on device)\n"
