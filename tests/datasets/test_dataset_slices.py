"""Reading data sets: slices, voxel grids, shards; against the arrays that were written."""

from __future__ import annotations

import json
import shutil

import h5py
import numpy as np
import pytest

from clsim.cli.commands.info import _facts
from clsim.datasets.job import Done, read_done, sequence_folder
from clsim.datasets.load import Sequence, Slices, voxel_grid
from clsim.datasets.manifest import read_manifest, scan, write_manifest
from clsim.datasets.shards import write_shards
from clsim.errors import Error, InputError
from clsim.events import EVENT_DTYPE
from clsim.events.files import open_sink, open_source

_W, _H, _FRAME_US = 12, 9, 10_000
_COST = {"cpu_s": 1.5, "wall_s": 2.5}


def make_events(index):
    rng = np.random.default_rng(index)
    events = np.zeros(500, EVENT_DTYPE)
    events["t"] = np.sort(rng.integers(0, 40_000, 500))
    # Some at the very end, as pixels fire in the last frame.
    events["t"][-3:] = 40_000
    events["x"], events["y"] = rng.integers(0, _W, 500), rng.integers(0, _H, 500)
    events["on"] = rng.random(500) < 0.5
    return events


@pytest.fixture
def folder(tmp_path):
    """Five sequences as jobs leave them, of which number 3 was rejected and number 4 is torn."""
    import hashlib

    for index in range(5):
        place = sequence_folder(tmp_path, index)
        place.mkdir(parents=True)
        path = place / "events.h5"
        sink = open_sink(path, _W, _H)
        sink.write(make_events(index), 40_000)
        sink.close()
        with h5py.File(path, "r+") as file:
            file["frames/t"] = np.arange(0, 40_001, _FRAME_US)
            file["frames/depth"] = np.arange(5)[:, None, None] + np.zeros((5, _H, _W), np.float32)
        data = path.read_bytes()
        files = {"events.h5": (len(data), hashlib.sha256(data).hexdigest())} if index != 3 else {}
        split, rejected = "train" if index < 2 else "test", ("dark",) * (index == 3)
        done = Done(index, f"job {index}", split, files, {"events": 500}, rejected, index != 3, _COST)
        (place / "job.json").write_text(json.dumps(vars(done)))
    (sequence_folder(tmp_path, 4) / "events.h5").write_bytes(data[:-1])
    return tmp_path


@pytest.mark.parametrize(
    ("place", "split", "said"),
    [
        (".", "tset", "no sequences of the split 'tset', but test, train$"),
        ("sequences", "", "sequences: holds no sequences$"),
        ("no", "", "no: no such folder$"),
        ("no", "test", "no: no such folder$"),
    ],
)
def test_what_is_not_there_is_told(folder, place, split, said):
    with pytest.raises(InputError, match=said):
        next(iter(Slices(folder / place, split=split)))


def test_any_slice_of_time_has_its_events(folder):
    events = make_events(0)
    with Sequence(sequence_folder(folder, 0)) as sequence:
        assert (sequence.width, sequence.height, len(sequence)) == (_W, _H, 500)
        for start, end in (
            (0, 40_000),
            (3, 17),
            (999, 1001),
            (12_345, 23_456),
            (39_999, 90_000),
            (50_000, 60_000),
            (9, 9),
        ):
            expected = events[(events["t"] >= start) & (events["t"] < end)]
            np.testing.assert_array_equal(sequence.events(start, end), expected)
        np.testing.assert_array_equal(sequence.events(), events)
        with pytest.raises(InputError, match="no truth 'flow', but depth, t"):
            sequence.truth("flow", 0)
        assert (sequence.truth("depth", -1) == 4).all()
        np.testing.assert_array_equal(sequence.truth("depth", -5), sequence.truth("depth", 0))
        for frame in (5, -6):
            with pytest.raises(InputError, match=f"has 5 frames of truth, got frame {frame}"):
                sequence.truth("depth", frame)


