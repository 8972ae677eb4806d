"""Events coloured by what caused them: read from files, sent to the page, drawn, and refused where nobody knows."""

import asyncio
import json
import shutil
import subprocess
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import clsim as library
from clsim.errors import InputError
from clsim.events import CAUSES, EventBatch, with_causes
from clsim.events.files import open_sink, open_source
from clsim.live.view.accumulate import cause_indices
from clsim.live.view.colormaps import CAUSE, CAUSE_LEVELS, Theme, lut
from clsim.live.view.packets import PACKET_EVENTS, event_packets
from clsim.live.view.picture import Film, Look, write_picture
from tests.events.event_data import end_of
from tests.live.view.test_view_image import lab, simulate
from tests.live.view.view_events import random_events

WIDTH, HEIGHT = 20, 10
EVENTS = random_events(3000, WIDTH, HEIGHT, begin_us=1_000_000, end_us=1_100_000)
CAUSED = with_causes(EVENTS, (np.arange(3000) * 7 % len(CAUSES)).astype(np.uint8))


def record(path: Path, **options: Any) -> Path:
    sink = open_sink(path, WIDTH, HEIGHT, **options)
    for start in range(0, len(EVENTS), 700):
        part = CAUSED[start : start + 700]
        given = {"causes": part["cause"]} if options else {}
        sink.write(EVENTS[start : start + 700], end_of(part), **given)
    sink.close()
    return path


