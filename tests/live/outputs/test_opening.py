"""A run's file takes the place of an older one with the first frame, and not before."""

import json
from pathlib import Path

import numpy as np
import pytest

import clsim
from clsim.events import EVENT_DTYPE, SinkError
from clsim.frames import Frame
from clsim.live.options import LiveOptions
from clsim.live.outputs.delivery import Delivery, Output
from clsim.live.session import Session, open_live
from tests.live.small_pipeline import ListSink

ENDINGS = (".csv", ".aedat4", ".evt3.raw", ".raw", ".dat", ".es", ".h5")
OLD = {"": "an older recording", ".json": "its sidecar", ".poses.txt": "its poses"}
EVENTS = np.array([(10, 1, 2, True), (20, 3, 4, False)], EVENT_DTYPE)


def started(folder: Path, monkeypatch: pytest.MonkeyPatch, **options: object) -> Session:
    """Return a run into older files and into a new one that was started, but has no frame."""
    for ending in ENDINGS:
        for more, text in OLD.items():
            (folder / f"old{ending}{more}").write_text(text)
    names = [str(folder / f"old{ending}") for ending in ENDINGS] + [str(folder / "new.csv")]
    session = open_live(LiveOptions("still", resolution=(16, 12), outputs=names, **options))
    monkeypatch.setattr(session.pipeline, "start", lambda: None)
    session.start()
    assert (folder / "new.csv.json").exists() and (folder / "new.csv.poses.txt").exists()
    return session


@pytest.mark.parametrize("options", [{}, {"truth": "depth"}])
def test_a_run_without_a_frame_leaves_older_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: dict[str, object]
) -> None:
    session = started(tmp_path, monkeypatch, **options)
    session.pipeline.stop()
    session.write_sidecars(complete=False)
    for ending in ENDINGS:
        for more, text in OLD.items():
            assert (tmp_path / f"old{ending}{more}").read_text() == text
    assert not list(tmp_path.glob(".*")) and json.loads((tmp_path / "new.csv.json").read_text())["complete"] is False
    kept = [each["name"] for each in session.summary().outputs if not each.get("replaced", True)]
    assert sorted(kept) == sorted([str(tmp_path / f"old{ending}") for ending in ENDINGS])


def test_the_first_frame_replaces_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    session = started(tmp_path, monkeypatch)
    delivery = Delivery(session.pipeline.outputs)
    for index in range(2):
        delivery.record(Frame(np.zeros((1, 12, 16), np.float32), ("R",), index=index), EVENTS)
        delivery.write(EVENTS if index else EVENTS[:0], 100 * index)
        for ending in ENDINGS:  # from the first frame on they can be watched as they grow
            assert json.loads((tmp_path / f"old{ending}.json").read_text())["complete"] is False
            assert not (tmp_path / f"old{ending}").read_bytes().startswith(b"an older")
    delivery.close()
    session.pipeline.progress.events = len(EVENTS)
    session.write_sidecars(complete=True)
    for ending in (*ENDINGS, ".csv"):
        name = tmp_path / f"old{ending}"
        assert np.array_equal(clsim.open(name, strict=True).read(), EVENTS)
        assert len((tmp_path / f"old{ending}.poses.txt").read_text().splitlines()) == 4
        assert json.loads((tmp_path / f"old{ending}.json").read_text())["complete"] is True
    assert not list(tmp_path.glob(".*")) and not any("error" in each for each in session.summary().outputs)


def test_what_fails_later_is_told_under_the_name_that_was_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = started(tmp_path, monkeypatch)
    delivery = Delivery(session.pipeline.outputs)
    delivery.record(Frame(np.zeros((1, 12, 16), np.float32), ("R",), index=0), EVENTS)
    for path in tmp_path.iterdir():
        path.unlink()
    with pytest.raises(clsim.SinkError, match="every output has failed"):
        for index in range(3):
            delivery.write(EVENTS, 20_000 * (index + 1))
    assert f"{tmp_path}/old.dat: writing failed" in str(session.pipeline.outputs[4].error)
    delivery.close()


def test_outputs_that_cannot_be_written_are_refused_before_any_is_touched(tmp_path: Path) -> None:
    (tmp_path / "old.csv").write_text("older")
    with pytest.raises(clsim.InputError, match="there is no folder"):
        outputs = [str(tmp_path / "old.csv"), str(tmp_path / "none" / "b.csv")]
        open_live(LiveOptions("still", resolution=(16, 12), outputs=outputs))
    assert (tmp_path / "old.csv").read_text() == "older" and len(list(tmp_path.iterdir())) == 1


def test_a_reader_that_has_left_is_told_from_a_disk_that_is_full() -> None:
    """By the error itself, or by what it comes from."""
    gone = SinkError("-: nobody reads")
    gone.__cause__ = BrokenPipeError()
    for error, left in ((BrokenPipeError(), True), (gone, True), (OSError(28, "no space left"), False)):
        output = Output("-", ListSink())
        output.fail(error)
        assert output.reader_left == left