def test_a_sequence_that_is_not_there_is_told(tmp_path):
    (tmp_path / "events.h5").write_text("of another kind")
    with pytest.raises(InputError, match=r"events.h5: is no sequence of a data set \("):
        Sequence(tmp_path)
    with pytest.raises(InputError, match="`shards` must be one of webdataset, parquet, got 'zip'"):
        write_shards(tmp_path, "zip")
    with pytest.raises(InputError, match=r"000009: no such file or folder; expected a sequence of a data set$"):
        Sequence(tmp_path / "000009")


def test_info_tells_what_a_data_set_holds_and_open_how_to_read_it(folder):
    (folder / "dataset.json").write_text(json.dumps({"name": "few", "split": ["train", "val", "test"]}))
    (folder / "contact-sheet.png").touch()
    facts = _facts(str(folder), strict=False)["data set"]
    assert facts["name"] == "few" and facts["splits"] == {"train": 2, "val": 0, "test": 1}
    assert (facts["sequences"], facts["rejected"], facts["events"]) == (3, 1, 1500)
    with pytest.raises(InputError, match=r"is a folder, expected a file of events; to read a data set, use clsim.data"):
        open_source(folder)
    with pytest.raises(InputError, match=r"is a folder, expected a file of events$"):
        open_source(folder / "sequences")
    (folder / "dataset.json").write_text("[")
    with pytest.raises(InputError, match=r"dataset.json: is damaged"):
        _facts(str(folder), strict=False)


def test_a_sequence_in_another_layout_is_told(tmp_path):
    (tmp_path / "sequence.dsec").mkdir()
    with pytest.raises(InputError, match="is in the layout dsec, which loaders of DSEC read; expected the layout h5"):
        Sequence(tmp_path)
    open_sink(tmp_path / "events.h5", _W, _H).close()  # which the specification may ask for beside it
    Sequence(tmp_path).close()


def test_times_of_a_file_may_begin_later(folder):
    """As in DSEC: ``t`` counts from ``t_offset``."""
    path, events = sequence_folder(folder, 0) / "events.h5", make_events(0)
    with h5py.File(path, "r+") as file:
        file["t_offset"][...] = 5_000_000
    with Sequence(path) as sequence:
        np.testing.assert_array_equal(sequence.events()["t"], events["t"] + 5_000_000)
        few = sequence.events(5_012_345, 5_023_456)
        assert len(few) == np.count_nonzero((events["t"] >= 12_345) & (events["t"] < 23_456))
        assert sequence.end_us == events["t"][-1] + 5_000_000
    with h5py.File(path, "r+") as file:
        file["frames/t"][-1] = 6_000_000
    with Sequence(path) as sequence:
        assert sequence.end_us == 6_000_000, "with the last frame, where nothing fires any more"


def test_slices_by_frames_bring_truth(folder):
    found = list(Slices(folder, split="train", truth=("depth",), bins=3))
    assert [each["sequence"] for each in found] == [0] * 4 + [1] * 4
    np.testing.assert_array_equal(np.concatenate([each["events"] for each in found[:4]]), make_events(0))
    for k, each in enumerate(found[:4]):
        assert (each["start_us"], each["end_us"]) == (k * _FRAME_US, (k + 1) * _FRAME_US)
        assert (each["depth"] == k).all()
        assert each["voxels"].shape == (3, _H, _W)


def test_slices_by_time_and_count(folder):
    times = list(Slices(folder, by="time", step=7000))
    assert {each["sequence"] for each in times} == {0, 1, 2}
    assert all(each["end_us"] - each["start_us"] == 7000 for each in times)
    # The last one ends with the sequence, and is whole.
    halves = list(Slices(folder, by="time", step=20_000))
    assert len(halves) == 6 and halves[1]["events"]["t"][-1] == 40_000
    counts = list(Slices(folder, by="count", step=120))
    assert [(len(e["events"]), e["events"]["t"][-1] - e["end_us"]) for e in counts] == [(120, 0)] * 12


