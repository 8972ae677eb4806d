"""PNG images, against OpenCV's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from clsim.errors import InputError
from clsim.truth.writing.png import read_png, write_png


@given(
    arrays.arrays(
        st.sampled_from([np.uint8, np.uint16]),
        st.one_of(
            st.tuples(st.integers(1, 9), st.integers(1, 9)),
            st.tuples(st.integers(1, 9), st.integers(1, 9), st.just(3)),
        ),
    )
)
@settings(max_examples=40, deadline=None)
def test_png_is_opencvs(tmp_path_factory: pytest.TempPathFactory, image: np.ndarray) -> None:
    cv2 = pytest.importorskip("cv2")
    path = tmp_path_factory.getbasetemp() / "a.png"
    write_png(path, image)
    theirs = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(theirs[..., ::-1] if image.ndim == 3 else theirs, image)
    assert theirs.dtype == image.dtype and np.array_equal(read_png(path), image)
    # OpenCV chooses among all filters.
    cv2.imwrite(str(path), image[..., ::-1] if image.ndim == 3 else image, [cv2.IMWRITE_PNG_STRATEGY, 0])
    assert np.array_equal(read_png(path), image)


Y, X = np.mgrid[:40, :50]
SMOOTH = np.stack([Y * 900 + X, X * 1200, (X + Y) * 700], axis=-1).astype(np.uint16)
FEW_VALUES = np.random.default_rng(0).integers(0, 6, (40, 50, 3), dtype=np.uint8)
"""Neighbours are often equally near to what a filter guesses."""


@pytest.mark.parametrize("image", [SMOOTH, FEW_VALUES], ids=["smooth", "few values"])
def test_all_filters_of_png_are_undone(tmp_path: Path, image: np.ndarray) -> None:
    cv2 = pytest.importorskip("cv2")
    for flag in ("NONE", "SUB", "UP", "AVG", "PAETH"):
        value = getattr(cv2, f"IMWRITE_PNG_FILTER_{flag}", None) or getattr(cv2, f"IMWRITE_PNG_{flag}_FILTER", None)
        if value is None:
            continue
        cv2.imwrite(str(tmp_path / "a.png"), image[..., ::-1], [cv2.IMWRITE_PNG_FILTER, value])
        assert np.array_equal(read_png(tmp_path / "a.png"), image), flag


@given(st.binary(max_size=300))
@settings(max_examples=60, deadline=None)
def test_rubbish_is_no_png(tmp_path_factory: pytest.TempPathFactory, rubbish: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "rubbish.png"
    for head in (b"", b"\x89PNG\r\n\x1a\n"):
        path.write_bytes(head + rubbish)
        with pytest.raises(InputError):
            read_png(path)
