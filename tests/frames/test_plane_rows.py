import pytest

from clsim.frames import PLANES, TRUTH_PLANES, PlaneSet, plane_of, rendered_planes

ICIP_2023 = ("R", "G", "B", "Albedo.R", "Albedo.G", "Albedo.B", "Nx", "Ny", "Nz", "Depth")
"""Channels of the published program's files, in its order."""


def test_frames_begin_as_those_of_the_published_program() -> None:
    plain = rendered_planes()
    assert plain.names == (*ICIP_2023, "Coverage", "Samples")
    assert rendered_planes(first_hit_rays=True).names == (*plain.names, "Emission")


def test_variances_follow_all_values() -> None:
    both = rendered_planes(variances=True)
    variances = [f"Variance.{name}" for name in (*ICIP_2023, "Coverage", "Luminance")]
    assert both.names == (*rendered_planes().names, *variances)


@pytest.mark.parametrize("options", [{}, {"first_hit_rays": True}, {"variances": True}])
def test_truth_comes_last_and_moves_no_plane(options: dict[str, bool]) -> None:
    """Also where it is asked for in another order."""
    plain, asked = rendered_planes(**options).names, rendered_planes(**options, truth=tuple(TRUTH_PLANES)).names
    assert asked[: len(plain)] == plain and len(asked) > len(plain) + 10
    assert rendered_planes(**options, truth=tuple(TRUTH_PLANES)[::-1]).names == asked


def test_a_plane_is_found_where_its_channels_are() -> None:
    both = rendered_planes(variances=True)
    for plane in both.planes:
        start = both.first(plane.name)
        assert both.names[start : start + plane.width] == plane.channels
    for plane in both.with_variance:
        start = both.first_variance(plane.name)
        assert both.names[start : start + plane.width] == plane.variance_channels


def test_what_a_set_lacks_is_named() -> None:
    plain = rendered_planes()
    with pytest.raises(KeyError, match="'Emission' is not among R, G"):
        plain.first("Emission")
    with pytest.raises(KeyError, match="variance of 'Depth'"):
        plain.first_variance("Depth")
    with pytest.raises(KeyError, match=r"'Colour'.*Radiance, Albedo"):
        plane_of("Colour")
    with pytest.raises(KeyError, match="variance of 'Samples'"):
        rendered_planes(variances=True).first_variance("Samples")


def test_no_channel_is_named_twice() -> None:
    channels = [channel for plane in PLANES for channel in plane.channels + plane.variance_channels]
    assert len(set(channels)) == len(channels)
    assert PlaneSet(PLANES, PLANES).names == (
        *(channel for plane in PLANES for channel in plane.channels),
        *(channel for plane in PLANES for channel in plane.variance_channels),
    )