def test_readers_share_sequences_and_orders_are_repeatable(folder):
    def order(**options):
        return [each["sequence"] for each in Slices(folder, by="count", step=500, **options)]

    assert sorted(order(worker=0, workers=2) + order(worker=1, workers=2)) == [0, 1, 2]
    orders = {tuple(order(shuffle_seed=seed)) for seed in range(12)}
    assert len(orders) > 1
    assert order(shuffle_seed=0) != order(), "0 is a seed as any other"
    assert order(shuffle_seed=4) == order(shuffle_seed=4)


def test_pytorchs_loader_makes_batches_of_the_same_slices(folder):
    data = pytest.importorskip("torch.utils.data", reason="needs PyTorch")
    from clsim.datasets.pytorch import TorchSlices

    slices = Slices(folder, truth=("depth",), bins=2)
    plain = {(each["sequence"], each["start_us"]): each["voxels"] for each in slices}
    for workers in (0, 1, 2):
        found = []
        for batch in data.DataLoader(TorchSlices(slices), batch_size=3, num_workers=workers):
            assert batch["depth"].shape[1:] == (_H, _W)
            found += zip(batch["sequence"].tolist(), batch["start_us"].tolist(), batch["voxels"].numpy(), strict=True)
        assert len(found) == len(plain)
        for sequence, start_us, voxels in found:
            np.testing.assert_array_equal(voxels, plain[sequence, start_us])
    lists = TorchSlices(Slices(folder, by="count", step=500))
    (first, *_) = data.DataLoader(lists, batch_size=None)
    np.testing.assert_array_equal(first["events"]["t"], make_events(0)["t"])


def test_readers_in_workers_of_pytorch_share_sequences(folder, monkeypatch):
    """A stand-in tells what PyTorch tells its workers, so that this is tested without it."""
    import sys
    from types import SimpleNamespace

    class Loader:
        number = 0

        @classmethod
        def get_worker_info(cls):
            return SimpleNamespace(id=cls.number, num_workers=2)

    monkeypatch.setitem(sys.modules, "torch.utils.data", Loader)
    seen = []
    for Loader.number in (0, 1):
        seen.append([each["sequence"] for each in Slices(folder, by="count", step=500)])
    assert seen == [[0, 2], [1]]
    seen.clear()
    for machine in (0, 1):
        for Loader.number in (0, 1):
            found = Slices(folder, by="count", step=500, worker=machine, workers=2)
            seen.append([each["sequence"] for each in found])
    assert seen == [[0], [1], [2], []]


def test_shards_hold_the_same_slices(folder):
    import webdataset

    shards = write_shards(folder, "webdataset", size=1)
    assert [each.name for each in shards] == ["test-000000.tar", "train-000000.tar", "train-000001.tar"]
    plain, packed = (list(Slices(place, split="train", truth=("depth",))) for place in (folder, folder / "shards"))
    assert len(plain) == len(packed) == 8
    for a, b in zip(plain, packed, strict=True):
        np.testing.assert_array_equal(a["events"], b["events"])
        np.testing.assert_array_equal(a["depth"], b["depth"])
    samples = list(webdataset.WebDataset([str(each) for each in shards], shardshuffle=False))
    assert [sample["__key__"] for sample in samples] == ["000002", "000000", "000001"]
    about = json.loads(samples[0]["json"])
    assert about["split"] == "test" and not {"cost", "files"} & set(about)
    assert set(samples[0]) >= {"events.h5", "json"}


def test_files_in_folders_are_of_their_sequences_sample(folder):
    """As those of the layout dsec are."""
    import webdataset

    place = sequence_folder(folder, 2)
    told = vars(read_done(place))
    (place / "sequence.dsec").mkdir()
    (place / "events.h5").rename(place / "sequence.dsec" / "events.h5")
    told["files"] = {"sequence.dsec/events.h5": told["files"]["events.h5"]}
    (place / "job.json").write_text(json.dumps(told))
    (sample,) = webdataset.WebDataset([str(write_shards(folder, "webdataset")[0])], shardshuffle=False)
    assert sample["__key__"] == "000002" and set(sample) >= {"sequence.dsec.events.h5", "json"}


