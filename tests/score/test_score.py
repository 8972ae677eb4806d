"""Scores against counts made by hand and by exhaustive search."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from clsim.errors import InputError
from clsim.events import EVENT_DTYPE
from clsim.frames import frame_time_us
from clsim.score import Sampling, curves, plot_curves, score
from clsim.score.matching import squared_distances

W, H, FPS = 100, 50, 60.0


def batch(*events):
    return np.array([(t, x, y, on) for t, x, y, on in events], dtype=EVENT_DTYPE)


def random_batch(seed, count, on=None):
    rng = np.random.default_rng(seed)
    events = np.empty(count, dtype=EVENT_DTYPE)
    events["t"] = rng.integers(1, 90_000, count)
    events["x"], events["y"] = rng.integers(0, 12, count), rng.integers(0, 9, count)
    events["on"] = rng.integers(0, 2, count) if on is None else on
    return events


def at(frame):
    return frame_time_us(frame, FPS)


@pytest.mark.parametrize(("width", "height"), [(2, 7), (7, 2), (1, 9), (9, 1)])
def test_each_pixel_and_polarity_stands_for_itself(width, height):
    """However long and narrow the picture is: what fires elsewhere is no strict partner of an event."""
    y, x, on = (each.ravel() for each in np.mgrid[:height, :width, :2])
    events = batch(*((at(3), *each) for each in zip(x, y, on, strict=True)))
    for k in range(len(events)):
        others = np.delete(events, k)
        assert score(events[k : k + 1], others, width, height, FPS).strict_f1 == 0
        assert score(events[k : k + 1], others, width, height, FPS, within_us=(50_000,)).within[50_000].f1 == 0
    assert score(events, events, width, height, FPS).strict_f1 == 1


@pytest.mark.parametrize("fps", [24, 30, 59.94, 60, 120, 1000, 7])
def test_frames_end_at_their_rounded_times(fps):
    sampling = Sampling(W, H, fps)
    for k in (1, 2, 3, 7, 100, 239, 100_000):
        t = frame_time_us(k, fps)
        events = batch((t, 0, 0, True), (t + 1, 0, 0, True), (frame_time_us(k - 1, fps) + 1, 0, 0, True))
        assert sampling.frames(events).tolist() == [k, k + 1, k]


def test_a_small_case_counted_by_hand():
    reference = batch((at(1), 10, 10, True), (at(1), 50, 10, False), (at(2), 10, 10, True), (at(5), 90, 40, True))
    events = batch(
        (at(1), 11, 10, True),  # one pixel off: d² = 1e-4
        (at(1), 53, 10, False),  # three pixels off: d² = 9e-4
        (at(2), 10, 10, True),  # exact
        (at(2), 10, 10, False),  # nothing of that polarity in frame 2
        (at(4), 90, 40, True),  # the neighbouring frame
    )
    result = score(events, reference, W, H, FPS)
    assert result.precision == pytest.approx(2 / 5)
    assert result.recall == pytest.approx(2 / 4)
    assert result.f1 == pytest.approx(2 * 0.4 * 0.5 / 0.9)
    assert result.strict_precision == pytest.approx(2 / 5)
    assert result.strict_recall == pytest.approx(2 / 4)
    assert (result.unmatched_events, result.unmatched_reference) == (2, 1)
    assert (result.events, result.reference_events) == (5, 4)
    there = (1e-4 + 9e-4 + 0 + 2 + 2) / 5
    back = (1e-4 + 9e-4 + 0 + 2) / 4
    assert result.chamfer == pytest.approx((there + back) / 2)
    assert result.dt_median_us == pytest.approx(np.median([0, at(5) - at(4)]))
    wider = score(events, reference, W, H, FPS, tau=1e-3)
    assert (wider.precision, wider.tau) == (pytest.approx(3 / 5), 1e-3)
    assert score(events, reference, W, H, FPS, tau=9e-5).precision == pytest.approx(1 / 5)
    assert json.loads(json.dumps(result.as_dict()))["strict_recall"] == pytest.approx(2 / 4)


def test_the_vertical_is_measured_in_image_heights():
    reference, events = batch((at(1), 10, 10, True)), batch((at(1), 10, 11, True))
    assert score(events, reference, W, H, FPS).chamfer == pytest.approx((1 / H) ** 2)
    # From corner to corner too.
    reference["x"], reference["y"], events["x"], events["y"] = 0, 0, W - 1, H - 1
    far = score(events, reference, W, H, FPS)
    assert far.chamfer == pytest.approx(0.99**2 + 0.98**2) and far.unmatched_events == 0


def exhaustive_d2(events, others):
    result = []
    for e in events.tolist():
        same = [
            o
            for o in others.tolist()
            if o[3] == e[3] and -(-int((o[0] * 2 - 1) * FPS) // 2_000_000) == -(-int((e[0] * 2 - 1) * FPS) // 2_000_000)
        ]
        result.append(min(((e[1] - o[1]) / W) ** 2 + ((e[2] - o[2]) / H) ** 2 for o in same) if same else np.inf)
    return result


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), a=st.integers(0, 60), b=st.integers(0, 60))
def test_matching_equals_exhaustive_search(seed, a, b):
    events, others = random_batch(seed, a), random_batch(seed + 1, b)
    sampling = Sampling(W, H, FPS)
    np.testing.assert_allclose(squared_distances(events, others, sampling), exhaustive_d2(events, others), atol=1e-12)


def test_a_set_against_itself_is_perfect():
    events = random_batch(3, 200)
    result = score(events, events[::-1], W, H, FPS)
    assert result.f1 == result.strict_f1 == result.precision == result.recall == 1
    assert result.chamfer == 0 and result.dt_median_us == 0 and result.dt_p95_us == 0


def test_exchanging_the_sets_exchanges_precision_and_recall():
    events, reference = random_batch(1, 80), random_batch(2, 50)
    a, b = score(events, reference, W, H, FPS), score(reference, events, W, H, FPS)
    assert (a.precision, a.strict_precision) == (b.recall, b.strict_recall)
    assert (a.f1, a.strict_f1, a.chamfer) == pytest.approx((b.f1, b.strict_f1, b.chamfer))
    assert 0 < a.precision != a.recall


@pytest.mark.parametrize("sign", [-1, 1])
def test_timing_errors(sign):
    """Some come much later, or earlier, than most: mean and median differ."""
    reference = batch(*((at(k), 5, 5, True) for k in range(1, 21)))
    events = reference.copy()
    events["t"] += sign * np.arange(20) ** 2
    result = score(events, reference, W, H, FPS)
    assert result.dt_median_us == pytest.approx((9**2 + 10**2) / 2)
    assert result.dt_p95_us == pytest.approx(np.percentile(np.arange(20) ** 2, 95))
    assert result.dt_bias_us == pytest.approx(sign * 19 * 39 / 6)


def test_empty_sets():
    none, some = batch(), random_batch(0, 10)
    both = score(none, none, W, H, FPS)
    assert (both.f1, both.strict_f1, both.chamfer, both.dt_median_us) == (1, 1, 0, None)
    drawn = curves(none, none, Sampling(W, H, FPS))
    assert np.concatenate([drawn.precision, drawn.recall, drawn.f1]).tolist() == [1.0] * 180
    for events, reference in ((none, some), (some, none)):
        one = score(events, reference, W, H, FPS)
        assert (one.f1, one.precision, one.recall, one.strict_f1, one.chamfer) == (0, 0, 0, 0, 2)
        assert one.unmatched_events + one.unmatched_reference == 10
        assert one.dt_p95_us is None
        drawn = curves(events, reference, Sampling(W, H, FPS))
        assert not np.concatenate([drawn.precision, drawn.recall, drawn.f1]).any()


def test_one_polarity_only():
    on, off = random_batch(0, 20, on=True), random_batch(1, 20, on=False)
    apart = score(on, off, W, H, FPS)
    assert (apart.f1, apart.chamfer, apart.unmatched_events, apart.unmatched_reference) == (0, 2, 20, 20)
    assert score(on, on, W, H, FPS).f1 == 1
    mixed = score(on, np.concatenate([on, off]), W, H, FPS)
    assert mixed.precision == 1 and mixed.recall == pytest.approx(0.5)


def test_wrong_input_is_named():
    events = batch((1, 3, 60, True))
    with pytest.raises(InputError, match="the reference has an event at x=3, y=60, outside the image of 100×50"):
        score(batch(), events, W, H, FPS)
    with pytest.raises(InputError, match="the reference has an event at x=3, y=60, outside the image of 100×60"):
        curves(batch(), events, Sampling(W, 60, FPS))
    with pytest.raises(InputError, match="the event set has an event at x=100, y=3, outside the image of 100×50"):
        score(batch((1, 99, 49, True), (1, W, 3, True), (1, 0, H, True)), batch(), W, H, FPS)
    with pytest.raises(InputError, match="`fps` must be a positive number, got 0"):
        score(events, events, W, 100, 0)
    with pytest.raises(InputError, match="`fps` must be a positive number, got inf"):
        score(events, events, W, 100, float("inf"))
    with pytest.raises(InputError, match="`width` must be"):
        score(events, events, -1, 100, FPS)
    with pytest.raises(InputError, match="`within_us` must be at least 1 µs, got nan"):
        score(events, events, W, 100, FPS, within_us=[float("nan")])
    with pytest.raises(InputError, match="`tau` must be a positive number, got 0"):
        score(events, events, W, 100, FPS, tau=0)


def test_curves_pass_through_the_scores_and_rise():
    events, reference = random_batch(1, 300), random_batch(2, 200)
    tau = np.array([1e-4, 5e-4, 5e-3])
    values = curves(events, reference, Sampling(W, H, FPS), tau)
    for i, t in enumerate(tau):
        result = score(events, reference, W, H, FPS, tau=t)
        assert (values.precision[i], values.recall[i], values.f1[i]) == (result.precision, result.recall, result.f1)
    assert (np.diff(values.f1) > 0).all()
    usual = curves(events, reference, Sampling(W, H, FPS)).tau
    np.testing.assert_allclose(np.log10(usual), np.linspace(-5, -2, 60))


@pytest.mark.slow
def test_curves_are_drawn(tmp_path, monkeypatch):
    figure = pytest.importorskip("matplotlib.figure", reason="matplotlib draws the curves and is optional").Figure
    from PIL import Image

    values = {
        name: curves(random_batch(s, 99), random_batch(9, 99), Sampling(W, H, FPS)) for s, name in enumerate("ab")
    }
    plot_curves(values, tmp_path / "curves.png")
    with Image.open(tmp_path / "curves.png") as image:
        assert image.format == "PNG" and len(image.convert("RGB").getcolors(1 << 20)) > 10
    with pytest.raises(InputError, match=r"curves\.png: No such file or directory"):
        plot_curves(values, tmp_path / "nowhere" / "curves.png")
    drawn = []
    monkeypatch.setattr(figure, "savefig", lambda self, *_, **__: drawn.append(self))
    plot_curves(values, "nowhere")
    for panel, name in zip(drawn[0].axes, ("precision", "recall", "f1"), strict=True):
        drawn_y = [line.get_ydata() for line in panel.lines[: len(values)]]
        np.testing.assert_array_equal(drawn_y, [getattr(each, name) for each in values.values()])
        assert panel.get_title().lower() == name and panel.get_ylim()[1] > 1
        assert panel.lines[-1].get_xdata() == [5e-4, 5e-4], "the paper's τ"
    assert [text.get_text() for text in drawn[0].axes[-1].get_legend().get_texts()] == ["a", "b"]
