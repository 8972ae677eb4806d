"""Options of rendering a world."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from clsim.errors import InputError, require_choice
from clsim.frames import TRUTH_PLANES
from clsim.frames.patches import Patches
from clsim.render.accel.geometry import Tree
from clsim.render.features.features import Features, SceneFeatures, Strategy, view_features
from clsim.render.features.scene_features import scene_features
from clsim.render.sampling.sampling import MAX_BOUNCES
from clsim.scene import Camera, World

LARGEST_SPP, LARGEST_FIRST_HIT_RAYS = 1 << 20, 4096
"""Nobody means more: a digit too many is better told than waited for."""
_LARGEST_SEED = (1 << 64) - 1


@dataclass(frozen=True)
class RenderOptions:
    """Options of rendering a world."""

    spp: int = 8
    """Paths per pixel and frame."""
    fps: float | None = None
    """Frames per simulated second; None takes the world's."""
    frames: int | None = None
    """Number of frames; None plays the world's motion once, both ends included."""
    seed: int = 0
    """Seed of all random numbers, 0 to 2⁶⁴ − 1."""
    noise: Literal["common", "independent"] = "common"
    """Whether every frame uses the same random numbers, so that a still pixel stays exactly the same, or its own."""
    max_depth: int = 8
    """Longest path in edges: 1 sees emitters only, 2 adds direct light, 3 one bounce of indirect light."""
    roulette_start: int = 5
    """Number of edges after which Russian roulette may end a path."""
    threads: int | None = None
    """Threads on a CPU; None takes one a core. Pictures do not depend on it."""
    tile_pixels: int | None = None
    """Pixels in a launch; None chooses. Pictures do not depend on it."""
    device: str = "cpu"
    """Render device, "cpu" or "cuda:0" …"""
    variances: bool = False
    """Whether frames have the planes of variances."""
    strategy: Strategy = "mis"
    """How light is found; other than "mis" only to check it."""
    sampler: Literal["pcg", "sobol"] = "pcg"
    """Whether samples are independent ("pcg") or spread evenly by Owen-scrambled Sobol points, in four batches.

    With "sobol", sample i belongs to batch i mod 4; batches are independent, and variances are estimated from their
    means: that is honest, but noisier, and up to a fifth too large where the number of samples is not a multiple of 4.
    A power of 2 from 4 is spread best.
    """
    follow_specular: bool = True
    """Whether the planes of albedo, normal and depth show what mirrors and clear glass show instead of themselves.

    Depth is then the length of the way, albedo is multiplied by what the chain of mirrors lets through, and normals
    are those of the surface found, not mirrored. Where glass both reflects and refracts, each sample takes one way, so
    that the planes hold the mean of two surfaces and a variance. A way that ends nowhere shows the last mirror.
    """
    first_hit_rays: int = 0
    """Primary rays, which find the first hit alone, in a pixel that shows more than one surface; 0 for none.

    From 12 on, several times as many are traced where a pixel is about to fire, if thresholds are known.
    Where a few lamps shine on diffuse surfaces, direct light is analytic there, and its shadows are traced: without
    noise where nothing stands between. A part-lit pixel then gets 2 of 1, 16 of 8, 32 of 16 to 64, 128 of 256.
    They give the features and the light seen directly, and paths only the irradiance, so that textures and edges are
    clean after few paths; frames have an emission plane then.
    """
    probe_spp: int | None = None
    """Paths where no event is near, doubled elsewhere; None traces ``spp``. Needs first-hit rays and common noise."""
    probe_every: int = 1
    """Frames from one probe of a pixel to the next where no event is near; in between, the last irradiance is taken.

    Needs first-hit rays and common noise where it is more than 1.
    """
    light_cache: bool = False
    """Whether light is cached on surfaces and becomes better from frame to frame, so that few paths will do.

    Needs first-hit rays and common noise. ``spp`` paths are traced where little is known, ``probe_spp`` elsewhere.
    """
    stored_paths: int = 64
    """Where more than the camera moves: paths stored in a cell of light, traced again where what they met has moved."""
    lamp_paths: int = 128
    """How many these are in a scene whose lamps move, which changes what each of them finds."""
    follow_every: int = 6
    """Frames in which each of these is traced again once where lamps move; in between it changes steadily."""
    first_frame_error: float = 0.28
    """Relative standard error of a pixel's light, by its own paths, until which the first frame is rendered again."""
    lights_set: bool = False
    """Whether lights are set from outside: cached light follows them then, also where nothing else moves."""
    light_hz: float | None = None
    """How often a second the cache is updated, whatever the frames' times; None does so in every frame.

    A frame and what is traced in the step that it ends are shaded by the cache as it was before.
    """
    fires_at: tuple[float, float] | None = None
    """Contrast thresholds of ON and OFF events, if ideal pixels see the frames; None where nobody knows when they fire.

    With cached light, pixels that are about to fire get more primary rays, and others fewer.
    """
    duplicate_every: int = 0
    """One in so many pixels is sampled a second time with other random numbers, to measure noise; 0 for none.

    Needs ``light_cache`` or no first-hit rays; `View.sampled_twice` has what was seen.
    """
    duplicate_in: Patches | None = None
    """Where all pixels are sampled a second time; needs no first-hit rays, and no ``duplicate_every``."""
    truth: tuple[str, ...] = ()
    """Planes of truth that frames have in addition: names of `clsim.frames.TRUTH_PLANES`."""
    truth_every: int = 1
    """Frames from one with truth to the next, the first being one; in the others these planes hold nothing of use."""
    tree: Tree | None = None
    """How rays find triangles; None takes the fastest of the device, others are there to compare."""

    def __post_init__(self) -> None:
        """Refuse values that cannot work."""
        require_choice("noise", self.noise, ("common", "independent"))
        require_choice("sampler", self.sampler, ("pcg", "sobol"))
        require_choice("tree", self.tree, (None, "bvh16", "warp"))
        for option, value in (
            ("spp", self.spp),
            ("frames", self.frames),
            ("max_depth", self.max_depth),
            ("threads", self.threads),
            ("tile_pixels", self.tile_pixels),
            ("probe_spp", self.probe_spp),
            ("probe_every", self.probe_every),
            ("stored_paths", self.stored_paths),
            ("lamp_paths", self.lamp_paths),
            ("follow_every", self.follow_every),
            ("truth_every", self.truth_every),
        ):
            if value is not None and value < 1:
                raise InputError(f"`{option}` must be at least 1, got {value}")
        for option, count, limit in (
            ("spp", self.spp, LARGEST_SPP),
            ("first_hit_rays", self.first_hit_rays, LARGEST_FIRST_HIT_RAYS),
            ("max_depth", self.max_depth, MAX_BOUNCES),
        ):
            if count > limit:
                raise InputError(f"`{option}` must be at most {limit}, got {count}")
        for option, rate in (
            ("fps", self.fps),
            ("light_hz", self.light_hz),
            ("first_frame_error", self.first_frame_error),
        ):
            if rate is not None and not 0 < rate < float("inf"):
                raise InputError(f"`{option}` must be a positive number, got {rate}")
        if not 0 <= self.seed <= _LARGEST_SEED:
            raise InputError(f"`seed` must be from 0 to 2^64 - 1, got {self.seed}")
        for name in self.truth:
            require_choice("truth", name, tuple(TRUTH_PLANES))
        if self.first_hit_rays < 0:
            raise InputError(f"`first_hit_rays` must be at least 0, got {self.first_hit_rays}")
        if self.first_hit_rays and self.variances:
            raise InputError("first-hit rays give no variances; expected `first_hit_rays` 0 where variances are wanted")
        for option, steers in (
            ("probe_spp", self.probe_spp is not None),
            ("probe_every", self.probe_every > 1),
            ("light_cache", self.light_cache),
        ):
            if steers and not self.first_hit_rays:
                raise InputError(f"`{option}` needs `first_hit_rays` of at least 1, got 0")
            if steers and self.noise != "common":
                raise InputError(f"`{option}` needs `noise` common, got {self.noise}")
        if self.fires_at is not None and (not self.light_cache or self.light_hz is not None or min(self.fires_at) <= 0):
            raise InputError(f"`fires_at` {self.fires_at} needs positive thresholds, `light_cache` and no `light_hz`")
        if self.duplicate_every < 0:
            raise InputError(f"`duplicate_every` must not be negative, got {self.duplicate_every}")
        if self.duplicate_every and self.first_hit_rays and not self.light_cache:
            raise InputError(f"`duplicate_every` {self.duplicate_every} needs `light_cache` or no `first_hit_rays`")
        if self.duplicate_in is not None and (self.duplicate_every or self.first_hit_rays):
            raise InputError("`duplicate_in` needs no `duplicate_every` and no `first_hit_rays`")
        if self.probe_spp is not None and self.probe_spp > self.spp:
            raise InputError(f"`probe_spp` must be at most `spp`, which is {self.spp}, got {self.probe_spp}")

    def features(self, scene: SceneFeatures, camera: Camera, requests: bool = False, replay: bool = False) -> Features:
        """Return the features of the kernel for such a scene and camera, for all pixels or those of requests."""
        sobol, first_hits = self.sampler == "sobol", self.first_hit_rays > 0
        return view_features(
            scene,
            camera,
            self.variances,
            self.strategy,
            self.follow_specular,
            sobol,
            first_hits,
            self.light_cache,
            requests,
            self.lights_set,
            replay,
        )

    def features_of(self, world: World) -> Features:
        """Return the features of the kernel for a world and its own camera."""
        return self.features(scene_features(world, world.camera.shutter_s, light_cache=self.light_cache), world.camera)
