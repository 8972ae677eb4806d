"""Disney's model against Mitsuba's ``principled``: f·cos θ for the same directions, from outside and inside."""

import numpy as np
import pytest
from hand_bsdf import Lone

from clsim.scene import Material

pytestmark = pytest.mark.oracle
mi = pytest.importorskip("mitsuba", reason="needs the [oracle] extra")
NAMES = {"specular_tint": "spec_tint", "transmission": "spec_trans", "ior": "eta"}


@pytest.fixture(autouse=True)
def variant():
    mi.set_variant("scalar_rgb")


def directions(rng, count):
    found = rng.normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


@pytest.mark.parametrize("seed", range(8))
def test_values_are_those_of_mitsuba(seed):
    rng = np.random.default_rng(seed)
    lobes = ("metallic", "specular_tint", "sheen", "sheen_tint", "flatness", "clearcoat", "transmission")
    # Each is nothing as often as it is something.
    values = {name: float(rng.uniform() * rng.integers(2)) for name in lobes} | {"ior": rng.uniform(1.1, 1.9)}
    roughness, anisotropic, gloss = rng.uniform(0.15, 1.0), rng.uniform() * rng.integers(2), rng.uniform(0, 0.9)
    color = rng.uniform(0.05, 1.0, 3)
    theirs = mi.load_dict(
        {
            "type": "principled",
            "base_color": {"type": "rgb", "value": color.tolist()},
            "roughness": roughness,
            "anisotropic": float(anisotropic),
            "clearcoat_gloss": gloss,
            **{NAMES.get(name, name): value for name, value in values.items()},
        }
    )
    ours = Lone(
        Material(
            kind="disney",
            color=tuple(color.tolist()),
            alpha=roughness**2,
            stretch=1 / np.sqrt(1 - 0.9 * anisotropic),
            clearcoat_alpha=0.1 - 0.099 * gloss,
            **values,
        )
    )
    out, in_ = directions(rng, 300), directions(rng, 300)
    out[:, 2] = np.abs(out[:, 2])
    for front in (True, False) if values["transmission"] else (True,):
        side = (1, 1, 1 if front else -1)
        point = mi.SurfaceInteraction3f()
        expected = []
        for wo, wi in zip(out * side, in_ * side, strict=True):
            point.wi = mi.Vector3f(wo.tolist())
            expected.append(np.array(theirs.eval(mi.BSDFContext(), point, mi.Vector3f(wi.tolist()))))
        assert np.max(expected) > 0
        np.testing.assert_allclose(ours.evaluate(out, in_, front)[0], expected, rtol=2e-3, atol=1e-6)
