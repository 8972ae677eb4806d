"""Values by chance: their ranges, their streams, and how parts share them out."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from clsim.datasets.draw import Drawer, Seeds, check, shared_out, split_of
from clsim.errors import InputError

_PARTS = (("train", 0.7), ("val", 0.2), ("test", 0.1))
_SCENE = {
    "camera": {
        "position": {"uniform": [[-1.0, 0.0], [1.0, 2.0]]},
        "wander": {"seed": {"integers": [0, 10**9]}},
        "keyframes": [{"count": {"integers": [2, 9]}, "time_s": {"uniform": [0, 1]}}],
    },
    "objects": [
        {
            "count": {"integers": [2, 5]},
            "size": {"log_uniform": [0.1, 10.0]},
            **{name: {"a": {"uniform": [1, 2]}} for name in ("orbit", "keyframes", "wander", "shake")},
        },
        {"name": "floor"},
    ],
}


def draw(index=0, attempt=0, template=_SCENE, **seeds):
    return Drawer(Seeds(**seeds), index, attempt).draw(template, "scene", "scene")


def test_the_same_sequence_is_drawn_alike():
    assert draw(3) == draw(3)
    assert draw(3) != draw(4)
    assert draw(3) != draw(3, attempt=1)


def test_each_seed_varies_its_own_stream():
    plain, moved, placed = draw(), draw(motion=1), draw(scene=1)
    assert plain["camera"] != moved["camera"]
    assert [o.get("size") for o in plain["objects"]] == [o.get("size") for o in moved["objects"]]
    for name in ("orbit", "keyframes", "wander", "shake"):
        assert plain["objects"][0][name] != moved["objects"][0][name]
        assert plain["objects"][0][name] == placed["objects"][0][name]
    assert plain["camera"] == placed["camera"]
    assert [o.get("size") for o in plain["objects"]] != [o.get("size") for o in placed["objects"]]
    assert Drawer(Seeds(noise=1), 0).seed() != Drawer(Seeds(), 0).seed() == Drawer(Seeds(motion=1), 0).seed()
    assert len({Drawer(Seeds(), index).seed() for index in range(1000)}) == 1000, "no two have the same noise"


def test_a_value_more_leaves_the_others_alone():
    more = _SCENE | {"fps": {"choice": [100, 200]}}
    assert {key: value for key, value in draw(template=more).items() if key != "fps"} == draw()


def test_counted_objects_differ():
    objects = draw(2)["objects"]
    assert 3 <= len(objects) <= 6
    assert objects[-1] == {"name": "floor"}
    assert "count" not in objects[0]
    assert len({each["size"] for each in objects[:-1]}) == len(objects) - 1


def test_values_are_spread_as_told():
    kinds = {
        "u": {"uniform": [2.0, 3.0]}, "l": {"log_uniform": [1e-3, 10.0]}, "n": {"normal": [5.0, 2.0]},
        "i": {"integers": [1, 3]}, "c": {"choice": ["a", "b"]},
    }  # fmt: skip
    drawn = [draw(index, template=kinds) for index in range(2000)]
    u, logs, n = (np.array([each[name] for each in drawn]) for name in "uln")
    assert 2.0 <= u.min() < 2.05 and 2.95 < u.max() <= 3.0
    assert 1e-3 <= logs.min() < 1.1e-3 and 9 < logs.max() <= 10.0
    assert np.mean(np.log10(logs)) == pytest.approx(-1.0, abs=0.15)
    assert (n.mean(), n.std()) == (pytest.approx(5.0, abs=0.15), pytest.approx(2.0, abs=0.15))
    assert {each["i"] for each in drawn} == {1, 2, 3}
    assert {each["c"] for each in drawn} == {"a", "b"}


@pytest.mark.parametrize(
    ("template", "value"),
    [
        ({"uniform": [2.0, 2.0]}, 2.0),
        ({"uniform": [[1, 2], [1, 2]]}, [1.0, 2.0]),
        ({"log_uniform": [3.0, 3.0]}, 3.0),
        ({"normal": [5.0, 0.0]}, 5.0),
        ({"integers": [4, 4]}, 4),
        ({"choice": ["a"]}, "a"),
    ],
)
def test_a_range_may_be_a_single_value(template, value):
    assert draw(template=check(template, "scene", None)) == pytest.approx(value)


@given(st.integers(1, 3000))
def test_parts_have_their_shares_for_any_count(count):
    found = [split_of(index, _PARTS) for index in range(count)]
    for name, share in _PARTS:
        assert abs(found.count(name) - share * count) < 8


@given(st.integers(3, 60), st.integers(0, 5))
def test_held_out_values_are_in_one_part_each(count, seed):
    shares = shared_out(list(range(count)), _PARTS, seed)
    assert sorted(value for values in shares.values() for value in values) == list(range(count))
    assert all(shares.values())


def test_a_sequence_sees_its_own_parts_values_alone():
    template = check({"file": {"choice": list("abcdefghij"), "held_out": True}}, "scene", None)
    seen = {name: set() for name, _ in _PARTS}
    for index in range(300):
        split = split_of(index, _PARTS)
        seen[split].add(Drawer(Seeds(), index, 0, split, _PARTS).draw(template, "scene", "scene")["file"])
    assert {name: len(values) for name, values in seen.items()} == {"train": 7, "val": 2, "test": 1}
    assert not seen["train"] & seen["val"] and not seen["test"] & (seen["train"] | seen["val"])
    # Without parts nothing is held out.
    assert {draw(index, template=template)["file"] for index in range(300)} == set("abcdefghij")


@pytest.mark.parametrize(
    ("value", "sentence"),
    [
        ({"uniform": [1.0]}, "two numbers"),
        ({"uniform": [2.0, 1.0]}, "a low and a high end"),
        ({"uniform": [[0, 0], [1]]}, "two numbers"),
        ({"uniform": [[[0]], [[1]]]}, "two numbers"),
        ({"log_uniform": [0.0, 1.0]}, "a low and a high end"),
        ({"normal": [0.0, -1.0]}, "standard deviation"),
        ({"integers": [0.5, 2]}, "whole numbers"),
        ({"choice": []}, "a list of values"),
        ({"files": "none/*.glb"}, "no file matches"),
        ({"uniform": [0, 1], "held_out": True}, "held_out"),
        ({"uniform": [0.0, float("nan")]}, "two numbers"),
        ({"uniform": [0, 1], "choice": [2]}, "must have one distribution, got choice and uniform"),
        ({"held_out": False}, "must have one distribution, got held_out alone"),
    ],
)
def test_what_is_no_distribution(tmp_path, value, sentence):
    with pytest.raises(InputError, match=rf"scene\.x: .*{sentence}"):
        check({"x": value}, "scene", tmp_path)


def test_fewer_held_out_values_than_parts_are_told():
    with pytest.raises(InputError, match="2 held-out values cannot be shared out over 3 parts"):
        shared_out(["a", "b"], _PARTS, 0)


def test_only_the_scenes_seed_shares_out_what_is_held_out():
    template = check({"file": {"choice": list("abcdefghij"), "held_out": True}}, "scene", None)

    def seen(**seeds):
        parts = {name: set() for name, _ in _PARTS}
        for index in range(200):
            split = split_of(index, _PARTS)
            parts[split].add(Drawer(Seeds(**seeds), index, 0, split, _PARTS).draw(template, "scene", "scene")["file"])
        return parts

    assert seen() == seen(motion=7) == seen(sensor=7) == seen(noise=7)
    assert len({frozenset(seen(scene=seed)["train"]) for seed in range(4)}) > 1


@given(st.lists(st.floats(1e-3, 1.0), min_size=1, max_size=6), st.integers(0, 40), st.integers(0, 5))
def test_held_out_values_are_shared_out_whatever_the_shares(weights, more, seed):
    """Each part has one at least, however small it is and wherever it stands, and else about its share."""
    parts = tuple((f"part {k}", weight / sum(weights)) for k, weight in enumerate(weights))
    count = len(parts) + more
    shares = shared_out(list(range(count)), parts, seed)
    assert sorted(value for values in shares.values() for value in values) == list(range(count))
    for name, share in parts:
        assert len(shares[name]) >= 1 and abs(len(shares[name]) - share * count) <= len(parts)
