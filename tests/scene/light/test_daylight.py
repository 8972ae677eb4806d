"""Where the sun stands, how bright sky and sun are, and what scenes say of them."""

import math
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from clsim.errors import InputError
from clsim.scene import load_world
from clsim.scene.light.daylight import HEIGHTS, SUN_DEG, TURBIDITIES, Daylight, sky, sun_at, sun_light, sun_radiance


def angles(to_sun: tuple[float, float, float]) -> tuple[float, float]:
    """Height and azimuth from north by east [degrees]."""
    x, y, z = to_sun
    return math.degrees(math.asin(y)), math.degrees(math.atan2(x, -z)) % 360


@pytest.mark.parametrize(
    ("latitude", "longitude", "time", "zone", "height", "azimuth"),
    [
        # The June solstice: at noon of the sun it is 90° − latitude + 23.44° high, due south.
        (51.48, 0.0, datetime(2024, 6, 20, 12, 1, 46), 0.0, 90 - 51.48 + 23.44, 180.0),
        # The December solstice south of the equator: due north.
        (-33.87, 151.21, datetime(2024, 12, 21, 12, 53), 11.0, 90 - 33.87 + 23.44, 0.0),
        # The March equinox at the equator, where the sun is 7.5 minutes behind the clock: at six it sets, due west.
        (0.0, 0.0, datetime(2024, 3, 20, 18, 7, 30), 0.0, 0.0, 270.0),
        # Morning is in the east.
        (0.0, 0.0, datetime(2024, 3, 20, 9, 7, 30), 0.0, 45.0, 90.0),
    ],
)
def test_the_sun_stands_where_it_should(
    latitude: float, longitude: float, time: datetime, zone: float, height: float, azimuth: float
) -> None:
    found = angles(sun_at(latitude, longitude, time, zone))
    assert found[0] == pytest.approx(height, abs=0.1)
    assert (found[1] - azimuth + 180) % 360 - 180 == pytest.approx(0.0, abs=0.5)


def test_the_sun_goes_evenly_second_by_second() -> None:
    """At the equator, at the equinox, it rises by 15″ in each: over the end of a minute, of an hour and of a day."""
    for start in (
        datetime(2024, 3, 20, 8, 59, 55),
        datetime(2024, 3, 20, 9, 30, 55),
        datetime(2024, 3, 20, 23, 59, 55),
    ):
        ways = [np.array(sun_at(0.0, 0.0, start + timedelta(seconds=k))) for k in range(12)]
        turned_deg = np.degrees(np.linalg.norm(np.diff(ways, axis=0), axis=1))
        np.testing.assert_allclose(turned_deg, 15 / 3600, rtol=0.01)


def day(height_deg: float, **more: float) -> Daylight:
    height = math.radians(height_deg)
    return Daylight((math.cos(height), math.sin(height), 0.0), **more)


def test_a_sky_is_brightest_at_the_sun_and_black_below_the_horizon() -> None:
    picture = sky(day(60.0), rows=64)
    assert picture.shape == (64, 128, 3) and (picture[32:] == 0).all() and picture[:32].min() > 0
    # Above the bright band along the horizon.
    row, column = np.unravel_index(picture[:21].sum(axis=2).argmax(), (21, 128))
    # +x lies a quarter of the way along (columns start at −z).
    assert abs(row + 0.5 - 64 / 6) <= 1 and abs(column + 0.5 - 32) <= 1
    away = sky(day(30.0), rows=64)[8, 96]
    assert away[2] > 1.5 * away[0], "opposite the sun it is blue"
    hazy = sky(day(30.0, turbidity=8.0), rows=64)[8, 96]
    assert hazy[2] / hazy[0] < away[2] / away[0], "haze is white"
    snow = sky(day(30.0, ground=1.0), rows=64)
    assert (snow[:32] > sky(day(30.0, ground=0.0), rows=64)[:32]).mean() > 0.95, "bright ground lights the sky"


