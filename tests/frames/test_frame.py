import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from clsim.frames import ALL_PLANES, Frame, frame_time_us, page_aligned


def test_planes_are_views_by_name() -> None:
    frame = Frame(page_aligned((2, 4, 6)), ("R", "Depth"))
    frame.plane("Depth")[...] = 7
    assert (frame.planes[1] == 7).all() and (frame.planes[0] == 0).all()
    assert (frame.height, frame.width) == (4, 6)
    with pytest.raises(KeyError, match=r"Nx.*R, Depth"):
        frame.plane("Nx")


def test_copy_is_independent() -> None:
    frame = Frame(page_aligned((1, 2, 2)), ("R",), time_us=5, index=3)
    twin = frame.copy()
    frame.planes[...] = 1
    assert (twin.planes == 0).all() and (twin.time_us, twin.index) == (5, 3)


@pytest.mark.parametrize(
    "planes", [np.zeros((2, 2), np.float32), np.zeros((1, 2, 2)), np.zeros((1, 2, 4), np.float32)[:, :, ::2]]
)
def test_unusable_arrays_are_refused(planes: np.ndarray) -> None:
    with pytest.raises(ValueError, match="planes"):
        Frame(planes, ("R",))  # type: ignore[arg-type]


def test_plane_names_are_unique() -> None:
    assert len(set(ALL_PLANES)) == len(ALL_PLANES)


@given(st.integers(0, 10**9), st.sampled_from([24.0, 30.0, 59.94, 60.0, 120.0, 1000.0]))
def test_frame_times_do_not_drift(index: int, fps: float) -> None:
    assert abs(frame_time_us(index, fps) - index * 1e6 / fps) <= 0.5 + index * 1e6 / fps * 1e-15