@pytest.fixture(params=[".h5", ".parquet"])
def labelled(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    if request.param == ".parquet":
        pytest.importorskip("pyarrow")
    return record(tmp_path / f"labelled{request.param}", labels=("cause",))


def test_causes_are_read_when_they_are_asked_for(labelled: Path) -> None:
    with open_source(labelled) as source:
        assert source.labelled == ("cause",)
        assert np.array_equal(source.read(), EVENTS)
    assert np.array_equal(library.open(labelled, labels=("cause",)).read(), CAUSED)


def test_a_cause_that_there_is_not_is_damage(tmp_path: Path) -> None:
    sink = open_sink(tmp_path / "a.h5", WIDTH, HEIGHT, labels=("cause",))
    sink.write(EVENTS, end_of(EVENTS), np.full(len(EVENTS), len(CAUSES), np.uint8))
    sink.close()
    with pytest.raises(InputError, match=r"a\.h5.* cause 4; expected 0 to 3"):
        open_source(tmp_path / "a.h5", labels=("cause",)).read()


@pytest.mark.parametrize("name", ["a.h5", "a.aedat4"])
def test_where_nobody_knows_causes_that_is_told(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=f"{name}: its events have no cause; expected HDF5 or Parquet"):
        library.open(record(tmp_path / name), labels=("cause",))


def drawn(events: EventBatch, full: float, end_us: int, decay_us: float | None) -> list[list[int]]:
    """The same by a plain loop: the colour of the newest event's cause, as strong as there are events."""
    sums = np.zeros((HEIGHT, WIDTH))
    causes = np.zeros((HEIGHT, WIDTH), int)
    for event in events:
        sums[event["y"], event["x"]] += 1 if decay_us is None else np.exp((event["t"] - end_us) / decay_us)
        causes[event["y"], event["x"]] = event["cause"]
    return (64 * causes + np.rint(63 * np.minimum(sums / full, 1))).astype(int).tolist()


@pytest.mark.parametrize("decay_us", [None, 20_000.0])
def test_a_picture_is_that_of_a_plain_loop(decay_us: float | None) -> None:
    few = CAUSED[::21]
    image = cause_indices(few, WIDTH, HEIGHT, 4.0, end_us=1_100_000, decay_us=decay_us)
    assert image.tolist() == drawn(few, 4.0, 1_100_000, decay_us)


PAGE_SCRIPT = """
import { readFileSync } from "node:fs";
import { EventImage } from "./image.js";
import { Store } from "./store.js";

const { width, height, events, drawings } = JSON.parse(readFileSync(0, "utf8"));
const context = { putImageData() {}, createImageData: (w, h) => ({ data: new Uint8ClampedArray(4 * w * h) }) };
const image = new EventImage({ getContext: () => context });
image.resize(width, height);
const store = new Store();
// The sign of an event is a bit of its y, as packets have it.
const on = events.y.map((y, k) => y | (events.on[k] ? 0x8000 : 0));
store.add(0, events.t[events.t.length - 1], events.t, events.x, on, events.cause);
const table = Uint32Array.from({ length: 256 }, (_, k) => k);
console.log(JSON.stringify(drawings.map(({ nowUs, windowUs, decay, full }) => {
  image.draw(store, nowUs, { windowUs, decay, full }, { table, byCause: true });
  return Array.from(image.pixels);
})));
"""


@pytest.mark.skipif(shutil.which("node") is None, reason="the page's script runs in Node.js here")
def test_the_page_draws_the_picture_of_a_plain_loop(tmp_path: Path) -> None:
    for name in ("image.js", "store.js"):
        (tmp_path / name).write_text(files("clsim.live.view").joinpath("page", name).read_text(encoding="utf-8"))
    (tmp_path / "package.json").write_text('{"type": "module"}')
    (tmp_path / "draw.js").write_text(PAGE_SCRIPT)
    few, end_us = CAUSED[::21], int(CAUSED["t"][-1])
    columns = {name: few[name].astype(int).tolist() for name in few.dtype.names or ()}
    drawings = [
        {"nowUs": end_us, "windowUs": 1_000_000, "decay": False, "full": 4},
        {"nowUs": end_us, "windowUs": 20_000, "decay": True, "full": 4},
    ]
    told = subprocess.run(
        ["node", str(tmp_path / "draw.js")],
        input=json.dumps({"width": WIDTH, "height": HEIGHT, "events": columns, "drawings": drawings}),
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    window, fading = (np.array(pixels).reshape(HEIGHT, WIDTH) for pixels in json.loads(told.stdout))
    assert window.tolist() == drawn(few, 4.0, end_us, None)
    # Behind five of its time constants the page takes nothing, and its sums are float32.
    near = np.array(drawn(few[few["t"] >= end_us - 100_000], 4.0, end_us, 20_000.0))
    assert abs(fading - near).max() <= 1 and (fading // 64 == near // 64).all() and len(np.unique(fading)) > 20


def test_a_film_has_the_colours_of_causes_and_an_empty_picture_none(tmp_path: Path) -> None:
    look = Look(accumulate_us=10_000, colours=CAUSE, scale=1)
    late = CAUSED[-1:].copy()
    late["t"] += 100_000
    count = write_picture(str(tmp_path / "a.gif"), [CAUSED, late], (WIDTH, HEIGHT), look, Film(fps=100.0))
    with Image.open(tmp_path / "a.gif") as film:
        assert film.n_frames == count > 15
        begin_us = int(CAUSED["t"][0])
        first = CAUSED[CAUSED["t"] < begin_us + 10_000]
        wanted = lut(CAUSE)[np.array(drawn(first, look.full, 0, None))]
        assert np.array_equal(np.asarray(film.convert("RGB")), wanted)
        film.seek(13)
        assert (np.asarray(film.convert("RGB")) == lut(CAUSE)[0]).all()


def test_packets_tell_the_cause_of_every_event_only_where_it_is_known() -> None:
    many = np.tile(CAUSED, 30)
    many["t"] = 1_000_000
    packets = [packet for packet, _ in event_packets(many, 1_000_000)]
    counts = [int.from_bytes(packet[4:8], "little") for packet in packets]
    assert counts == [PACKET_EVENTS, len(many) - PACKET_EVENTS] and {packet[0] for packet in packets} == {8}
    told = [np.frombuffer(packet, "u1", offset=32 + 8 * count) for packet, count in zip(packets, counts, strict=True)]
    assert np.array_equal(np.concatenate(told), many["cause"])
    ((plain, _),) = event_packets(EVENTS, 1_100_000)
    assert plain[0] == 1 and len(plain) == 32 + 8 * len(EVENTS)


@pytest.mark.parametrize("live", [False, True])
def test_the_page_is_told_of_causes(live: bool, tmp_path: Path) -> None:
    aiohttp = pytest.importorskip("aiohttp", reason="the page is an extra")
    from clsim.live.view.player import Player
    from clsim.live.view.sink import ViewSink

    path = record(tmp_path / "a.h5", labels=("cause",))

    def opened() -> Player | ViewSink:
        if live:
            return ViewSink("a test", WIDTH, HEIGHT, port=0, causes=True)
        read = open_source
        return Player(
            lambda: read(path, labels=("cause",)),
            "a test",
            WIDTH,
            HEIGHT,
            port=0,
            kinds={"causes": CAUSES},
            colours=CAUSE,
        )

    async def run(url: str) -> tuple[dict[str, Any], list[bytes]]:
        packets: list[bytes] = []
        async with aiohttp.ClientSession() as session, session.ws_connect(f"{url}stream", max_msg_size=0) as stream:
            hello = json.loads((await stream.receive()).data)
            if isinstance(page, ViewSink):
                page.write(EVENTS[:1000], end_of(EVENTS[:1000]), CAUSED["cause"][:1000])
                page.write(EVENTS[1000:1200], end_of(EVENTS[1000:1200]))  # brightness caused them all
            while sum(packet[0] == 8 for packet in packets) < 1:
                message = await asyncio.wait_for(stream.receive(), 10)
                packets += [message.data] if message.type == aiohttp.WSMsgType.BINARY else []
        return hello, packets

    page = opened()
    try:
        hello, packets = asyncio.run(run(page.url))
    finally:
        page.close()
    assert hello["causes"] == list(CAUSES) and hello.get("colours") == (None if live else CAUSE)
    packet = next(packet for packet in packets if packet[0] == 8)
    count = int.from_bytes(packet[4:8], "little")
    told = np.frombuffer(packet, "u1", count, 32 + 8 * count)
    expected = CAUSED["cause"].copy()
    expected[1000:] *= not live
    assert count > 0 and np.array_equal(told, expected[:count])


@pytest.mark.parametrize("theme", ["dark", "light"])
@pytest.mark.parametrize("vision", ["normal", "deuteranopia", "protanopia"])
def test_causes_and_nothing_are_told_apart_by_every_eye(theme: Theme, vision: str) -> None:
    seen = lab(simulate(lut(CAUSE, theme) / 255.0, vision)).reshape(len(CAUSES), CAUSE_LEVELS, 3)
    assert np.ptp(seen[:, 0], axis=0).max() == 0  # nothing is the same to all
    for level in (21, 32, 42, 63):
        shown = [seen[0, 0], *seen[:, level]]
        apart = [np.linalg.norm(a - b) for k, a in enumerate(shown) for b in shown[:k]]
        assert min(apart) > 15  # CIE76; about 2.3 is just noticeable