def test_between_the_tables_places_all_is_a_blend() -> None:
    """Half way between two turbidities is the mean of both; beyond the last is the last."""
    low = math.degrees(0.5 * math.pi * HEIGHTS[7] ** 3)
    thin, thick, half = (sky(day(low, turbidity=t), rows=16)[3, 20] for t in (3.0, 4.0, 3.5))
    np.testing.assert_allclose(half, (thin + thick) / 2, rtol=1e-5)
    for beyond, last in ((12.0, TURBIDITIES[-1]), (0.2, TURBIDITIES[0])):
        assert sun_radiance(day(60.0, turbidity=beyond)) == sun_radiance(day(60.0, turbidity=float(last)))
        hazes = [sky(day(60.0, turbidity=float(haze)), rows=16) for haze in (beyond, last)]
        np.testing.assert_array_equal(*hazes)
    assert sun_radiance(day(-1.0)) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("height_deg", "turbidity", "ground", "away", "beside"),
    # What Mitsuba 3.9's sky has 24° from the zenith, and 15° over the horizon: 114° and 30° beside the sun.
    [
        (1.5, 3.0, 0.3, (0.006458, 0.00873, 0.009946), (0.052017, 0.042635, 0.027599)),
        (5.0, 3.0, 0.2, (0.008291, 0.014367, 0.020871), (0.082562, 0.079938, 0.064406)),
        (25.0, 4.0, 0.3, (0.018577, 0.033341, 0.059855), (0.202343, 0.226306, 0.233379)),
        (60.0, 3.0, 0.3, (0.027789, 0.0494, 0.101313), (0.093793, 0.147224, 0.236882)),
        (60.0, 3.0, 0.4, (0.02933, 0.052656, 0.10772), (0.100826, 0.158152, 0.252667)),
        (80.0, 3.0, 0.3, (0.049012, 0.070982, 0.123347), (0.08045, 0.132, 0.215924)),
    ],
)
def test_skies_are_as_bright_as_mitsubas(
    height_deg: float, turbidity: float, ground: float, away: tuple[float, ...], beside: tuple[float, ...]
) -> None:
    """Also between the places of the table, low over the horizon and high."""
    picture = sky(day(height_deg, turbidity=turbidity, ground=ground), rows=64)
    np.testing.assert_allclose(picture[8, 72], away, rtol=0.012)
    np.testing.assert_allclose(picture[26, 42], beside, rtol=0.012)


@pytest.mark.parametrize(
    ("height_deg", "turbidity", "expected"),
    # What Mitsuba 3.9's disk has in the mean, at heights between the table's.
    [
        (10.0, 3.0, (14494, 8789.2, 3141.1)),
        (24.63, 3.0, (19559, 14937, 9290.6)),
        (20.0, 5.0, (16003, 11593, 6653.5)),
        (15.0, 8.0, (9182.9, 5953.3, 2996.5)),
    ],
)
def test_low_suns_are_as_weak_as_mitsubas(height_deg: float, turbidity: float, expected: tuple[float, ...]) -> None:
    np.testing.assert_allclose(sun_radiance(day(height_deg, turbidity=turbidity)), expected, rtol=0.012)


def test_the_sun_is_a_sphere_far_away_with_the_same_power_at_any_size() -> None:
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    true, large = (sun_light(day(45.0), turn, (1.0, 2.0, 3.0), 5.0, 2.0, seen) for seen in (SUN_DEG, 5.0))
    for lamp, seen in ((true, SUN_DEG), (large, 5.0)):
        away = lamp.motion.pose(0.0)[:3, 3] - (1.0, 2.0, 3.0)
        np.testing.assert_allclose(away / np.linalg.norm(away), (0.5**0.5, 0.0, 0.5**0.5), atol=1e-9)
        assert math.degrees(2 * math.asin(lamp.radius_m / np.linalg.norm(away))) == pytest.approx(seen)
    np.testing.assert_allclose(true.radiance, 2 * np.array(sun_radiance(day(45.0))))
    solid = [1 - math.cos(math.radians(seen / 2)) for seen in (SUN_DEG, 5.0)]
    np.testing.assert_allclose(np.multiply(true.radiance, solid[0]), np.multiply(large.radiance, solid[1]))


