"""Any renderer behind an event camera."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

import clsim
from clsim.errors import Error, InputError
from clsim.frames import Frame
from clsim.live.options import LiveOptions
from clsim.live.stages import plan_stages
from clsim.scene import Sensor
from clsim.sensor import load_sensor
from clsim.sensor.pixel_stages import Delay, Leak, Refractory, Threshold
from clsim.sensor.settings import Optics, Readout, SensorSettings
from clsim.simulator.radiance import on_host

WIDTH, HEIGHT = 12, 8


def ramp(gain: float) -> np.ndarray:
    """Light ``[3, H, W]`` that is brighter by e^(gain · x/W)."""
    grey = 0.5 * np.exp(gain * np.arange(WIDTH) / WIDTH)
    return np.ascontiguousarray(np.broadcast_to(grey, (3, HEIGHT, WIDTH)), np.float32)


def camera(**options: object) -> clsim.simulator.radiance.RadianceCamera:
    return clsim.Simulator.from_radiance(WIDTH, HEIGHT, **options)


def test_events_are_where_the_closed_form_has_them() -> None:
    """Log brightness grows linearly from 0 to x/W within 10 ms: it crosses n·C at 10 ms · n·C·W/x."""
    with camera(threshold=(0.21, 0.5)) as pixels:
        assert len(pixels.push(ramp(0.0), 5_000)) == 0
        events = pixels.push(ramp(1.0), 15_000)
    assert events["on"].all() and (np.diff(events["t"]) >= 0).all()
    for y, x in np.ndindex(HEIGHT, WIDTH):
        own = events["t"][(events["x"] == x) & (events["y"] == y)]
        crossings = np.arange(1, int(x / WIDTH / 0.21) + 1)
        assert own.tolist() == pytest.approx(5_000 + 10_000 * crossings * 0.21 * WIDTH / max(x, 1), abs=1)


FORMS = {
    "numpy, planes": lambda planes: planes,
    "numpy, pixels": lambda planes: np.ascontiguousarray(np.moveaxis(planes, 0, 2)),
    "numpy, float64": lambda planes: np.moveaxis(planes, 0, 2).astype(np.float64),
    "numpy, upside down": lambda planes: planes[:, ::-1].copy()[:, ::-1],
    "numpy, read only": lambda planes: np.broadcast_to(planes[0], planes.shape),
    "luminance": lambda planes: planes[0],
    "warp, planes": lambda planes: wp.array(planes, dtype=wp.float32, device="cpu"),
    "warp, vec3": lambda planes: wp.array(np.moveaxis(planes, 0, 2).copy(), dtype=wp.vec3, device="cpu"),
    "DLPack": lambda planes: OnlyDlpack(planes),
    "lists": lambda planes: planes.tolist(),
}


class OnlyDlpack:
    """What another library's array looks like."""

    def __init__(self, planes: np.ndarray) -> None:
        self._planes = planes

    def __dlpack__(self, **keywords: object) -> object:
        return self._planes.__dlpack__(**keywords)

    def __dlpack_device__(self) -> object:
        return self._planes.__dlpack_device__()


@pytest.mark.parametrize("form", FORMS)
def test_pictures_may_come_in_any_form(form: str) -> None:
    """Colours and rows change by themselves, but for those forms that are grey."""
    found, grey = [], form in ("numpy, read only", "luminance")
    growth = np.array([[[1.0]]] * 3 if grey else [[[0.2]], [[1.0]], [[3.0]]])
    later = (ramp(1.0) ** growth * np.linspace(1.0, 2.0, HEIGHT)[:, None]).astype(np.float32)
    for make in (lambda planes: planes, FORMS[form]):
        with camera() as pixels:
            pixels.push(make(ramp(0.0)), 0)
            found.append(pixels.push(make(later), 10_000).tobytes())
    assert found[0] == found[1] and len(found[0]) > 1000


def test_what_can_be_read_where_it_lies_is() -> None:
    planes = ramp(0.3)
    with camera() as pixels:
        assert pixels._planes(planes) is planes
        assert np.shares_memory(pixels._planes(on_host(OnlyDlpack(planes))), planes)
        warp_planes = wp.array(planes, dtype=wp.float32, device="cpu", copy=False)
        assert np.shares_memory(pixels._planes(on_host(warp_planes)), planes)
        assert pixels._planes(planes[0]) is pixels._own


def test_black_and_missing_pixels() -> None:
    with camera(floor=1e-3) as pixels:
        dark = np.zeros((HEIGHT, WIDTH))
        dark[0, 0] = np.nan
        pixels.push(dark, 0)
        events = pixels.push(np.full((HEIGHT, WIDTH), 1e-3 * np.exp(0.25)), 1_000)
        assert len(events) == HEIGHT * WIDTH - 1 and not ((events["x"] == 0) & (events["y"] == 0)).any()


