"""Every format: opened by name, round trips, refusals, hostile files, bounded memory."""

import io
import itertools
import json
import subprocess
import sys
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from clsim.errors import InputError
from clsim.events import EVENT_DTYPE
from clsim.events.batch import SinkError
from clsim.events.files import FORMATS, open_sink, open_source
from clsim.events.formats.filesink import FlushPolicy
from clsim.events.formats.filesource import EventSource
from clsim.events.sidecar import sidecar_path, write_sidecar
from tests.events.event_data import ALL_OR_NOTHING, ENDINGS, HEIGHT, WIDTH, end_of, events, read, split, write


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_file_gives_back_its_events_and_its_size(tmp_path, ending):
    batch = events(5000)
    path = write(tmp_path / f"a{ending}", split(batch))
    assert np.array_equal(read(path), batch)
    source = open_source(path)
    assert (source.width, source.height) == ((None, None) if ending in (".txt", ".csv") else (WIDTH, HEIGHT))
    source.close()


@pytest.mark.parametrize(("first", "second"), list(itertools.product(ENDINGS, ENDINGS)))
def test_every_pair_of_formats_converts_without_change(tmp_path, first, second):
    batch = events(300)
    source = open_source(write(tmp_path / f"a{first}", [batch]))
    assert np.array_equal(read(write(tmp_path / f"b{second}", source)), batch)


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_file_written_over_a_longer_one_holds_nothing_of_that(tmp_path, ending):
    short = events(30)
    fresh = write(tmp_path / f"fresh{ending}", [short]).read_bytes()
    write(tmp_path / f"a{ending}", split(events(5000, seed=2)))
    assert write(tmp_path / f"a{ending}", [short]).read_bytes() == fresh
    assert np.array_equal(read(tmp_path / f"a{ending}"), short)


@pytest.mark.parametrize("ending", ENDINGS)
def test_no_events_make_a_valid_file(tmp_path, ending):
    source = open_source(write(tmp_path / f"a{ending}", []))
    assert (source.width, source.height) == ((None, None) if ending in (".txt", ".csv") else (WIDTH, HEIGHT))
    assert len(source.read()) == 0


@pytest.mark.parametrize("ending", ENDINGS)
def test_bytes_are_the_same_on_every_run_and_for_every_partition(tmp_path, ending):
    batch = events(2000)
    whole = FlushPolicy(events=1 << 16, interval_us=np.inf)
    a = write(tmp_path / f"a{ending}", [batch], flush=whole)
    b = write(tmp_path / f"b{ending}", split(batch), flush=whole)
    assert a.read_bytes() == b.read_bytes()


event_lists = st.lists(
    st.tuples(st.integers(0, 2**32 - 1), st.integers(0, WIDTH - 1), st.integers(0, HEIGHT - 1), st.booleans()),
    max_size=30,
)


@pytest.mark.parametrize("ending", [each for each in ENDINGS if each != ".es"])
@given(rows=event_lists, pieces=st.integers(1, 4))
@settings(max_examples=25, deadline=None)
def test_any_events_survive(tmp_path_factory, ending, rows, pieces):
    if ending == ".h5" and rows:  # its index has an entry a millisecond
        start = min(row[0] for row in rows)
        rows = [(start + (t - start) % 10_000_000, *rest) for t, *rest in rows]
    batch = np.array(sorted(rows), EVENT_DTYPE) if rows else np.empty(0, EVENT_DTYPE)
    path = write(tmp_path_factory.mktemp("any") / f"a{ending}", split(batch, pieces), flush=FlushPolicy(events=4))
    assert np.array_equal(read(path), batch)


@given(rows=event_lists)
@settings(max_examples=25, deadline=None)
def test_any_events_survive_es(tmp_path_factory, rows):
    batch = np.array(sorted((t % 10_000_000, *rest) for t, *rest in rows), EVENT_DTYPE)
    assert np.array_equal(read(write(tmp_path_factory.mktemp("any") / "a.es", split(batch, 3))), batch)


# What each format can hold: (ending, largest side, last time that fits).
LIMITS = (
    (".aedat4", 2**15, None),
    (".txt", 2**16, None),
    (".raw", 2**11, 2**34 - 1),
    (".evt3.raw", 2**11, 2**40 - 1),
    (".dat", 2**14, 2**32 - 1),
    (".es", 2**16 - 1, None),
    (".h5", 2**16, None),
    (".parquet", 2**16, None),
    (".npz", 2**16, None),
)


