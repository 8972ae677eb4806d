"""Values of the wrong type or size, given to the functions of the library: one sentence that names the parameter."""

import inspect
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import clsim
from clsim.events.outputs import FileOptions
from clsim.live import stream as stream_module
from clsim.live.options import LiveOptions

NO_REPR = type("NoRepr", (), {"__repr__": lambda self: 1 / 0})()

LONG = 300 * "a"
UNTYPED: Any = clsim
WRONG: dict[str, list[Any]] = {
    "scene": [3, None, b"still", "st\0ill", "\ud800", clsim.stream],
    "duration_s": ["1s", math.nan, math.inf, 0, True, 1e300, 10**400],
    "frame_count": ["3", 2.0, 0, math.nan, 1 << 64],
    "loop": [1, "yes", None],
    "fps": ["x", math.nan, math.inf, -1, 1j],
    "resolution": ["160*120", "160x120", (160,), (160, 120, 3), (1.5, 2), (0, 4), 160, {}],
    "threshold": [-1, 0, math.nan, "0.2", (0.2,), (0.2, -1), (0.2, math.inf), np.zeros(3)],
    "quality": ["best", 3, ["draft"], np.array(["draft", "draft"])],
    "outputs": [3, [3], (None,), "a.unknown", {"a.txt": 1}],
    "files": [3, 0, "text", {"frame": True}, {"frames": 3}],
    "seed": ["1", 1.0, -1, True, None],
    "spp": ["8", 8.5, 0, NO_REPR, 10**5000],
    "confidence": ["2", None, True, math.nan, math.inf],
    "method": ["v2e", 1],
    "gate": ["published", 1],
    "window": ["7", 7.0],
    "history": [None, 1.0],
    "follow_specular": ["no", 0],
    "max_depth": [None, "8", 0],
    "pace": ["fast", None],
    "governor": ["off"],
    "ring": ["lossy", None],
    "threads": ["all", 0, 1.0],
    "render_device": [0, None],
    "opencl": [0],
    "strict": ["yes"],
}
KEYWORDS = [name for name in inspect.signature(clsim.stream).parameters if name != "scene"]
JUNK = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(st.characters(), max_size=8)
    | st.binary(max_size=4)
    | st.complex_numbers()
    | st.sampled_from([10**400, int, np.float32(2), np.int64(3), np.zeros((2, 2)), Path("a.txt")])
    | st.sampled_from(["draft", "adaptive", "cached", "real", "drop-oldest", "independent", "a.txt", "tcp://:1", "-"]),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.lists(inner, max_size=3).map(tuple)
        | st.dictionaries(st.text(max_size=3) | st.sampled_from(["format", "frames", "text_time"]), inner, max_size=2)
    ),
    max_leaves=4,
)


def text_or_type(value: object) -> str:
    return value if isinstance(value, str) and value.isprintable() else type(value).__name__


@pytest.fixture
def options_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let `clsim.stream` return its options, and run nothing."""
    monkeypatch.setattr(stream_module, "Stream", lambda options, world=None: options)


@pytest.mark.parametrize(
    ("name", "value"), [(name, value) for name, values in WRONG.items() for value in values], ids=text_or_type
)
def test_a_wrong_value_is_told_with_its_name(options_alone: None, name: str, value: Any) -> None:
    with pytest.raises(clsim.InputError, match=r"\A[^\n]+\Z") as told:
        clsim.stream(**{"scene": "still", name: value})
    assert f"`{name}`" in str(told.value) or isinstance(value, str | dict)
    assert not any(word in str(told.value) for word in ("NoneType", "Literal", "typing", "tuple["))
    assert len(str(told.value)) < 400


@given(name=st.sampled_from(KEYWORDS), value=JUNK)
@example(name="files", value=np.zeros((2, 2)))
def test_any_value_is_used_or_refused(name: str, value: Any) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stream_module, "Stream", lambda options, world=None: options)
        try:
            options: Any = clsim.stream("still", **{name: value})
        except clsim.Error as error:
            assert str(error)
        else:
            assert LiveOptions.from_dict(vars(options)) == options


def test_one_value_stands_for_a_list_of_it(options_alone: None) -> None:
    def built(**given: Any) -> LiveOptions:
        options: Any = clsim.stream("still", **given)
        assert isinstance(options, LiveOptions)
        return options

    assert built(threshold=0.2).threshold == built(threshold=[0.2, 0.2]).threshold == (0.2, 0.2)
    assert built(threshold=1).threshold == (1.0, 1.0)
    assert built(outputs="x.aedat4").outputs == built(outputs=[Path("x.aedat4")]).outputs == ("x.aedat4",)
    assert built(resolution=np.array([16, 12]), loop=np.bool_(False)).resolution == (16, 12)
    assert built(seed=np.int64(3), fps=np.float32(2), files={"frames": False}).files == FileOptions()


@pytest.mark.parametrize("name", [name for name in inspect.signature(clsim.Simulator).parameters if name != "scene"])
def test_a_simulator_refuses_the_same(name: str) -> None:
    for value in WRONG.get(name, [3.5]):
        with pytest.raises(clsim.InputError, match=f"`{name}`"):
            clsim.Simulator("still", **{name: value})


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: UNTYPED.Simulator(3), "scene"),
        (lambda: UNTYPED.open(3), "path_or_url"),
        (lambda: UNTYPED.open("a\0.txt"), "path_or_url"),
        (lambda: UNTYPED.write(None, 4, 4), "path"),
        (lambda: UNTYPED.write("a.txt", "4", 4), "width"),
        (lambda: UNTYPED.write("a.txt", 4, 4.5), "height"),
        (lambda: UNTYPED.write("a.txt", 4, 4, format=3), "format"),
        (lambda: UNTYPED.load_scene(None), "scene"),
        (lambda: UNTYPED.load_scene("still", resolution=(160,)), "resolution"),
        (lambda: UNTYPED.load_scene("still", resolution="160*120"), "resolution"),
        (lambda: UNTYPED.load_scene("still", strict="no"), "strict"),
    ],
)
def test_files_and_scenes_name_the_parameter_too(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, call: Callable[[], object], name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(clsim.InputError, match=f"`{name}` must be"):
        call()


@pytest.mark.parametrize("opened", [clsim.open, clsim.load_scene, lambda name: clsim.write(name, 4, 4)])
@pytest.mark.parametrize("name", ["", ".", LONG, f"{LONG}.txt", f"{LONG}.toml", "no/such.txt", "tcp://"])
def test_names_that_lead_nowhere(opened: Callable[[str], object], name: str) -> None:
    with pytest.raises(clsim.InputError):
        opened(name)


def test_what_is_written_must_be_an_array_of_events(tmp_path: Path) -> None:
    with UNTYPED.write(tmp_path / "a.txt", 4, 4) as out:
        for events, end_us in (([], 3), (np.zeros(2), 3), (np.zeros(0, clsim.EVENT_DTYPE), "3")):
            with pytest.raises(clsim.InputError):
                out.write(events, end_us)


def test_objects_beside_events_follow_from_truth_alone() -> None:
    given = {"scene": "two-boxes", "outputs": ("a.parquet", "a.h5"), "files": {"labels": True, "objects": True}}
    assert not LiveOptions(**given).files.objects
    assert LiveOptions(**given, truth="labels").files.objects
    with pytest.raises(clsim.InputError, match="`objects` follows from `truth`"):
        FileOptions(labels=True, objects=True).check(["a.parquet"])
