"""Batches to and from what other libraries speak: numpy, pandas, PyTorch, tonic and dv-processing.

An EventBatch already is a numpy array. Its events are packed in 13 bytes each, so that columns are strided: tonic takes
them in place, pandas and PyTorch get one contiguous copy a column.
"""

from __future__ import annotations

import importlib
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.events.batch import EVENT_DTYPE, EventBatch
from clsim.events.formats.columns import named

if TYPE_CHECKING:
    import dv_processing
    import pandas
    import torch

_TONIC_DTYPE = np.dtype(
    {
        "names": ["x", "y", "t", "p"],
        "formats": [EVENT_DTYPE[name] for name in ("x", "y", "t", "on")],
        "offsets": [EVENT_DTYPE.fields[name][1] for name in ("x", "y", "t", "on")] if EVENT_DTYPE.fields else [],
        "itemsize": EVENT_DTYPE.itemsize,
    }
)


def from_numpy(events: npt.NDArray[Any]) -> EventBatch:
    """Return a batch of a structured array, or of rows of whole numbers t [µs], x, y, p; an EventBatch is not copied.

    Fields may be called t, ts or timestamp; x; y; p, on or polarity (as in tonic, faery, dv-processing, expelliarmus).
    Polarity is 1, and 0 or -1. Raises InputError for anything else.
    """
    events = np.asarray(events)
    if events.dtype == EVENT_DTYPE and events.ndim == 1:
        return events
    if events.dtype.names is not None and events.ndim == 1:
        return _from_mapping({name: events[name] for name in events.dtype.names})
    if events.ndim == 2 and events.shape[1] == 4:
        return _from_mapping(dict(zip("txyp", events.T, strict=True)))
    raise InputError(
        f"an array of shape {events.shape} and type {events.dtype} holds no events; "
        "expected a structured array with t, x, y, p or rows of these four"
    )


def to_tonic(batch: EventBatch) -> npt.NDArray[Any]:
    """Return the batch with tonic's names x, y, t, p, sharing its memory."""
    return from_numpy(batch).view(_TONIC_DTYPE)


def to_pandas(batch: EventBatch) -> pandas.DataFrame:
    """Return a data frame with columns t [µs], x, y, p; needs pandas."""
    library = _need("pandas", "pandas")
    frame: pandas.DataFrame = library.DataFrame(_columns(batch), copy=False)
    return frame


def from_pandas(frame: pandas.DataFrame) -> EventBatch:
    """Return the batch of a data frame with columns named as in from_numpy."""
    return _from_mapping({str(name): frame[name].to_numpy() for name in frame.columns})


def to_torch(batch: EventBatch) -> dict[str, torch.Tensor]:
    """Return tensors t (int64, µs), x, y (int32) and p (bool); needs PyTorch."""
    library = _need("torch", "torch")
    columns = _columns(batch)
    # PyTorch computes next to nothing with uint16.
    for name in ("x", "y"):
        columns[name] = columns[name].astype(np.int32)
    return {name: library.from_numpy(column) for name, column in columns.items()}


def from_torch(tensors: Mapping[str, torch.Tensor]) -> EventBatch:
    """Return the batch of tensors named as in from_numpy, from whatever device they are on."""
    return _from_mapping({name: tensor.detach().cpu().numpy() for name, tensor in tensors.items()})


def to_event_store(batch: EventBatch) -> dv_processing.EventStore:
    """Return a dv-processing EventStore; needs dv-processing.

    It takes no arrays, only single events, so the batch goes through an uncompressed AEDAT4 file in shared memory.
    Raises InputError for coordinates beyond 32766: faery writes sensors of less than 32768 pixels a side; and for
    events that are not sorted by time.
    """
    batch = from_numpy(batch)
    library = _need("dv_processing", "dv-processing")
    import faery

    store: dv_processing.EventStore = library.EventStore()
    if not len(batch):
        return store
    width, height = int(batch["x"].max()) + 1, int(batch["y"].max()) + 1
    if max(width, height) >= 2**15:
        raise InputError(f"an event at {width - 1}, {height - 1} does not fit dv-processing, whose files end at 32766")
    if (np.diff(batch["t"]) < 0).any():
        raise InputError("events are not sorted by time, as dv-processing wants them; sort them by their field t")
    memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None) as folder:
        path = Path(folder) / "events.aedat4"
        stream = faery.events_stream_from_array(batch.view(faery.EVENTS_DTYPE), (width, height))
        stream.to_file(path, compression=None)
        recording = library.io.MonoCameraRecording(str(path))
        while (events := recording.getNextEventBatch()) is not None:
            store.add(events)
    return store


def from_event_store(store: dv_processing.EventStore) -> EventBatch:
    """Return the batch of a dv-processing EventStore."""
    return from_numpy(store.numpy())


def _columns(batch: EventBatch) -> dict[str, npt.NDArray[Any]]:
    return {
        name: np.ascontiguousarray(batch[field]) for name, field in zip("txyp", EVENT_DTYPE.names or (), strict=True)
    }


def _from_mapping(found: Mapping[str, npt.NDArray[Any]]) -> EventBatch:
    try:
        return named(found)
    except ValueError as error:
        raise InputError(f"events cannot be used: {error}") from None


def _need(module: str, package: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError:
        raise InputError(f"this conversion needs {package}; install it with: pip install {package}") from None