SCENE = """
[camera]
position = [0.0, 1.0, 3.0]
[[objects]]
shape = "quad"
size = [6.0, 8.0]
[environment.daylight]
"""


def toml(folder: Path, text: str) -> Path:
    path = folder / "day.toml"
    path.write_text(SCENE + text)
    return path


def test_a_toml_has_a_sky_and_a_sun(tmp_path: Path) -> None:
    world = load_world(toml(tmp_path, "elevation_deg = 30.0\nazimuth_deg = 90.0\nsky_scale = 2.0\nsun_scale = 0.5\n"))
    (sun,), above = world.sphere_lights, world.environment_map
    assert above is not None and world.warnings == ()
    np.testing.assert_allclose(above.radiance, 2 * sky(day(30.0)), rtol=1e-4, atol=1e-9)
    place = sun.motion.pose(0.0)[:3, 3]
    np.testing.assert_allclose(place / np.linalg.norm(place), (3**0.5 / 2, 0.5, 0.0), atol=1e-9)
    assert np.linalg.norm(place) == pytest.approx(1e4 * 5.0) and sun.name == "sun"
    assert sun.radiance == pytest.approx([0.5 * each for each in sun_radiance(day(30.0))])
    night = load_world(toml(tmp_path, "elevation_deg = -3.0\n"))
    assert night.sphere_lights == () and night.environment_map is None, "as in Mitsuba 3"
    assert night.warnings[0] == "day.toml: the sun is below the horizon, so there is no daylight"
    when = "latitude_deg = 51.48\ntime = 2024-06-20T14:01:46+02:00\nsky_scale = 0.0\n"
    noon = load_world(toml(tmp_path, when))
    assert noon.environment_map is None
    assert angles(tuple(noon.sphere_lights[0].motion.pose(0.0)[:3, 3] / 5e4))[0] == pytest.approx(61.96, abs=0.1)


@pytest.mark.parametrize(
    ("azimuth", "towards"), [("0.0", (0, -1)), ("90.0", (1, 0)), ("180.0", (0, 1)), ("-90.0", (-1, 0)), (None, (0, 1))]
)
def test_the_suns_azimuth_goes_from_north_by_east_and_is_south_unless_told(
    tmp_path: Path, azimuth: str | None, towards: tuple[int, int]
) -> None:
    """North is −z, east +x; the sky is brightest on the side of the sun."""
    told = "" if azimuth is None else f"azimuth_deg = {azimuth}\n"
    world = load_world(toml(tmp_path, f"elevation_deg = 20.0\n{told}"))
    place = world.sphere_lights[0].motion.pose(0.0)[:3, 3]
    x, _, z = place / np.linalg.norm(place)
    assert (x, z) == pytest.approx(np.multiply(towards, np.cos(np.radians(20))), abs=1e-9)
    assert world.environment_map is not None
    light = world.environment_map.radiance.sum(axis=2)
    column = int(np.argmax(light.sum(axis=0)))
    turn = 2 * np.pi * (column + 0.5) / light.shape[1]  # columns run from −z over +x, +z and −x
    assert np.dot((np.sin(turn), -np.cos(turn)), towards) > 0.98