def test_workers_share_shards(folder):
    write_shards(folder, "webdataset", size=1)
    alone, first, second = (
        [each["events"].tobytes() for each in Slices(folder / "shards", split="train", worker=worker, workers=workers)]
        for worker, workers in ((0, 1), (0, 2), (1, 2))
    )
    assert first and second and sorted(first + second) == sorted(alone)
    some = {next(iter(Slices(folder / "shards", shuffle_seed=seed)))["sequence"] for seed in range(12)}
    assert some == {0, 1, 2}, "shuffled, each comes first at times"
    plain, zero = ([each["sequence"] for each in Slices(folder / "shards", shuffle_seed=seed)] for seed in (None, 0))
    assert plain != zero, "0 is a seed as any other"


def test_shards_are_no_larger_than_asked_for(folder):
    held = sum(sum(size for size, _ in done.files.values()) for done in scan(folder) if done.split == "train")
    for size, count in ((held, 1), (held - 1, 2)):
        shards = write_shards(folder, "parquet", size=size)
        assert [each.name.startswith("train") for each in shards].count(True) == count


def test_each_shard_is_filled_anew(folder):
    """Of five sequences of one size, two fit a shard."""
    import pyarrow.parquet as parquet

    for index in range(5, 7):
        shutil.copytree(sequence_folder(folder, 0), sequence_folder(folder, index))
    for index in (0, 1, 2, 5, 6):
        place = sequence_folder(folder, index)
        told = vars(read_done(place)) | {"index": index, "split": ""}
        (place / "job.json").write_text(json.dumps(told))
    size = max(sum(size for size, _ in done.files.values()) for done in scan(folder))
    tables = [parquet.read_table(each).to_pydict() for each in write_shards(folder, "parquet", size=2 * size)]
    assert [sorted(set(table["sequence"])) for table in tables] == [[0, 1], [2, 5], [6]]


def test_shards_of_an_undivided_set_are_called_all(folder):
    for done in scan(folder):
        (sequence_folder(folder, done.index) / "job.json").write_text(json.dumps(vars(done) | {"split": ""}))
    assert [each.name for each in write_shards(folder, "webdataset")] == ["all-000000.tar"]
    assert len(list(Slices(folder / "shards", by="count", step=500))) == 3


def test_tables_of_events(folder):
    import pyarrow.parquet as parquet

    (test, train) = write_shards(folder, "parquet")
    table, events = parquet.read_table(train), np.concatenate([make_events(0), make_events(1)])
    assert table["sequence"].to_pylist() == [0] * 500 + [1] * 500
    for name, field in zip("txyp", ("t", "x", "y", "on"), strict=True):
        assert table[name].to_pylist() == events[field].tolist() and table[name].type.bit_width in (64, 16, 1)
    assert parquet.read_table(test).num_rows == 500


def test_the_manifest_tells_what_is_whole(folder):
    shutil.copytree(sequence_folder(folder, 1), folder / "sequences" / "000001 (copy)")
    write_manifest(folder)
    rows = read_manifest(folder)
    assert [row["index"] for row in rows] == [0, 1, 2, 3]
    assert [row["kept"] for row in rows] == [True, True, True, False]
    assert [row["rejected"] for row in rows] == [[], [], [], ["dark"]]
    assert rows[0]["path"] == "sequences/000000"
    assert rows[0]["bytes"] == (sequence_folder(folder, 0) / "events.h5").stat().st_size
    assert {name: rows[0][name] for name in (*_COST, "events")} == _COST | {"events": 500}
    assert [done.index for done in scan(folder)] == [0, 1, 2, 3]