def test_a_reset_forgets_and_a_closed_camera_sees_nothing() -> None:
    pixels = camera()
    pixels.push(ramp(0.0), 10)
    with pytest.raises(InputError, match="`t_us` must be after the picture before, at 10 µs, got 10"):
        pixels.push(ramp(0.0), 10)
    pixels.reset()
    assert len(pixels.push(ramp(1.0), 0)) == 0 and pixels.time_us == 0
    pixels.close()
    pixels.close()
    with pytest.raises(Error, match="the camera is closed"):
        pixels.push(ramp(0.0), 20)


READOUTS = (
    Readout(event_us=3.0, row_us=2.0, stamp_us=5),
    Readout(arbiter="rows", event_us=1.0, row_us=7.0, row_stamps=True, most_wait_us=40.0),
    Readout(scan_us=500.0, column_us=2.0, most_in_period=7, control_period_us=250.0),
)


@pytest.mark.parametrize("readout", READOUTS, ids=["events", "rows", "scan"])
def test_what_a_sensor_fires_does_not_hang_on_when_time_began(readout: Readout) -> None:
    """Nor on what was seen before a reset: all that leaks, rests, waits for the bus and is stamped begins anew."""
    settings = SensorSettings(leak=Leak(hz=40.0), refractory=Refractory(300.0), delay=Delay(70.0), readout=readout)
    found = []
    with camera(sensor=settings, threshold=0.1) as pixels:
        for start_us in (0, 7_000_000, 10**12, 0):
            events = [pixels.push(ramp(gain), start_us + 3_000 * k) for k, gain in enumerate((0.0, 1.0, 1.0, 0.2, 2.0))]
            assert [len(each) > 0 for each in events] == [False, True, True, True, True]
            found.append(np.concatenate(events))
            found[-1]["t"] -= start_us
            pixels.reset()
    for later in found[1:]:
        np.testing.assert_array_equal(later, found[0])


@pytest.mark.parametrize("sensor", [None, "davis346"])
def test_time_begins_at_0_as_in_all_files(sensor: str | None) -> None:
    with camera(sensor=sensor) as pixels:
        with pytest.raises(InputError, match="`t_us` must be 0 or later, got -1"):
            pixels.push(ramp(0.0), -1)
        assert len(pixels.push(ramp(0.0), 0)) == 0 and len(pixels.push(ramp(1.0), 1_000)) > 0


@pytest.mark.parametrize(
    ("picture", "message"),
    [
        (np.zeros((8, 11)), r"has shape \(8, 11\), expected \(8, 12\), \(8, 12, 3\) or \(3, 8, 12\)"),
        (np.zeros((8, 12, 3), complex), "holds complex128, expected numbers"),
        (np.full((8, 12), "x"), "expected numbers"),
        ([[1.0], [1.0, 2.0]], "cannot be read as an array"),
    ],
)
def test_what_is_no_picture_is_told(picture: object, message: str) -> None:
    with camera() as pixels, pytest.raises(InputError, match=message):
        pixels.push(picture, 0)


@pytest.mark.parametrize("sensor", [None, "davis346"])
@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("lux_per_unit", -1, "`lux_per_unit` must be a positive number, got -1"),
        ("lux_per_unit", 0, "`lux_per_unit` must be a positive number, got 0"),
        ("opencl", 5, "`opencl` must be a text, got 5"),
        ("seed", -1, "`seed` must not be negative, got -1"),
    ],
)
def test_numbers_that_no_sensor_has_are_told(sensor: str | None, name: str, value: int, message: str) -> None:
    with pytest.raises(InputError, match=message):
        camera(sensor=sensor, **{name: value})


def test_a_time_that_no_event_can_have_is_told() -> None:
    with camera() as pixels, pytest.raises(InputError, match=f"`t_us` must be at most {1 << 62}, got {1 << 63}"):
        pixels.push(ramp(0.0), 1 << 63)


def test_a_sensor_needs_a_size() -> None:
    with pytest.raises(InputError, match="`width` and `height` must be at least 1, got 0 and 3"):
        clsim.Simulator.from_radiance(0, 3)


def test_a_sensor_may_have_faults_and_thresholds_of_its_own() -> None:
    found = {}
    for name, options in {
        "ideal": {},
        "davis346": {"sensor": "davis346"},
        "again": {"sensor": "davis346"},
        "another": {"sensor": "davis346", "seed": 1},
        "far": {"sensor": "davis346", "seed": 1 << 40},
        "deaf": {"sensor": "davis346", "threshold": 5.0},
    }.items():
        with camera(**options) as pixels:
            pixels.push(ramp(0.0), 0)
            found[name] = pixels.push(ramp(2.0), 50_000)
    assert found["davis346"].tobytes() == found["again"].tobytes()
    assert len({found[name].tobytes() for name in ("davis346", "another", "far")}) == 3, "each seed is noise of its own"
    assert len(found["deaf"]) < len(found["davis346"]) / 4 and found["davis346"].tobytes() != found["ideal"].tobytes()
    with pytest.raises(InputError, match="davis347"):
        camera(sensor="davis347")