@pytest.mark.parametrize(
    "text", ["", "latitude_deg = 3.0\n", "elevation_deg = 3.0\nlatitude_deg = 3.0\ntime = 2024-06-20T14:00:00\n"]
)
def test_a_sun_without_a_place_or_with_two_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError, match="daylight: expected either elevation_deg, or latitude_deg and time"):
        load_world(toml(tmp_path, text))
    with pytest.raises(InputError, match="has map and daylight, expected one of them"):
        load_world(toml(tmp_path, 'elevation_deg = 3.0\n[environment]\nmap = "a.exr"\n'))
    with pytest.raises(InputError, match="has daylight and map_turn_deg_per_s, which belongs to map"):
        load_world(toml(tmp_path, "elevation_deg = 3.0\n[environment]\nmap_turn_deg_per_s = 3.0\n"))


def test_the_sun_changes_as_the_sky_does(tmp_path: Path) -> None:
    dusk = 'modulation = { kind = "keyframes", keyframes = [{ time_s = 0.0, factor = 0.5 }] }'
    world = load_world(toml(tmp_path, f"elevation_deg = 30.0\n[environment]\n{dusk}\n"))
    (sun,) = world.sphere_lights
    assert sun.modulation == world.environment_modulation and sun.modulation is not None
    assert sun.modulation.mean(0.0, 0.0).tolist() == [0.5, 0.5, 0.5]


def test_times_beyond_the_calendar_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"daylight\.time: expected a time in the years 1 to 9999 of Greenwich"):
        load_world(toml(tmp_path, "latitude_deg = 3.0\ntime = 0001-01-01T00:30:00+02:00\n"))


def mitsuba(folder: Path, emitter: str, version: str = "3.0.0") -> Path:
    path = folder / "day.xml"
    floor = '<shape type="rectangle"/>'
    path.write_text(f'<scene version="{version}">{floor}{emitter}</scene>')
    return path


def test_mitsubas_suns_stand_as_they_do_there(tmp_path: Path) -> None:
    """Since version 3 +z is up, before +y; a direction to the sun is the world's (both looked up in Mitsuba 3.9)."""
    turn = '<transform name="to_world"><rotate x="1" angle="-90"/></transform>'
    for inside, expected in (
        ("", (0.05139, 0.69175, 0.72031)),
        (turn, (0.05139, 0.72031, -0.69175)),
        ('<vector name="sun_direction" x="0" y="3" z="4"/>' + turn, (0.0, 0.6, 0.8)),
    ):
        world = load_world(mitsuba(tmp_path, f'<emitter type="sunsky">{inside}</emitter>'))
        place = world.sphere_lights[0].motion.pose(0.0)[:3, 3]
        np.testing.assert_allclose(place / np.linalg.norm(place), expected, atol=1e-4)
    old = load_world(mitsuba(tmp_path, '<emitter type="sky"/>', "0.6.0"))
    assert old.sphere_lights == () and old.environment_map is not None
    assert np.array_equal(old.environment_map.to_world, np.eye(3)), "there +y was up"
    scaled = '<emitter type="sun"><float name="scale" value="2"/><integer name="month" value="13"/></emitter>'
    with pytest.raises(InputError, match="there is no such date and time: month must be in"):
        load_world(mitsuba(tmp_path, scaled, "0.6.0"))


@pytest.mark.parametrize(
    ("inside", "part"),
    [
        ('<float name="year" value="1e300"/>', "there is no such date and time: it is not in the years 1 to 9999"),
        ('<float name="timezone" value="1e12"/>', "there is no such date and time: it is not in the years 1 to 9999"),
        ('<string name="albedo" value="x"/>', "sunsky.albedo is 'x', expected a float"),
        ('<string name="sun_direction" value="x"/>', "sunsky.sun_direction is 'x', expected a"),
        ('<float name="sun_aperture" value="720"/>', "the sun is seen under 720°, expected an angle from 0 to 180"),
    ],
)
def test_what_cannot_be_a_day_gets_one_sentence(tmp_path: Path, inside: str, part: str) -> None:
    with pytest.raises(InputError) as caught:
        load_world(mitsuba(tmp_path, f'<emitter type="sunsky">{inside}</emitter>'))
    assert part in str(caught.value)


