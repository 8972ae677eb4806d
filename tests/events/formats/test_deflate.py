"""Compressed chunks, read by HDF5's own filters."""

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from clsim.events.formats.tables.deflate import shuffled_and_deflated
from clsim.events.formats.tables.hdf5_growing import GrowingHdf5, compressed

KINDS = ("u1", "<u2", "<u4", "<f4", "<f8")


def pictures(kind: str) -> np.ndarray:
    """Two pictures: half of them smooth, half noise."""
    rng = np.random.default_rng(4)
    smooth = np.add.outer(np.arange(60), np.linspace(0, 5, 80))
    return np.stack([smooth, smooth + np.where(smooth > 30, 50 * rng.random(smooth.shape), 0)]).astype(kind)


@pytest.mark.parametrize("kind", KINDS)
def test_hdf5_reads_what_was_written(kind: str, tmp_path) -> None:
    values = pictures(kind)
    file = GrowingHdf5(tmp_path / "a.h5", lambda file: compressed(file, "a/b", values.shape[1:], kind))
    for k in range(2):
        file.append({"a/b": values[k : k + 1].astype(np.float64 if kind == "<u4" else kind)})
    file.close()
    with h5py.File(tmp_path / "a.h5") as read:
        assert (read["a/b"].compression, read["a/b"].shuffle, read["a/b"].dtype) == ("gzip", True, np.dtype(kind))
        np.testing.assert_array_equal(read["a/b"][:], values)


def test_what_repeats_shrinks_and_noise_hardly_grows() -> None:
    noise = np.random.default_rng(5).integers(0, 256, (200, 300), np.uint8)
    assert len(shuffled_and_deflated(noise)) < 1.001 * noise.nbytes
    assert len(shuffled_and_deflated(np.zeros((200, 300), np.float32))) < 0.01 * 4 * noise.nbytes
    depth = (2.0 + 0.01 * np.arange(60_000)).astype(np.float32)
    assert len(shuffled_and_deflated(depth)) < 0.8 * depth.nbytes


@given(hnp.arrays(st.sampled_from(KINDS), hnp.array_shapes(max_dims=3, max_side=40)))
@settings(max_examples=30, deadline=None)
def test_all_values_come_back(values: np.ndarray) -> None:
    with h5py.File("memory", "w", driver="core", backing_store=False) as file:
        dataset = compressed(file, "a", values.shape, values.dtype.str)
        dataset.resize(1, axis=0)
        dataset.id.write_direct_chunk((0,) * (values.ndim + 1), shuffled_and_deflated(values))
        assert dataset[0].tobytes() == values.tobytes()