def test_a_voxel_grid_keeps_every_event():
    events = make_events(0)
    grid = voxel_grid(events, 5, _H, _W)
    assert grid.sum() == pytest.approx(np.where(events["on"], 1, -1).sum(), abs=1e-3)
    # An event a quarter of the way from bin 1 to bin 2.
    few = np.array([(0, 0, 0, True), (1250, 3, 2, False), (4000, 1, 1, True)], EVENT_DTYPE)
    grid = voxel_grid(few, 5, _H, _W)
    assert (grid[1, 2, 3], grid[2, 2, 3]) == (-0.75, -0.25)
    assert (grid[0, 0, 0], grid[4, 1, 1]) == (1.0, 1.0)
    assert not voxel_grid(few[:0], 2, _H, _W).any()
    np.testing.assert_allclose(voxel_grid(events[::-1], 5, _H, _W), voxel_grid(events, 5, _H, _W), atol=1e-4)


@pytest.mark.parametrize(
    "options",
    [
        {"by": "x"},
        {"by": "time"},
        {"step": 5},
        {"by": "count", "step": 5, "truth": ("depth",)},
        {"by": "time", "step": 0.5},
        {"bins": -1},
        {"bins": 2.5},
        {"shuffle_seed": -1},
        {"split": None},
        {"worker": -1},
        {"worker": 2, "workers": 2},
        {"workers": 0},
        {"folder": None},
    ],
    ids=str,
)
def test_slices_that_cannot_be(tmp_path, options):
    with pytest.raises(InputError, match="`"):
        Slices(**{"folder": tmp_path} | options)


def test_one_name_of_truth_needs_no_brackets(folder):
    one, listed = (next(iter(Slices(folder, truth=truth))) for truth in ("depth", ["depth"]))
    assert np.array_equal(one["depth"], listed["depth"])


def test_what_a_sequence_cannot_tell_is_told(folder):
    with Sequence(sequence_folder(folder, 0)) as sequence:
        for ask, sentence in (
            (lambda: sequence.events_at(-10, -5), "`first` and `last` must be numbers of events from 0 on, got -10 "),
            (lambda: sequence.events_at(0, -5), "`first` and `last` must be numbers of events from 0 on, got 0 and -5"),
            (lambda: sequence.events(0.5), "`start_us` must be a whole number, got 0.5"),
            (lambda: sequence.events(0, float("nan")), "`end_us` must be a whole number, got nan"),
            (lambda: sequence.truth("depth", 1.5), "`frame` must be a whole number, got 1.5"),
            (lambda: voxel_grid(sequence.events(), 0, _H, _W), "`bins` must be at least 1, got 0"),
        ):
            with pytest.raises(InputError, match=sentence):
                ask()
        assert len(sequence.events(np.int64(0), np.uint16(40_000))) == 497
    for ask in (sequence.events, lambda: sequence.events_at(0, 1), lambda: sequence.truth("depth", 0)):
        with pytest.raises(Error, match="the sequence is closed"):
            ask()


def test_shards_do_not_hang_on_how_long_sequences_took(folder):
    """The same sequences, made on another machine, give the same bytes."""
    before = [each.read_bytes() for each in write_shards(folder, "webdataset")]
    for done in list(scan(folder)):
        slower = vars(done) | {"cost": {"cpu_s": 9.0, "wall_s": 9.5}}
        (sequence_folder(folder, done.index) / "job.json").write_text(json.dumps(slower))
    assert [each.read_bytes() for each in write_shards(folder, "webdataset")] == before


def test_shards_of_a_part_are_not_those_of_another_whose_name_goes_on(folder):
    shards = {each.name: each for each in write_shards(folder, "webdataset")}
    shards["test-000000.tar"].rename(folder / "shards" / "train-hard-1-000000.tar")
    for split, sequences in (("train", {0, 1}), ("train-hard-1", {2}), ("", {0, 1, 2})):
        assert {each["sequence"] for each in Slices(folder / "shards", split=split)} == sequences
    with pytest.raises(InputError, match=r"no sequences of the split 'train-hard', but train, train-hard-1$"):
        list(Slices(folder / "shards", split="train-hard"))
