"""A data set as PyTorch's loaders take it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from torch.utils.data import IterableDataset

from clsim.datasets.load import Slices
from clsim.events.convert import to_torch


class TorchSlices(IterableDataset):  # type: ignore[misc]
    """Slices of a data set for ``torch.utils.data.DataLoader``; each of its workers reads sequences of its own.

    With voxel grids, a slice has no list of events: all else has one shape, so that loaders make batches of it. Without
    them, ``events`` is what `to_torch` makes of it, and as many events as there are: load with ``batch_size=None``.
    """

    def __init__(self, slices: Slices) -> None:
        """Take the ``slices`` that are to be iterated over."""
        self._slices = slices

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """Yield the slices, as a dictionary each."""
        for made in self._slices:
            events = made.pop("events")
            yield made if self._slices.bins else made | {"events": to_torch(events)}
