"""Scattering models by themselves: one material, directions in the frame of its normal, z up."""

from __future__ import annotations

import numpy as np
import warp as wp

from clsim.render import RenderOptions
from clsim.render.accel.geometry import Surface
from clsim.render.bsdf.bsdf import make_bsdf
from clsim.render.device.devices import start_warp
from clsim.render.surfaces.materials import Materials, make_materials
from clsim.render.surfaces.upload_materials import upload_materials
from tests.render import hand_worlds as hw


class Lone:
    """A material on its own."""

    def __init__(self, material):
        start_warp()
        world = hw.world(hw.quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), materials=(material,))
        self._materials = upload_materials(world, "cpu")
        self._evaluate, self._draw = _kernels(RenderOptions().features_of(world))

    def evaluate(self, wo, wi, front=True):
        """f·cos θ ``[n, 3]`` and density ``[n]``; arguments are broadcast."""
        wo, wi = (np.ascontiguousarray(a, np.float32) for a in np.broadcast_arrays(wo, wi))
        shape = wo.shape[:-1]
        values, pdfs = wp.empty(wo.size // 3, dtype=wp.vec3), wp.empty(wo.size // 3, dtype=float)
        inputs = [self._materials, _vectors(wo), _vectors(wi), bool(front)]
        wp.launch(self._evaluate, dim=len(pdfs), inputs=inputs, outputs=[values, pdfs], device="cpu")
        return values.numpy().reshape(*shape, 3).astype(float), pdfs.numpy().reshape(shape).astype(float)

    def draw(self, wo, count, front=True, seed=1):
        """Directions ``[n, 3]``, weights ``[n, 3]``, densities and which of them are mirrors', ``[n]``."""
        # Multiples of 2⁻²⁴, as the tracer's own.
        random = np.random.default_rng(seed).integers(0, 1 << 24, (count, 3)) / float(1 << 24)
        out = [wp.empty(count, dtype=dtype) for dtype in (wp.vec3, wp.vec3, float, bool)]
        inputs = [self._materials, wp.vec3(*np.asarray(wo, float)), bool(front), _vectors(random)]
        wp.launch(self._draw, dim=count, inputs=inputs, outputs=out, device="cpu")
        return tuple(array.numpy().astype(bool if i == 3 else float) for i, array in enumerate(out))


def _vectors(values):
    return wp.array(np.asarray(values, np.float32).reshape(-1, 3), dtype=wp.vec3, device="cpu")


_KERNELS = {}


def _kernels(features):
    if features not in _KERNELS:
        resolve, *_ = make_materials(features)
        outgoing, value, sample, _ = make_bsdf(features)

        @wp.kernel(module="unique", enable_backward=False)
        def evaluate(
            materials: Materials,
            wo: wp.array(dtype=wp.vec3),
            wi: wp.array(dtype=wp.vec3),
            front: bool,
            out_value: wp.array(dtype=wp.vec3),
            out_pdf: wp.array(dtype=float),
        ):
            i = wp.tid()
            point = Surface()
            point.front = front
            bsdf = resolve(materials, point)
            normal = wp.vec3(0.0, 0.0, 1.0)
            scattering = value(materials, bsdf, normal, outgoing(materials, bsdf, normal, wo[i]), wi[i])
            out_value[i] = scattering.value
            out_pdf[i] = scattering.pdf

        @wp.kernel(module="unique", enable_backward=False)
        def draw(
            materials: Materials,
            wo: wp.vec3,
            front: bool,
            random: wp.array(dtype=wp.vec3),
            out_direction: wp.array(dtype=wp.vec3),
            out_weight: wp.array(dtype=wp.vec3),
            out_pdf: wp.array(dtype=float),
            out_delta: wp.array(dtype=bool),
        ):
            i = wp.tid()
            point = Surface()
            point.front = front
            r = random[i]
            bsdf = resolve(materials, point)
            normal = wp.vec3(0.0, 0.0, 1.0)
            s = sample(materials, bsdf, normal, outgoing(materials, bsdf, normal, wo), r[0], wp.vec2(r[1], r[2]))
            out_direction[i] = s.direction
            out_weight[i] = s.weight
            out_pdf[i] = s.pdf
            out_delta[i] = s.delta

        _KERNELS[features] = evaluate, draw
    return _KERNELS[features]


def from_angles(theta, phi=0.0):
    """Unit directions ``[..., 3]``."""
    theta, phi = np.broadcast_arrays(np.asarray(theta, float), phi)
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