def test_mitsubas_hours_may_have_parts_and_its_suns_no_size(tmp_path: Path) -> None:
    half, minutes = (
        load_world(mitsuba(tmp_path, f'<emitter type="sun">{inside}</emitter>')).sphere_lights[0].motion.pose(0.0)
        for inside in (
            '<float name="hour" value="14.5"/>',
            '<integer name="hour" value="14"/><float name="minute" value="30"/>',
        )
    )
    np.testing.assert_array_equal(half, minutes)
    point = load_world(mitsuba(tmp_path, '<emitter type="sun"><float name="sun_aperture" value="0"/></emitter>'))
    assert point.sphere_lights[0].radius_m > 0


def test_mitsubas_nights_have_no_daylight(tmp_path: Path) -> None:
    """A lamp and a dim environment of clsim's own stand in, as where a file has no light."""
    below = '<vector name="sun_direction" x="0" y="3" z="-4"/>'
    night = load_world(mitsuba(tmp_path, f'<emitter type="sunsky">{below}</emitter>'))
    assert night.environment_map is None and [light.name for light in night.sphere_lights] != ["sun"]
    assert any("the sun is below the horizon, so there is no daylight" in text for text in night.warnings)


@pytest.mark.parametrize(
    ("height_deg", "turbidity", "expected"),
    # The paper's tables, 5 nm apart and with ozone between 355 and 445 nm, under the CIE's own curves.
    [
        (60.0, 2.0, (22458, 19297, 16890)),
        (30.0, 3.0, (16468, 12925, 9466.6)),
        (45.0, 5.0, (15179, 11787, 8715.6)),
        (10.0, 8.0, (633.01, 215.2, 24.932)),
    ],
)
def test_preethams_sun_is_the_papers(height_deg: float, turbidity: float, expected: tuple[float, ...]) -> None:
    found = sun_radiance(day(height_deg, turbidity=turbidity, preetham=True))
    np.testing.assert_allclose(found, expected, rtol=0.02)


def test_air_cannot_be_clearer_than_clear() -> None:
    """A haze below none would add light, or end in numbers that are none."""
    clear = sun_radiance(day(45.0, turbidity=1.0, preetham=True))
    assert all(sun_radiance(day(45.0, turbidity=t, preetham=True)) == clear for t in (0.0, -5.0, -1e9))


def test_older_files_have_the_sky_and_sun_of_their_time(tmp_path: Path) -> None:
    """Mitsuba 0.6 has a ground of .2 instead of .3 and Preetham's sun; ``scale`` is of what has none of its own."""
    above = '<vector name="sunDirection" x="0" y="1" z="1"/><float name="turbidity" value="5"/>'
    scales = '<float name="scale" value="50"/><float name="sunScale" value="2"/>'
    world = load_world(mitsuba(tmp_path, f'<emitter type="sunsky">{above}{scales}</emitter>', "0.5.0"))
    then = Daylight((0.0, 0.5**0.5, 0.5**0.5), 5.0, 0.2, preetham=True)
    assert world.environment_map is not None
    np.testing.assert_allclose(world.environment_map.radiance, 50 * sky(then), rtol=1e-4, atol=1e-9)
    np.testing.assert_allclose(world.sphere_lights[0].radiance, 2 * np.array(sun_radiance(then)), rtol=1e-6)
    alone = load_world(
        mitsuba(tmp_path, f'<emitter type="sun">{above}<float name="scale" value="3"/></emitter>', "0.6.0")
    )
    np.testing.assert_allclose(alone.sphere_lights[0].radiance, 3 * np.array(sun_radiance(then)), rtol=1e-6)
    today = load_world(mitsuba(tmp_path, f'<emitter type="sunsky">{above}</emitter>'.replace("sunD", "sun_d")))
    assert today.sphere_lights[0].radiance[1] > 1.3 * sun_radiance(then)[1]
