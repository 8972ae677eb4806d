"""Synthetic frames for the reference's tests."""

import numpy as np

from clsim.frames import Frame, frame_time_us

FEATURES = ("Depth", "Nx", "Ny", "Nz", "Albedo.R", "Albedo.G", "Albedo.B", "Coverage")


def make_frame(brightness, index=0, fps=100.0, **planes):
    """A grey frame whose log brightness is given, with further planes named as in ``Frame`` (``.`` written ``_``)."""
    rgb = np.exp(np.asarray(brightness, dtype=np.float64))
    names = ("R", "G", "B", *(name.replace("_", ".") for name in planes))
    stack = np.stack([rgb, rgb, rgb, *(np.broadcast_to(p, rgb.shape) for p in planes.values())])
    return Frame(np.ascontiguousarray(stack, dtype=np.float32), names, frame_time_us(index, fps), index)


def random_frames(seed, count=4, height=9, width=11, noise=0.1, misses=True, step=0.35):
    """A textured surface that drifts and tilts, with sky in a corner, noise, and all feature planes."""
    rng = np.random.default_rng(seed)
    a, b, c, d = rng.uniform(0.2, 0.9, 4)
    frames = []
    for k in range(count):
        ys, xs = np.mgrid[0:height, 0:width].astype(np.float64)
        xs = xs + step * k * (1 + a)
        depth = 3 + 0.1 * ys + 0.5 * np.sin(b * xs)
        normal = np.stack([np.sin(a * xs), np.cos(b * ys), np.sin(c * (xs + ys))])
        albedo = 0.5 + 0.3 * np.stack([np.sin(d * xs), np.sin(c * xs + ys), np.cos(a * ys)])
        coverage = np.ones((height, width))
        if misses:
            sky = (xs + ys) % 17 < 4
            coverage[sky] = 0
            coverage[np.roll(sky, 1, axis=1) & ~sky] = 0.5
            depth[sky] = 0
            normal[:, sky] = 0
            albedo[:, sky] = 0
        brightness = np.log(albedo.mean(axis=0) + 0.2) + 0.2 * normal[0] - 0.1 * depth
        brightness += noise * rng.standard_normal((height, width))
        planes = dict(zip((f.replace(".", "_") for f in FEATURES), (depth, *normal, *albedo, coverage), strict=True))
        planes["Variance_Luminance"] = (noise * np.exp(brightness)) ** 2
        frames.append(make_frame(brightness, k, **planes))
    return frames


def run(detector, frames):
    """All events of the frames, in order."""
    return np.concatenate([detector.step(frame) for frame in frames])
