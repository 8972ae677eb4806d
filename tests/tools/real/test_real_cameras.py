"""What docs/real-cameras.md is made with: a drifting texture, v2e's equations, the search for a rate, and the line."""

import io
import json
import math
import re
import tarfile

import numpy as np
import pytest
from PIL import Image

from clsim.sensor.statistics import statistics
from tools.real import digits, simulated_digits
from tools.real.digit_set import cut, make_screens
from tools.real.page import Compared, page
from tools.real.scene import DIRECTION, LAYERS, Look, Texture
from tools.real.streams import Taken, at_rate
from tools.real.two_samples import OF_CAMERAS, OF_SCENES, accuracy, features
from tools.real.v2e_model import Defaults, V2e


def test_a_texture_moves_where_it_is_told_to_and_nowhere_else():
    texture = Texture(Look(0.4, 1.0, 4.0), 96, 64)
    still, moved = texture.at(0.0), texture.at(10.0)
    assert (still != moved).mean() == pytest.approx(0.4, abs=0.02)
    assert still.max() == pytest.approx(texture.brightest, abs=0.3) and texture.at(3.3).max() <= texture.brightest
    # In the layer of the scene's own pace and contrast a pixel sees what its neighbour saw.
    whole = 10 / DIRECTION[0]
    here, there = texture._moved(whole), np.roll(texture._moved(0.0), (0, 10), (0, 1))
    down = whole * DIRECTION[1] % 1
    assert LAYERS[1] == (1.0, 1.0)
    rows = int(whole * DIRECTION[1])
    expected = (1 - down) * np.roll(there, rows, 0) + down * np.roll(there, rows + 1, 0)
    np.testing.assert_allclose(here, expected, atol=1e-9)


def one_pixel(levels_dn, step_s, **numbers):
    pixels = V2e(1, 1, Defaults(**{"mismatch": 0.0, "leak_hz": 0.0, "shot_hz": 0.0, "rest_s": 0.0} | numbers))
    return np.concatenate([pixels.frame(k * step_s, np.array([[dn]])) for k, dn in enumerate(levels_dn)])


def test_v2e_fires_a_threshold_at_a_time_spread_over_the_frame():
    # From 100 to 182 of 255, ln 1.82 = 0.599: two thresholds of 0.2, with so wide a band, and one threshold down.
    events = one_pixel([100.0, 182.0, 182.0, 120.0], 0.01, cutoff_hz=1e9)
    assert events["t"].tolist() == [5000, 10_000, 30_000] and events["on"].tolist() == [True, True, False]
    # Below 20 brightness is linear: from 10 to 20 it is half of ln 20.
    assert len(one_pixel([10.0, 20.0], 0.01, cutoff_hz=1e9)) == math.floor(0.5 * math.log(20) / 0.2)


def test_v2e_has_its_bandwidth_leak_and_rest():
    # A frame of 0.1 ms passes (120 / 275 + ...) of what is left: 10 of 300 Hz's time constants pass nearly all.
    slow = one_pixel([100.0] + [182.0] * 100, 1e-4)
    share = (182 + 20) / 275 * 1e-4 * 2 * math.pi * 300
    first = next(k for k in range(1, 100) if math.log(1.82) * (1 - (1 - share) ** k) >= 0.2)
    assert slow["t"][0] == first * 100
    assert len(one_pixel([100.0] * 1001, 0.01, leak_hz=2.0)) == pytest.approx(20, abs=1)
    rested = one_pixel([25.0, 250.0], 0.01, cutoff_hz=1e9, rest_s=0.0019)
    assert np.diff(rested["t"]).min() >= 1900 and len(rested) < math.log(10) / 0.2 - 1


def test_the_rate_of_a_recording_is_found():
    tried = []

    def run(speed):
        tried.append(speed)
        return Taken(np.zeros(int(30 * speed**0.7), "u1"), 0, speed)

    assert len(at_rate(run, 5000, 10.0).events) == pytest.approx(5000, rel=0.03) and len(tried) <= 7