@pytest.mark.parametrize(("ending", "side", "last_us"), LIMITS)
def test_a_format_takes_what_it_can_hold_and_refuses_more(tmp_path, ending, side, last_us):
    with pytest.raises(InputError, match=f"width {side + 1} does not fit .*{side}"):
        open_sink(tmp_path / f"a{ending}", side + 1, 10)
    with pytest.raises(InputError, match="height 0"):
        open_sink(tmp_path / f"a{ending}", 10, 0)
    assert not list(tmp_path.iterdir())

    corner = np.array([(last_us or 3_000_000, side - 1, side - 1, True)], EVENT_DTYPE)
    sink = open_sink(tmp_path / f"a{ending}", side, side)
    sink.write(corner, end_of(corner))
    sink.close()
    assert np.array_equal(read(tmp_path / f"a{ending}"), corner)

    if last_us is not None:
        corner["t"] += 1
        sink = open_sink(tmp_path / f"b{ending}", side, side)
        with pytest.raises(InputError, match=f"{last_us + 1} µs is too late for .* {last_us} µs"):
            sink.write(corner, end_of(corner))
        sink.close()
        assert len(read(tmp_path / f"b{ending}")) == 0


@pytest.mark.parametrize("ending", ENDINGS)
def test_wrong_events_are_refused_in_one_sentence_and_the_file_stays_good(tmp_path, ending):
    good = np.array([(100, 1, 2, True)], EVENT_DTYPE)
    sink = open_sink(tmp_path / f"a{ending}", WIDTH, HEIGHT)
    with pytest.raises(InputError, match="-1 µs is negative"):
        sink.write(np.array([(-1, 0, 0, True)], EVENT_DTYPE), -1)
    sink.write(good, end_of(good))
    with pytest.raises(InputError, match="goes back from 100 µs to 99 µs"):
        sink.write(np.array([(99, 0, 0, True)], EVENT_DTYPE), 99)
    with pytest.raises(InputError, match="goes back from 300 µs to 200 µs"):
        sink.write(
            np.array([(300, 0, 0, True), (200, 0, 0, True)], EVENT_DTYPE),
            200,
        )
    with pytest.raises(InputError, match=f"x = {WIDTH} lies outside"):
        sink.write(np.array([(100, WIDTH, 0, True)], EVENT_DTYPE), 100)
    with pytest.raises(InputError, match=f"y = {HEIGHT} lies outside"):
        sink.write(np.array([(100, 0, HEIGHT, True)], EVENT_DTYPE), 100)
    sink.close()
    assert np.array_equal(read(tmp_path / f"a{ending}"), good)
    with pytest.raises(SinkError, match="closed"):
        sink.write(good, end_of(good))
    sink.close()


@pytest.mark.parametrize(("ending", "most_us"), [(".es", 2**32 - 1), (".h5", 2**32 - 60_000_001)])
def test_a_gap_that_would_swell_the_file_is_refused(tmp_path, ending, most_us):
    sink = open_sink(tmp_path / f"a{ending}", WIDTH, HEIGHT)
    sink.write(np.array([(1, 0, 0, True)], EVENT_DTYPE), 1)
    for late_us in (most_us + 2, 2**40):
        with pytest.raises(InputError, match=rf"(without an event|too late) .* {most_us} µs$"):
            sink.write(np.array([(late_us, 0, 0, True)], EVENT_DTYPE), late_us)
    sink.close()
    assert len(read(tmp_path / f"a{ending}")) == 1


def test_times_of_day_survive_hdf5(tmp_path):
    batch = events(1000, start_us=1_700_000_000_123_456, span_us=5_000_000)
    assert np.array_equal(read(write(tmp_path / "a.h5", split(batch))), batch)


def test_unknown_endings_formats_and_options_are_named(tmp_path):
    with pytest.raises(InputError, match=r'"\.xyz" is no known event format; expected one of: .*\.aedat4.*\.npz'):
        open_sink(tmp_path / "a.xyz", 10, 10)
    with pytest.raises(InputError, match=r"no known event format"):
        open_source(tmp_path / "noending")
    with pytest.raises(InputError, match='"evt9" is unknown; expected one of: aedat4'):
        open_sink(tmp_path / "a.raw", 10, 10, format="evt9")
    with pytest.raises(InputError, match="text has no option color; expected one of: time_unit"):
        open_sink(tmp_path / "a.txt", 10, 10, color="red")
    with pytest.raises(InputError, match='time unit "h" is unknown'):
        open_sink(tmp_path / "a.txt", 10, 10, time_unit="h")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("ending", ENDINGS)
