"""Truth as pictures."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from clsim.cli.app import app
from clsim.errors import InputError
from clsim.live.view.truth_pictures import DepthPicture, FlowPicture, ids_picture, recorded_pictures
from clsim.truth.formats.hdf5 import Hdf5Layout
from tests.truth import recordings


def test_near_is_lighter_than_far_and_nothing_is_black() -> None:
    depth = np.array([[1.0, 2.0, 4.0, 8.0, np.inf]])
    picture = DepthPicture()(depth)
    light = picture.sum(axis=2)[0].tolist()
    assert light == sorted(light, reverse=True) and len(set(light)) == 5 and light[-1] == 0


def test_the_first_picture_sets_the_range() -> None:
    show = DepthPicture()
    first = show(np.array([[1.0, 2.0, 3.0]]))
    assert np.array_equal(show(np.array([[2.0, 2.0, 2.0]]))[0, 0], first[0, 1])
    flow, seen = FlowPicture(), np.ones((1, 1))
    first, half = (flow(np.array([[(x, 0.0)]]), seen, seen)[0, 0].tolist() for x in (4.0, 2.0))
    assert (first, half) == ([255, 0, 0], [255, 127, 127])


def test_flow_has_the_colours_of_the_wheel() -> None:
    flow = np.array([[(5.0, 0.0), (-5.0, 0.0), (0.0, 0.0), (5.0, 0.0), (5.0, 0.0), (0.0, 5.0)]])
    picture = FlowPicture()(flow, np.array([[1, 1, 1, 1, 0, 1]]), np.array([[1, 1, 1, 0, 0, 1]]))[0].astype(int)
    assert picture[0].tolist() == [255, 0, 0], "right is red"
    assert picture[1].tolist() == [0, 255, 255] and picture[2].tolist() == [255, 255, 255]
    assert picture[3].tolist() == [140, 0, 0] and picture[4].tolist() == [0, 0, 0]
    assert picture[5].tolist() == [127, 255, 0], "down is green"


@pytest.mark.parametrize("whatever", [0.0, 1e6, -1e6, np.nan, np.inf])
def test_what_is_not_known_changes_no_picture_of_what_is(whatever: float) -> None:
    """Data sets fill what they do not know with anything, and the range is that of what is known."""
    known = np.array([[1, 1, 1, 0, 0]])
    flow = np.array([[(5.0, 0.0), (-2.0, 1.0), (0.0, -3.0), (whatever, whatever), (0.0, whatever)]])
    picture = FlowPicture()(flow, known, known)
    assert np.array_equal(picture[:, :3], FlowPicture()(flow[:, :3], known[:, :3], known[:, :3]))
    assert not picture[:, 3:].any()
    nowhere = -abs(whatever)  # nothing is behind the camera, or at it
    depth = np.array([[1.0, 2.0, 4.0, nowhere, np.inf]])
    seen = DepthPicture()(depth)
    assert np.array_equal(seen[:, :3], DepthPicture()(depth[:, :3])) and not seen[:, 3:].any()


def test_each_object_has_a_colour() -> None:
    picture = ids_picture(np.arange(30.0)[None])[0]
    assert not picture[0].any() and len({tuple(c) for c in picture.tolist()}) == 30


def test_pictures_of_a_recording_come_at_their_times(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    given = recordings.feed(Hdf5Layout(path, recordings.about()))
    for shown in ("image", "depth", "flow", "ids"):
        found = list(recorded_pictures(str(path), shown))
        assert [time_us for time_us, _ in found] == [shot.time_us for shot in given.shots]
        assert all(p.shape == (recordings.HEIGHT, recordings.WIDTH, 3) and p.dtype == np.uint8 for _, p in found)
    show, flows = FlowPicture(), [shot.planes["flow"] for shot in given.shots]
    expected = [show(flow[..., :2], flow[..., 2], flow[..., 3]) for flow in flows]
    assert np.array_equal([picture for _, picture in recorded_pictures(str(path), "flow")], expected)
    picture = dict(recorded_pictures(str(path), "ids"))[given.shots[1].time_us]
    assert np.array_equal(picture, ids_picture(given.shots[1].planes["object"]))


@pytest.mark.parametrize("other", [["--to", "film.mp4"], ["--view", "terminal"]])
def test_what_the_page_shows_is_no_choice_for_anything_else(tmp_path: Path, other: list[str]) -> None:
    path = tmp_path / "run.h5"
    recordings.feed(Hdf5Layout(path, recordings.about()))
    run = CliRunner().invoke(app, ["view", str(path), "--show", "flow", *other])
    assert isinstance(run.exception, InputError) and "--show says what the page shows" in str(run.exception)


def test_only_recordings_with_truth_have_it(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t,x,y,p\n1,2,3,1\n")
    run = CliRunner().invoke(app, ["view", str(path), "--show", "depth"])
    assert isinstance(run.exception, InputError) and "--show is for recordings with truth" in str(run.exception)
    with pytest.raises(InputError, match="no recording with truth"):
        list(recorded_pictures(str(path), "depth"))