def noise(seed, rate_hz, rows=False):
    random = np.random.default_rng(seed)
    events = np.zeros(round(rate_hz * 0.02), [("t", "i8"), ("x", "u2"), ("y", "u2"), ("on", "?")])
    events["t"] = np.sort(random.integers(0, 20_000, len(events)))
    events["x"], events["on"] = random.integers(0, 320, len(events)), random.integers(0, 2, len(events))
    events["y"] = events["t"] % 240 if rows else random.integers(0, 240, len(events))
    return events


def test_the_line_tells_streams_apart_that_differ_and_none_that_do_not():
    one, same, rows = (features(noise(seed, 2e6, seed == 2)) for seed in range(3))
    assert one.shape[1] == len(OF_SCENES) + len(OF_CAMERAS) and len(one) > 60
    assert accuracy(one, same) == pytest.approx(0.5, abs=0.15)
    assert accuracy(one, rows) > 0.98
    assert math.isnan(accuracy(one[:10], same))


def test_the_page_has_each_recording_with_its_models_and_the_nearest_in_bold():
    real, near, far = (statistics(noise(seed, 2e6, rows)) for seed, rows in ((0, False), (1, False), (2, True)))
    from clsim.sensor.statistics import distances

    models = {
        name: (Taken(noise(1, 2e6), 3, 70.0), own, distances(own, real), (0.6, 0.7))
        for name, own in (("near", near), ("far", far))
    }
    text = page([Compared("a.raw", "Camera", "gen3.1", Look(0.2, 1.0, 5.0), real, (0.5, 0.4), 60, models)], 7.2)
    assert "## Camera: a.raw" in text and "# 7 minutes" in text and "| near | far |" in text
    row = next(line for line in text.splitlines() if line.startswith("| a.raw | of one time, in one row |"))
    assert row.split("|")[3].strip().startswith("**") and not row.split("|")[4].strip().startswith("**")
    told = re.search(r"near in (\d), far in (\d), of 6 rows", text)
    bold = [[cell.strip().startswith("**") for cell in line.split("|")[3:5]] for line in text.splitlines()]
    of_table = [cells for line, cells in zip(text.splitlines(), bold, strict=True) if line.startswith("| a.raw |")][:6]
    assert tuple(map(int, told.groups())) == tuple(np.sum(of_table, axis=0))
    assert "| a.raw | cameras' | 0.40 | 0.70 | 0.70 |" in text


def test_digits_go_the_way_of_the_saccades_and_back_again_almost():
    (begin, _), start, _ = digits.SACCADES[0]
    assert digits.corner_at(begin - 1) == start
    for (begin, end), start, stop in digits.SACCADES:
        assert digits.corner_at((begin + end) / 2) == pytest.approx(np.mean([start, stop], axis=0))
        assert digits.corner_at(end + 1) == pytest.approx(stop)
    image = np.zeros((1, 28, 28))
    image[0, 10, 12] = 1.0
    lit = np.exp(digits.levels(image, 0.0)) - digits.BLACK
    assert np.average(np.arange(lit.shape[1]), weights=lit.sum(0)) == pytest.approx(
        12 + digits.SACCADES[0][1][0], abs=0.01
    )
    assert np.average(np.arange(lit.shape[0]), weights=lit.sum(1)) == pytest.approx(
        10 + digits.SACCADES[0][1][1], abs=0.01
    )


@pytest.mark.slow
def test_each_digit_gets_its_own_events():
    def build(seed):
        def pixels(time_us, level):
            y, x = np.nonzero(level > -0.5)
            events = np.zeros(len(x), [("t", "i8"), ("x", "u2"), ("y", "u2"), ("on", "?")])
            events["t"], events["x"], events["y"] = time_us, x, y
            return events

        return pixels

    images = np.zeros((32, 28, 28))
    images[3, 5:8, 5:8] = images[31, 20:23, 9:12] = 1.0
    found = list(digits.simulated(build, images))
    assert [k for k, events in enumerate(found) if len(events)] == [3, 31]
    assert found[3]["y"].max() < 18 < found[31]["y"].min() and found[31]["t"].min() == 0