def test_paths_that_cannot_be_written_are_refused_at_once(tmp_path, ending):
    with pytest.raises(InputError, match="cannot be written"):
        open_sink(tmp_path / "missing" / f"a{ending}", 10, 10)
    (tmp_path / f"folder{ending}").mkdir()
    with pytest.raises(InputError, match="cannot be written"):
        open_sink(tmp_path / f"folder{ending}", 10, 10)
    with pytest.raises(InputError, match="cannot be read"):
        open_source(tmp_path / f"missing{ending}")
    with pytest.raises(InputError, match="cannot be read"):
        open_source(tmp_path / f"folder{ending}")
    assert [each.name for each in tmp_path.iterdir()] == [f"folder{ending}"]


def test_the_format_can_be_named_where_the_ending_cannot(tmp_path):
    batch = events(100)
    sink = open_sink(tmp_path / "a.raw", WIDTH, HEIGHT, format="evt3")
    sink.write(batch, end_of(batch))
    sink.close()
    assert b"EVT3" in (tmp_path / "a.raw").read_bytes()
    assert np.array_equal(read(tmp_path / "a.raw"), batch)


def test_every_format_states_what_a_kill_costs():
    assert all("kill loses" in each.promise for each in FORMATS)


@pytest.mark.filterwarnings("ignore::clsim.errors.Notice")
@pytest.mark.parametrize("ending", ENDINGS)
def test_a_file_cut_anywhere_gives_its_first_events_or_one_sentence(tmp_path, ending):
    batch = events(400)
    whole = write(tmp_path / f"a{ending}", split(batch), flush=FlushPolicy(events=50)).read_bytes()
    cut = tmp_path / f"cut{ending}"
    counts = set()
    for size in np.unique(np.linspace(0, len(whole) - 1, 60).astype(int)):
        cut.write_bytes(whole[:size])
        try:
            found = read(cut)
        except InputError as error:
            assert str(cut) in str(error) and "\n" not in str(error)
            continue
        assert np.array_equal(found, batch[: len(found)])
        counts.add(len(found))
    if ending != ".h5" and ending not in ALL_OR_NOTHING:
        assert len(counts) > 5  # what is whole is delivered


@pytest.mark.filterwarnings("ignore::clsim.errors.Notice")
@pytest.mark.parametrize("ending", [".txt", ".csv"])
def test_a_line_of_text_that_a_kill_tore_is_left_out_wherever_it_ends(tmp_path, ending):
    batch = events(20)
    whole = write(tmp_path / f"a{ending}", [batch]).read_bytes()
    for size in range(whole[:-1].rfind(b"\n") + 1, len(whole) + 1):
        (tmp_path / f"cut{ending}").write_bytes(whole[:size])
        # The last field has one digit, and nothing else is missing with the end of the line.
        left = 20 - (size < len(whole) - 1)
        assert np.array_equal(read(tmp_path / f"cut{ending}"), batch[:left]), whole[size - 9 : size]


@pytest.mark.filterwarnings("ignore::clsim.errors.Notice")
@pytest.mark.parametrize("ending", ENDINGS)
def test_damaged_bytes_never_raise_anything_but_input_errors(tmp_path, ending):
    rng = np.random.default_rng(3)
    whole = np.frombuffer(write(tmp_path / f"a{ending}", [events(200)]).read_bytes(), np.uint8)
    path = tmp_path / f"bad{ending}"
    refused = 0
    for attempt in range(60):
        data = whole.copy()
        where = rng.integers(0, min(len(data), 400 if attempt % 2 else len(data)), 1 + attempt % 5)
        data[where] = rng.integers(0, 256, len(where))
        path.write_bytes(data.tobytes())
        try:
            read(path)
        except InputError as error:
            refused += 1
            assert "\n" not in str(error)
    path.write_bytes(rng.integers(0, 256, 5000).astype(np.uint8).tobytes())
    with pytest.raises(InputError):
        read(path)
    assert refused or ending in (".raw", ".evt3.raw")  # which drops what a camera may send by mistake


@pytest.mark.slow
@pytest.mark.parametrize("ending", [each for each in ENDINGS if each != ".csv"])
def test_a_file_larger_than_memory_would_stream(tmp_path, ending):
    # Text is slow under tracemalloc, but takes ten times the memory if it is held as Python numbers.
    count, allowed = (300_000, 30e6) if ending == ".txt" else (1_500_000, 45e6 if ending == ".parquet" else 19e6)
    batch = events(count)  # 13 bytes each
    path = tmp_path / f"a{ending}"
    tracemalloc.start()
    try:
        write(path, np.split(batch, 150))
        writing = tracemalloc.get_traced_memory()[1]
        tracemalloc.reset_peak()
        assert sum(len(each) for each in open_source(path)) == count
        reading = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert max(writing, reading) < allowed