def test_a_sensor_sees_its_own_colours() -> None:
    """A sensor that is blind to blue, whether pictures are pushed or a World is rendered."""
    blind = replace(load_sensor("ideal"), optics=Optics(spectral=(0.5, 0.5, 0.0)))
    dark, blue, red = (np.full((3, HEIGHT, WIDTH), 0.3, np.float32) for _ in range(3))
    blue[2], red[0] = 3.0, 0.9
    with camera(sensor=blind) as pixels:
        assert [len(pixels.push(shown, 1_000 * k)) > 0 for k, shown in enumerate((dark, blue, red))] == [0, 0, 1]
    world = clsim.load_scene("two-boxes", resolution=(16, 12))
    with clsim.Simulator(world, sensor=blind) as simulator:
        assert simulator.world.sensor.spectral == (0.5, 0.5, 0.0)


def test_a_renderers_unit_of_light_is_told_by_scale_or_by_lux() -> None:
    """The same light in units four times as large: a sensor that reads light fires the same, bit by bit."""
    noisy = load_sensor("davis346")
    assert noisy.reads_light
    found = []
    for unit in (1.0, 0.25, 8.0):
        with camera(sensor=noisy, scale=unit, lux_per_unit=100.0 * unit) as pixels:
            pixels.push(ramp(0.0) / np.float32(unit), 0)
            found.append(pixels.push(ramp(2.0) / np.float32(unit), 50_000).tobytes())
    assert found[0] == found[1] == found[2] and len(found[0]) > 1000
    # And so in a scene, whose frames are shown here without being rendered.
    for unit in (1.0, 0.25):
        world = replace(
            clsim.load_scene("still", resolution=(WIDTH, HEIGHT)), sensor=Sensor(scale=unit, lux_per_unit=100 * unit)
        )
        stages = plan_stages(LiveOptions("still", sensor="davis346"), world)
        planes = np.zeros((len(stages.planes), HEIGHT, WIDTH), np.float32)
        detector, frame = stages.build_detector(), Frame(planes, stages.planes)
        for frame.time_us, gain in ((0, 0.0), (50_000, 2.0)):
            planes[:3] = ramp(gain) / np.float32(unit)
            found.append(detector.step(frame).tobytes())
        detector.close()
    assert found[4] == found[6] and len(found[4]) > 1000


@pytest.mark.parametrize("given", [None, (0.4, 0.7), 0.6])
@pytest.mark.parametrize(("on", "off"), [(0.3, 0.45), (None, 0.45), (0.3, None), (None, None)])
def test_each_threshold_is_what_is_given_or_the_sensors_or_a_fifth(
    on: float | None, off: float | None, given: float | tuple[float, float] | None
) -> None:
    """Light goes up by 1.0 and down by it again: so many whole thresholds fit into it."""
    sensor = replace(load_sensor("ideal"), threshold=Threshold(on=on, off=off))
    on, off = (on, off) if given is None else given if isinstance(given, tuple) else (given, given)
    with camera(sensor=sensor, threshold=given) as pixels:
        pixels.push(np.full((HEIGHT, WIDTH), 1.0), 0)
        up = pixels.push(np.full((HEIGHT, WIDTH), np.exp(0.99)), 1_000)
        down = pixels.push(np.full((HEIGHT, WIDTH), np.exp(-1.0)), 2_000)
    rises = int(0.99 / (on or 0.2))
    falls = int((1.0 + rises * (on or 0.2)) / (off or 0.2) + 1e-6)
    assert (len(up), len(down)) == (rises * WIDTH * HEIGHT, falls * WIDTH * HEIGHT)
    assert up["on"].all() and not down["on"].any()


@pytest.mark.parametrize(
    "sensor",
    [
        "davis346",
        "gen4.1",
        SensorSettings(readout=Readout(scan_us=7_000)),
        SensorSettings(delay=Delay(latency_us=15_000)),
        SensorSettings(readout=Readout(most_in_period=20, control_period_us=50_000)),
    ],
    ids=["a bus of events", "a bus of rows", "a scan", "a delay", "a controller"],
)
def test_a_camera_that_is_reset_sees_as_at_first(sensor: str | SensorSettings) -> None:
    """Time may begin anew: nothing of before is still on its way off the chip, nor keeps it busy."""
    with camera(sensor=sensor) as pixels:
        first, again = [], []
        for found in (first, again):
            found += [pixels.push(ramp(gain), 10_000 * k).tobytes() for k, gain in enumerate((0.0, 2.0, -1.0, 1.0))]
            pixels.reset()
    assert first == again and any(first)