def test_a_linear_classifier_learns_what_is_linear():
    random = np.random.default_rng(0)
    middle = random.normal(size=(10, 40))
    labels = random.integers(0, 10, 600)
    seen = middle[labels] + 0.5 * random.normal(size=(600, 40))
    line = digits.Line(seen[:400], labels[:400])
    assert line.right(seen[400:], labels[400:]) > 0.95
    assert line.right(seen[400:], random.permutation(labels[400:])) < 0.3


def test_a_screen_shows_each_digit_in_its_place_and_is_cut_likewise(tmp_path):
    images = np.zeros((200, 28, 28))
    images[np.arange(200), np.arange(200) % 28, 5] = 1.0
    make_screens(tmp_path, images)
    with Image.open(tmp_path / "screens" / "001.png") as picture:
        assert picture.size == (340, 340)
        stored = np.asarray(picture.convert("L"))
    y, x = np.nonzero(stored == 255)
    assert set(zip(x.tolist(), y.tolist(), strict=True)) == {
        (34 * (k % 10) + 5, 34 * (k // 10) + (100 + k) % 28) for k in range(100)
    }
    decoded = ((stored.min() / 255 + 0.055) / 1.055) ** 2.4
    assert decoded == pytest.approx(digits.BLACK, rel=0.02)
    events = np.zeros(len(x), [("t", "i8"), ("x", "u2"), ("y", "u2"), ("on", "?")])
    events["t"], events["x"], events["y"] = 50_000, x, y
    events[0]["t"] = 39_999  # before the saccades
    parts = list(cut(events))
    assert [len(part) for part in parts] == [0] + [1] * 99
    assert [tuple(part[0])[:3] for part in parts[1:]] == [(10_000, 5, (100 + k) % 28) for k in range(1, 100)]


def test_what_real_recordings_show_is_not_simulated(tmp_path):
    with tarfile.open(tmp_path / "a.tgz", "w:gz") as archive:
        for digit in range(10):
            data = json.dumps({"data": [digit + 0.1 * k for k in range(3) for _ in range(28 * 28)]}).encode()
            told = tarfile.TarInfo(f"package/src/digits/{digit}.json")
            told.size = len(data)
            archive.addfile(told, io.BytesIO(data))
    images, labels, places = digits.digits(tmp_path / "a.tgz")
    np.testing.assert_allclose(images[:, 0, 0], labels + 0.1 * places)
    # Real ones show two sevens and a one: the first two sevens and the first one are known.
    left = digits.strange(labels, places, np.array([7, 1, 7]))
    known = {(int(label), int(place)) for label, place in zip(labels[~left], places[~left], strict=True)}
    assert known == {(7, 0), (7, 1), (1, 0)}


def test_shifts_lose_what_leaves_the_picture():
    events = np.zeros(3, [("t", "i8"), ("x", "u2"), ("y", "u2"), ("on", "?")])
    events["x"], events["y"] = [0, 5, 33], [33, 5, 0]
    assert digits.shifted(events, -1, 1)[["x", "y"]].tolist() == [(4, 6), (32, 1)]
    assert len(digits.shifted(events, 0, 0)) == 3 and events["x"].tolist() == [0, 5, 33]


def test_the_page_says_how_far_simulated_training_is_from_real():
    rows = [["real", "300", "1", ".5", "0.917", "0.940"], ["a", "300", "1", ".5", "0.8", "0.85"]]
    rows += [["a", "2700, moved too", "1", ".5", "0.867", "0.920"]]
    text = " ".join(simulated_digits.page(rows, 20).split())
    assert "a 5.0 points on the 60 and 2.0 on the 300." in text and "| real | 300 |" in text and "20 minutes" in text
