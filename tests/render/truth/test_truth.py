"""Truth against float64 by brute force, and against closed forms."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy import ndimage

from clsim.frames import Frame, page_aligned, rendered_planes
from clsim.frames.planes import PlaneSet
from clsim.render import RenderOptions, SceneData, View
from clsim.render.truth.truth_pass import TruthPass
from clsim.scene import Camera, ImageTexture, Instance, Material, Mesh, SphereLight, World
from clsim.scene.motion import Keyframes, Static, euler_quaternion
from clsim.scene.world import Lens
from tests.render import hand_worlds as hw
from tests.render.truth import truth_reference as reference

ASKED = ("depth", "distance", "normal", "albedo", "ids", "flow", "backward-flow", "labels")
PLANES = PlaneSet((), (), rendered_planes(truth=ASKED).truth)
T0_US, T1_US = 100_000, 180_000


def moving(start, end, turn_deg=(0.0, 0.0, 0.0), end_turn_deg=(0.0, 0.0, 0.0)):
    turns = tuple(euler_quaternion(each) for each in (turn_deg, end_turn_deg))
    return Keyframes((0.0, 0.5), (start, end), turns)


def a_world(camera_motion=None, lens=None) -> World:
    """Two still walls, a box that turns and passes, and a lamp that moves; the walls leave some sky."""
    camera = Camera(
        32,
        24,
        60.0,
        camera_motion or moving((0.0, 0.2, 2.0), (0.3, 0.1, 1.7), end_turn_deg=(2, 6, 3)),
        lens=lens or Lens(),
    )
    wall = hw.quad((-3, -2, -1.5), (4, 0, 0.7), (0, 3, 0.4))
    floor = hw.quad((-2, -0.8, 2), (4, 0, 0), (0, 0, -4), material=1)
    crate = hw.box((-0.3, -0.3, -0.3), (0.3, 0.3, 0.3), material=1)
    lamp = SphereLight(0.2, (5.0, 5.0, 5.0), moving((-0.9, 0.6, 0.0), (0.3, 0.8, 0.2)))
    passes = moving((-0.5, -0.2, 0.1), (0.9, 0.1, 0.5), (10, 20, 5), (40, -60, 30))
    return World(
        name="truth",
        camera=camera,
        meshes=(wall, floor, crate),
        instances=(Instance(0, hw.IDENTITY, "wall"), Instance(2, passes, "crate"), Instance(1, hw.IDENTITY, "floor")),
        materials=(Material(), hw.GREY),
        sphere_lights=(lamp,),
    )


def filled(
    world: World, before_us: int | None = 20_000, planes: PlaneSet = PLANES, camera: Camera | None = None
) -> dict[str, np.ndarray]:
    """The planes of truth at T0 by channel, forward flow to T1."""
    camera = camera or world.camera
    out = np.zeros((len(planes.names), camera.height, camera.width), np.float32)
    ends_us = {"Flow.forward": T1_US, "Flow.backward": before_us, "Label.flow": T1_US}
    TruthPass(SceneData(world), camera, planes).fill(out, T0_US, ends_us)
    return dict(zip(planes.names, out, strict=True))


def vectors(found, *names):
    return np.stack([found[name] for name in names], axis=-1)


def assert_is_truth(world: World, flow_px: float = 1e-3, after_us: int = T1_US, way: str = "forward"):
    found = filled(world)
    expected = reference.truth(world, world.camera, T0_US * 1e-6, after_us * 1e-6)
    same = found["Id.object"] == expected["owner"]
    assert (~same).mean() <= 0.01  # a ray through an edge may go either way
    hit = same & (expected["owner"] > 0)
    assert np.abs(found["Z"][hit] / expected["depth"][hit] - 1).max() < 3e-6
    assert np.abs(found["Truth.Depth"][hit] / expected["distance"][hit] - 1).max() < 3e-6
    assert np.isinf(found["Z"][same & ~hit]).all()
    normal = vectors(found, "Truth.Nx", "Truth.Ny", "Truth.Nz")
    assert np.abs(normal - expected["normal"])[same].max() < 1e-5
    albedo = vectors(found, "Truth.Albedo.R", "Truth.Albedo.G", "Truth.Albedo.B")
    assert np.abs(albedo - expected["albedo"])[same].max() < 1e-6
    flow = vectors(found, f"Flow.{way}.X", f"Flow.{way}.Y")
    valid = found[f"Flow.{way}.valid"] > 0
    assert (valid == np.isfinite(expected["flow"]).all(axis=-1))[same].all()
    assert np.abs(flow - expected["flow"])[same & valid].max() < flow_px
    covisible = found[f"Flow.{way}.covisible"] > 0
    should = expected["inside"] & (expected["margin"] < 1e-4)
    sure = same & ((np.abs(expected["margin"]) < 1e-6) | (expected["margin"] > 1e-3))
    assert sure.mean() > 0.95
    assert (covisible == should)[sure].all()
    return found, expected


def test_everything_moves() -> None:
    world = a_world()
    found, expected = assert_is_truth(world)
    assert set(np.unique(found["Id.object"])) == {0, 1, 2, 3, 4}
    assert set(np.unique(found["Id.material"][found["Id.object"] == 2])) == {2}
    assert 0.02 < 1 - found["Flow.forward.covisible"].mean() < 0.5
    assert np.linalg.norm(expected["flow"], axis=-1).max() > 3


def test_it_is_sharp_and_of_one_moment_whatever_the_exposure_and_the_aperture() -> None:
    world = a_world()
    blurred = replace(world.camera, shutter_s=0.05, lens=Lens(aperture_radius_m=0.2, focus_distance_m=1.0))
    sharp, found = filled(world), filled(world, camera=blurred)
    assert all(np.array_equal(found[name], plane) for name, plane in sharp.items())


def test_backward_flow() -> None:
    assert_is_truth(a_world(), after_us=20_000, way="backward")


def test_labels_are_objects_and_velocities() -> None:
    found = filled(a_world())
    assert np.array_equal(found["Label.object"], found["Id.object"])
    moved_s = (T1_US - T0_US) * 1e-6
    for axis in "XY":
        assert np.abs(found[f"Label.flow.{axis}"] * moved_s - found[f"Flow.forward.{axis}"]).max() < 1e-5


@dataclass(frozen=True)
class Swell:
    """A mesh that is stretched more and more, and bent."""

    rest: Mesh
    duration_s: float = 0.5

    def vertices_at(self, time_s):
        x, y, z = self.rest.vertices.astype(np.float64).T
        bent = np.stack([x * (1 + 2 * time_s), y + 3 * time_s * x * z, z * (1 - time_s)], axis=1)
        return bent.astype(np.float32), None


HOLES = ImageTexture(
    np.array([[[255, 128, 0, 255], [0, 51, 255, 64], [102, 102, 102, 160], [255, 255, 255, 127]]], np.uint8),
    srgb=False,
    nearest=True,
)
"""Four columns, of which the first and third are solid."""


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["mask", "blend"])
@pytest.mark.usefixtures("anything")
def test_what_deforms_and_what_is_cut_out(mode: str) -> None:
    world = a_world()
    wall, floor, crate = world.meshes
    screen = hw.quad((-0.7, -0.5, 1.0), (1.3, 0, 0.1), (0, 0.9, 0.1), material=2)
    leaf = Material(color=(0.9, 0.5, 0.2), texture=0, alpha_mode=mode, opacity_texture=0)
    passes = moving((0.0, 0.1, 0.0), (0.4, -0.2, 0.1), end_turn_deg=(0, 5, 8))
    world = replace(
        world,
        meshes=(wall, floor, replace(crate, deformation=Swell(crate)), screen),
        instances=(*world.instances, Instance(3, passes, "screen")),
        materials=(*world.materials, leaf),
        textures=(HOLES,),
    )
    _, expected = assert_is_truth(world)
    objects = expected["owner"]
    assert (objects == 4).mean() > 0.05 and (objects == 2).mean() > 0.02
    still = replace(world, meshes=(wall, floor, crate, screen))
    unbent = reference.truth(still, world.camera, T0_US * 1e-6, T1_US * 1e-6)
    assert np.abs(unbent["flow"] - expected["flow"])[(objects == 2) & (unbent["owner"] == 2)].max() > 0.3
    whole = replace(world, materials=(*world.materials[:2], replace(leaf, alpha_mode="opaque")))
    through = reference.truth(whole, world.camera, T0_US * 1e-6, T1_US * 1e-6)["owner"] == 4
    assert (through & (objects != 4)).mean() > 0.05


def waves(count: int) -> ImageTexture:
    """A smooth texture, with so many waves up and across."""
    turn = 2 * np.pi * count * np.arange(256) / 256
    pixels = np.full((256, 256, 4), 255, np.uint8)
    pixels[..., :3] = np.rint(127.5 + 60 * np.sin(turn)[None, :, None] + 60 * np.cos(turn + 1)[:, None, None])
    return ImageTexture(pixels, srgb=False)


@pytest.mark.slow
@pytest.mark.usefixtures("anything")
def test_a_picture_carried_along_the_flow_is_the_other_picture() -> None:
    """Photometric: what shines by itself, without noise, looks alike at both ends of the flow."""
    glow = [Material(color=(0.0, 0.0, 0.0), emission=(1.0, 1.0, 1.0), emission_texture=k) for k in range(2)]
    wall = hw.quad((-4, -4, -1.5), (8, 0, 0.7), (0, 8, 0.4))
    card = hw.quad((-0.6, -0.5, 0), (1.2, 0, 0), (0, 1.0, 0), material=1)
    passes = moving((-0.5, -0.2, 0.1), (0.9, 0.1, 0.5), (10, 20, 5), (30, -20, 30))
    camera = Camera(96, 72, 60.0, moving((0.0, 0.2, 2.2), (0.3, 0.1, 1.9), end_turn_deg=(2, 6, 3)))
    motions, textures = [hw.IDENTITY, passes], (waves(8), waves(2))
    world = hw.world(wall, card, materials=glow, view=camera, motions=motions, textures=textures)
    view = View(SceneData(world), RenderOptions(spp=256, max_depth=1, sampler="sobol", threads=1))
    pictures = []
    for time_us in (T0_US, T1_US):
        frame = Frame(page_aligned((len(view.names), 72, 96)), view.names)
        view.fill_at(0, time_us, frame)
        pictures.append(frame.plane("R").astype(np.float64))
    view.close()
    found = filled(world)
    flow = vectors(found, "Flow.forward.Y", "Flow.forward.X")
    y, x = np.mgrid[:72, :96]
    ends = np.stack([y, x]) + np.moveaxis(flow, -1, 0)
    carried = ndimage.map_coordinates(pictures[1], ends, order=3, mode="nearest")
    # Not where a silhouette lies within a pixel's width: of it, or of where it goes.
    objects = found["Id.object"]
    edge = ndimage.maximum_filter(objects, 5) != ndimage.minimum_filter(objects, 5)
    inside = (ends >= 2).all(axis=0) & (ends[0] < 70) & (ends[1] < 94)
    seen = (ndimage.minimum_filter(found["Flow.forward.covisible"], 5) > 0) & ~edge & inside
    assert {1, 2} == set(np.unique(objects[seen])) and seen.mean() > 0.5
    unmoved = np.abs(pictures[1] - pictures[0])[seen]
    off = np.abs(carried - pictures[0])[seen]
    assert np.median(unmoved) > 0.02
    assert np.median(off) < 3e-4 and np.percentile(off, 99) < 3e-3


def test_without_a_time_before_no_backward_flow_is_valid() -> None:
    found = filled(a_world(), before_us=None)
    assert not vectors(found, "Flow.backward.X", "Flow.backward.Y", "Flow.backward.valid").any()


def test_pure_rotation_is_a_homography() -> None:
    world = a_world(moving((0.1, 0.2, 2.0), (0.1, 0.2, 2.0), (1, 2, 3), (3, -5, 12)))
    found = filled(world)
    focal, centre = reference.intrinsics(world.camera)
    k = np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1]])
    axes = np.diag((1.0, -1.0, -1.0))
    now, then = (world.camera.motion.pose(t * 1e-6)[:3, :3] @ axes for t in (T0_US, T1_US))
    pixels = np.column_stack([reference.pixel_centres(world.camera), np.ones(32 * 24)])
    ends = pixels @ (k @ then.T @ now @ np.linalg.inv(k)).T
    flow = (ends[:, :2] / ends[:, 2:] - pixels[:, :2]).reshape(24, 32, 2)
    stands = np.isin(found["Id.object"], (0, 1, 3))  # sky, wall and floor
    off = np.abs(vectors(found, "Flow.forward.X", "Flow.forward.Y") - flow)[stands]
    assert off.max() < 3e-4
    assert np.abs(flow).max() > 1


def test_a_wall_across_the_view_moves_by_focal_length_over_depth() -> None:
    wall = hw.quad((-9, -9, -3), (18, 0, 0), (0, 18, 0))
    world = replace(
        a_world(moving((0.0, 0.0, 1.0), (0.5, -0.25, 1.0))),
        meshes=(wall, hw.box((5, 5, 5), (6, 6, 6))),
        instances=(Instance(0, hw.IDENTITY), Instance(1, moving((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)))),
    )
    world = replace(world, sphere_lights=(SphereLight(0.1, (1.0, 1.0, 1.0), Static(hw.translation(0, 0, 9))),))
    found = filled(world)
    focal, _ = reference.intrinsics(world.camera)
    moved_s = (T1_US - T0_US) * 1e-6
    expected = np.array([-focal * 1.0 * moved_s / 4, -focal * 0.5 * moved_s / 4])
    assert np.abs(vectors(found, "Flow.forward.X", "Flow.forward.Y") - expected).max() < 1e-4
    assert np.abs(found["Z"] - 4).max() < 1e-6


def test_what_passes_close_before_a_wall_hides_it() -> None:
    """A card at nineteen twentieths of the way to it, and a camera that stands."""
    card = hw.quad((-0.5, -0.5, -2.8), (1, 0, 0), (0, 1, 0))
    world = replace(
        a_world(moving((0.0, 0.0, 1.0), (0.0, 0.0, 1.0))),
        meshes=(hw.quad((-9, -9, -3), (18, 0, 0), (0, 18, 0)), card),
        instances=(Instance(0, hw.IDENTITY), Instance(1, moving((-1.0, 0.0, 0.0), (4.0, 0.0, 0.0)))),
    )
    world = replace(world, sphere_lights=(SphereLight(0.1, (1.0, 1.0, 1.0), Static(hw.translation(0, 0, 9))),))
    found, later = filled(world), reference.truth(world, world.camera, T1_US * 1e-6, T1_US * 1e-6)["owner"]
    wall = found["Id.object"] == 1
    assert np.array_equal(found["Flow.forward.covisible"][wall] > 0, later[wall] == 1) and (later[wall] == 2).sum() > 5


@pytest.mark.slow
@pytest.mark.parametrize(
    "lens",
    [Lens(distortion=(-0.2, 0.05, 1e-3, -2e-3, 0.0)), Lens(model="fisheye", distortion=(0.02, -0.01, 0.0, 0.0))],
    ids=["distorted", "fisheye"],
)
def test_lenses(lens: Lens) -> None:
    """The start is known from the ray, of which the reference has none: both ends are compared by their projection."""
    world = a_world(lens=lens)
    found = filled(world)
    seen = np.isfinite(found["Z"])
    assert seen.mean() > 0.5
    # Undo the projection numerically: rays whose distorted image is the pixel's centre.
    centres = reference.pixel_centres(world.camera)
    plain = replace(world.camera, lens=replace(lens, distortion=()))
    aim = centres.copy()
    identity = np.eye(4)
    for _ in range(100):
        rays = _rays_at(plain, aim)
        aim -= 0.7 * (reference.project(world.camera, identity, rays) - centres)
    rays = _rays_at(plain, aim) @ world.camera.motion.pose(T0_US * 1e-6)[:3, :3].T
    eye = world.camera.motion.pose(T0_US * 1e-6)[:3, 3]
    met = reference.trace(world, T0_US * 1e-6, eye, rays / np.linalg.norm(rays, axis=1, keepdims=True))
    same = found["Id.object"].ravel() == met.owner
    assert same.mean() > 0.98
    points = np.nan_to_num(reference.carried(world, met, T0_US * 1e-6, T1_US * 1e-6))
    ends = reference.project(world.camera, world.camera.motion.pose(T1_US * 1e-6), points)
    flow = vectors(found, "Flow.forward.X", "Flow.forward.Y").reshape(-1, 2)
    mine = same & (met.owner > 0) & (found["Flow.forward.valid"].ravel() > 0)
    assert np.abs(flow - (ends - centres))[mine].max() < 2e-3


def _rays_at(camera: Camera, pixels):
    focal, centre = reference.intrinsics(camera)
    across, down = ((pixels - centre) / focal).T
    if camera.lens.model == "fisheye":
        angle = np.hypot(across, down)
        scale = np.sin(angle) / np.maximum(angle, 1e-300)
        return np.stack([across * scale, -down * scale, -np.cos(angle)], axis=1)
    return np.stack([across, -down, -np.ones_like(across)], axis=1)


@pytest.mark.slow
def test_the_albedo_of_a_blend_is_the_mean_of_all():
    """.6 of the first, .4·.75 of the second and .4·.25 of the third."""
    materials = (
        Material(color=(1.0, 0.0, 0.5), blend_with=1, blend_share=0.4),
        Material(color=(0.0, 1.0, 0.5), blend_with=2, blend_share=0.25),
        Material(color=(0.5, 0.5, 0.5)),
    )
    square = hw.quad((-9, -9, 0), (18, 0, 0), (0, 18, 0))
    world = hw.world(square, materials=materials, view=hw.camera(hw.look_from((0.0, 0.0, 2.0), (0.0, 0.0, 0.0))))
    found = filled(world)
    for channel, expected in (("R", 0.65), ("G", 0.35), ("B", 0.5)):
        assert found[f"Truth.Albedo.{channel}"] == pytest.approx(expected, abs=1e-6)


def test_flow_that_leads_nowhere_is_nowhere_valid_though_it_was_before() -> None:
    """The first frame has none behind it, also where others were filled before, as in a loop."""
    world = a_world()
    out = np.zeros((len(PLANES.names), 24, 32), np.float32)
    truth = TruthPass(SceneData(world), world.camera, PLANES)
    first = PLANES.names.index("Flow.backward.X")
    ends_us: dict[str, int | None] = {"Flow.forward": T1_US, "Flow.backward": 20_000, "Label.flow": T1_US}
    truth.fill(out, T0_US, ends_us)
    assert out[first : first + 4].any(axis=(1, 2)).all()
    truth.fill(out, T0_US, ends_us | {"Flow.backward": None})
    assert not out[first : first + 4].any()


@pytest.mark.usefixtures("any_lights")
@pytest.mark.parametrize("every", [1, 2, 3, 6])
def test_backward_flow_leads_to_the_frame_of_truth_before(every: int) -> None:
    """It is that of the brute force, over as many frames as lie between two of truth."""
    world = replace(a_world(), fps=50.0)
    names = ("depth", "backward-flow")
    options = RenderOptions(spp=1, variances=True, truth=names, truth_every=every, frames=12)
    view = View(SceneData(world), options)
    frame = Frame(page_aligned((len(view.names), view.height, view.width)), view.names)
    view.fill(6, frame)
    expected = reference.truth(world, world.camera, 6 / 50, (6 - every) / 50)["flow"]
    valid = (frame.plane("Flow.backward.valid") > 0) & np.isfinite(expected).all(axis=-1)
    found = np.stack([frame.plane(f"Flow.backward.{axis}") for axis in "XY"], axis=-1)
    apart = np.abs(found - expected)[valid].max(axis=1)
    assert valid.mean() > 0.5 and (apart < 1e-3).mean() > 0.98 and np.abs(expected[valid]).max() > 0.5


@pytest.mark.usefixtures("any_lights")
def test_labels_are_known_in_frames_without_other_truth_too() -> None:
    """Each event has the label of the nearest frame, however seldom depth is asked for."""
    world = replace(a_world(), fps=50.0)
    found = {}
    for every in (1, 3):
        options = RenderOptions(spp=1, variances=True, truth=("depth", "labels"), truth_every=every, frames=12)
        view = View(SceneData(world), options)
        frame = Frame(page_aligned((len(view.names), view.height, view.width)), view.names)
        frame.planes.fill(0.0)
        view.fill(4, frame)
        found[every] = np.stack([frame.plane(name) for name in view.names if name.startswith("Label")])
    assert np.abs(found[1]).max() > 0.1
    np.testing.assert_array_equal(found[3], found[1])
