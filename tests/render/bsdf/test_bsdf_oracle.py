"""Scattering models against Mitsuba's: f·cos θ for the same directions, from both sides."""

import numpy as np
import pytest

from clsim.scene import Material
from tests.render.bsdf.hand_bsdf import Lone

pytestmark = pytest.mark.oracle
mi = pytest.importorskip("mitsuba", reason="needs the [oracle] extra")
NAMES = {"specular_tint": "spec_tint", "transmission": "spec_trans", "ior": "eta"}


@pytest.fixture(autouse=True)
def variant():
    mi.set_variant("scalar_rgb")


def directions(rng, count):
    found = rng.normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def rgb(color):
    return {"type": "rgb", "value": list(map(float, color))}


def assert_alike(material, bsdf, rng, *, behind, rtol=2e-3):
    ours, theirs = Lone(material), mi.load_dict(bsdf)
    out, in_ = directions(rng, 300), directions(rng, 300)
    # Of random pairs few are near the narrow lobes.
    in_[::2] = out[::2] * (-1, -1, 1) + 0.1 * in_[::2]
    in_ /= np.linalg.norm(in_, axis=1, keepdims=True)
    out[:, 2] = np.abs(out[:, 2])
    for front in (True, False) if behind else (True,):
        side = (1, 1, 1 if front else -1)
        point = mi.SurfaceInteraction3f()
        expected = []
        for wo, wi in zip(out * side, in_ * side, strict=True):
            point.wi = mi.Vector3f(wo.tolist())
            expected.append(np.array(theirs.eval(mi.BSDFContext(), point, mi.Vector3f(wi.tolist()))))
        assert np.max(expected) > 0.01
        np.testing.assert_allclose(ours.evaluate(out, in_, front)[0], expected, rtol=rtol, atol=1e-6)


@pytest.mark.parametrize("seed", range(8))
def test_disney_is_mitsubas_principled(seed):
    rng = np.random.default_rng(seed)
    lobes = ("metallic", "specular_tint", "sheen", "sheen_tint", "flatness", "clearcoat", "transmission")
    # Each is nothing as often as it is something.
    values = {name: float(rng.uniform() * rng.integers(2)) for name in lobes} | {"ior": rng.uniform(1.1, 1.9)}
    roughness, anisotropic, gloss = rng.uniform(0.15, 1.0), rng.uniform() * rng.integers(2), rng.uniform(0, 0.9)
    color = rng.uniform(0.05, 1.0, 3)
    bsdf = {
        "type": "principled",
        "base_color": rgb(color),
        "roughness": roughness,
        "anisotropic": float(anisotropic),
        "clearcoat_gloss": gloss,
        **{NAMES.get(name, name): value for name, value in values.items()},
    }
    material = Material(
        kind="disney",
        color=tuple(color.tolist()),
        alpha=roughness**2,
        stretch=1 / np.sqrt(1 - 0.9 * anisotropic),
        clearcoat_alpha=0.1 - 0.099 * gloss,
        **values,
    )
    assert_alike(material, bsdf, rng, behind=values["transmission"] > 0)


@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
@pytest.mark.parametrize("kind", ["conductor", "dielectric", "plastic"])
def test_microfacets_are_mitsubas(kind, distribution):
    """Even roughness, and where Mitsuba has it, 4 times as rough along u."""
    for alpha_u, alpha_v in ((0.3, 0.3), (0.08, 0.08), (0.6, 0.15)):
        if kind == "plastic" and alpha_u != alpha_v:
            continue
        material = Material(
            kind=kind,
            color=(1, 1, 1) if kind != "plastic" else (0.6, 0.3, 0.1),
            ior=1.4,
            alpha=float(np.sqrt(alpha_u * alpha_v)),
            stretch=float(np.sqrt(alpha_u / alpha_v)),
            distribution=distribution,
        )
        rough = {"alpha_u": alpha_u, "alpha_v": alpha_v} if kind != "plastic" else {"alpha": alpha_u}
        rest = {
            "conductor": {"material": "none"},
            "dielectric": {"int_ior": 1.4, "ext_ior": 1.0},
            "plastic": {"int_ior": 1.4, "ext_ior": 1.0, "diffuse_reflectance": rgb((0.6, 0.3, 0.1))},
        }[kind]
        bsdf = {"type": f"rough{kind}", "distribution": distribution, **rough, **rest}
        rng = np.random.default_rng(2)
        # Mitsuba's coats have tables of their own.
        assert_alike(material, bsdf, rng, behind=kind == "dielectric", rtol=0.01 if kind == "plastic" else 2e-3)
