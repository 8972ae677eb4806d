"""Files that keep the cause of each event name its numbers."""

from pathlib import Path

import h5py
import pytest

from clsim.events import EVENT_DTYPE
from clsim.events.batch import CAUSES
from clsim.events.files import open_sink, open_source
from tests.events.event_data import HEIGHT, WIDTH, events


@pytest.mark.parametrize("ending", [".h5", ".parquet"])
def test_the_names_of_causes_stand_in_the_order_of_their_numbers(tmp_path: Path, ending: str) -> None:
    path, batch = tmp_path / f"a{ending}", events(len(CAUSES)).astype(EVENT_DTYPE)
    sink = open_sink(path, WIDTH, HEIGHT, labels=("cause",))
    sink.write(batch, int(batch["t"][-1]), range(len(CAUSES)))  # type: ignore[call-arg]
    sink.close()
    if ending == ".h5":
        with h5py.File(path, "r") as file:
            names = list(file["events/cause"].attrs["causes"])
    else:
        from pyarrow import parquet

        names = parquet.read_schema(path).metadata[b"causes"].decode().split(",")
    with open_source(path, labels=("cause",)) as source:
        told = [names[number] for number in source.read()["cause"]]
    assert tuple(told) == CAUSES