def test_a_library_that_panics_is_a_damaged_file_but_an_interrupt_passes(tmp_path):
    class PanicException(BaseException):
        """As pyo3 raises it."""

    def batches(error):
        yield events(1)
        raise error

    for error, expected in (
        (PanicException("index out of range"), InputError),
        (KeyboardInterrupt(), KeyboardInterrupt),
    ):
        source = EventSource(tmp_path / "a.raw", None, None, batches(error))
        if expected is InputError:  # an interrupt does not wait for what came before
            assert len(next(source)) == 1
        with pytest.raises(expected):
            next(source)


def test_formats_load_their_libraries_only_when_used():
    code = (
        "import sys, clsim.events.files\n"
        "print([name for name in ('h5py', 'faery', 'pyarrow', 'lz4', 'pandas', 'torch') if name in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"


def test_a_missing_extra_is_named(tmp_path, monkeypatch):
    path = write(tmp_path / "a.parquet", [])
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    for attempt in (lambda: open_sink(tmp_path / "b.parquet", 10, 10), lambda: open_source(path)):
        with pytest.raises(InputError, match=r"needs pyarrow; install it with: pip install 'clsim\[parquet\]'"):
            attempt()


def test_the_sidecar_is_whole_or_absent(tmp_path):
    path = sidecar_path(tmp_path / "a.raw")
    assert path.name == "a.raw.json"
    write_sidecar(path, {"seed": 1, "τ": [0.5]})
    with pytest.raises(TypeError):
        write_sidecar(path, {"seed": object()})
    assert json.loads(path.read_text(encoding="utf-8")) == {"seed": 1, "τ": [0.5]}
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(InputError, match="cannot be written"):
        write_sidecar(tmp_path / "missing" / "a.json", {})


@pytest.mark.filterwarnings("ignore::clsim.errors.Notice")
def test_text_is_read_however_people_write_it(tmp_path):
    expected = np.array([(1_000_000_001, 3, 4, True), (1_000_000_002, 5, 6, False)], EVENT_DTYPE)
    for name, text in {
        "seconds.txt": "1000.000001 3 4 1\n1000.000002 5 6 0\n",
        "minus.txt": "1000000001 3 4 1\n1000000002 5 6 -1\n",
        "no_newline.txt": "1000000001 3 4 1\n1000000002 5 6 0",
        "torn.txt": "1000000001 3 4 1\n1000000002 5 6 0\n1000000003 7",
        "tabs.txt": "# v2e\n# columns: t x y p\n1000000001\t3\t4\t1\r\n1000000002\t5\t6\t0\r\n",
        "header.csv": "t,x,y,p\n1000000001,3,4,1\n1000000002,5,6,0\n",
    }.items():
        (tmp_path / name).write_text(text)
        assert np.array_equal(read(tmp_path / name), expected), name


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 2 3 1\n1 2 3\n", "columns"),
        ("1 2 3 1\n1 2 x 1\n", "expected lines of t x y p"),
        ("1 2 3 7\n", "column p has 7.0 in row 0; expected 0 and 1"),
        ("1 -2 3 1\n", "column x has -2.0 in row 0; expected 0 to 65535"),
        ("1 2 70000 1\n", "column y has 70000.0 in row 0"),
        ("nan 2 3 1\n", "names the columns nan, 2, 3, 1"),
        ("1.5 2 3 1\nnan 2 3 1\n", "number of seconds"),
        ("-5 2 3 1\n", "column t has -5 in row 0"),
        ("x" * 5_000_000, "names the columns x*;"),
        ("1" * 5_000_000, "no lines"),
    ],
)
def test_wrong_text_is_refused(tmp_path, text, message):
    (tmp_path / "a.txt").write_text(text)
    with pytest.raises(InputError, match=message):
        read(tmp_path / "a.txt")


def test_an_archive_with_objects_is_not_unpickled(tmp_path):
    buffer = io.BytesIO()
    np.savez(buffer, t=np.array([object()]), x=np.zeros(1, int), y=np.zeros(1, int), p=np.zeros(1, int))
    (tmp_path / "a.npz").write_bytes(buffer.getvalue())
    with pytest.raises(InputError, match="object"):
        read(tmp_path / "a.npz")


@pytest.mark.parametrize("width", [np.float64(346.5), np.array([346]), np.bool_(True)])
def test_an_archive_whose_width_is_no_whole_number_is_refused(tmp_path, width):
    columns = {name: np.zeros(1, int) for name in "txyp"}
    np.savez(tmp_path / "a.npz", **columns, width=width, height=np.int64(260))
    with pytest.raises(InputError, match="its width is no whole number"):
        read(tmp_path / "a.npz")
