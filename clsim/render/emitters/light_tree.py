# ruff: noqa: UP018, RUF046, SIM102
"""The light tree: one of many lights is drawn for a point, by what each may send there.

A node bounds its lights: by a box, by a cone that holds the directions in which they face, and by the sum of what they
send out. At each node one of its eight parts is drawn, by an estimate of the irradiance that it gives the point; so a
near lamp is drawn more often than a far one, one that faces away never, and a hundred lamps cost little more than ten
(Conty Estevez and Kulla, "Importance Sampling of Many Lights with Adaptive Tree Splitting", 2018).

Nodes stand as in a heap: the halves of node i are 2i and 2i + 1, the root is 1, and the lights are the last row. So the
parts of node i, three rows below, are 8i to 8i + 7. They lie side by side in a group, whose number is i, and are looked
at at once. Where the rows do not come out even, the first step is to two or four parts, in the group 0.
"""

from typing import Any

import warp as wp

from clsim.render.features.bsdf_kinds import CONDUCTOR, PLASTIC, PRINCIPLED
from clsim.render.features.features import Features
from clsim.render.native import native_code
from clsim.render.sampling.sampling import luminance
from clsim.render.surfaces.materials import Bsdf
from clsim.render.surfaces.microfacet import SMOOTH

_FRESH = wp.constant(1.0 / 4096.0)
"""Where a branch is so rare, a number of 24 bits is used up, and another one goes on."""

_BELOW_1 = wp.constant(1.0 - 2.0**-24)
_LEAST = 0.01
"""Cosine below which no light is thought to be seen: spots may shine at more than a right angle to their axis."""
_LEAST_MATT = wp.constant(0.001)


Eight = wp.types.vector(length=8, dtype=wp.float32)
_Eight3 = wp.types.matrix(shape=(3, 8), dtype=wp.float32)


@wp.struct
class LightGroup:
    """What is known of the lights of eight nodes.

    Attributes:
        middle, radius_m: of the sphere about the box around them [m].
        intensity: what they send out along their axis, in sum [W·sr⁻¹]; 0 where there is none.
        axis: the middle of the directions in which they face.
        facing, facing_sine: cosine and sine of the angle to the axis within which all face; −1 where they shine around.
        reach: cosine of the angle beyond which none of them shines, from where it faces.
        both: 1 where one of them shines from its back too.
    """

    middle: _Eight3
    radius_m: Eight
    axis: _Eight3
    intensity: Eight
    facing: Eight
    facing_sine: Eight
    reach: Eight
    both: Eight


@wp.struct
class LightTree:
    """The nodes; ``lights`` are those of the last row, whose first node is ``leaves``, and ``slots`` where lights are.

    A light that is not in the tree has the slot −1. The root has ``parts``: 2, 4 or 8.
    """

    nodes: wp.array[LightGroup]
    lights: wp.array[int]
    slots: wp.array[int]
    leaves: int
    parts: int
    probability: float


@wp.struct
class LightChoice:
    """A light and the probability with which it was drawn; −1 and 0 where none sends anything."""

    light: int
    probability: float


@wp.struct
class Receiver:
    """A point to be lit: its shading normal, and how it sends light on to where it is seen from.

    ``matt`` is a diffuse reflectance over π; ``gloss`` the reflectance of a lobe of GGX about ``mirror``, with α².
    """

    position: wp.vec3
    normal: wp.vec3
    mirror: wp.vec3
    matt: float
    gloss: float
    alpha2: float


def make_receiver(features: Features) -> Any:
    """Return the Warp function ``receiver(bsdf, position, normal, wo)``, ``wo`` being the way to where it is seen from.

    What is smooth has no lobe to speak of: no light can be drawn for it. What passes light counts as matt.
    """

    @wp.func
    def receiver(b: Bsdf, position: wp.vec3, normal: wp.vec3, wo: wp.vec3) -> Receiver:
        r = Receiver()
        r.position = position
        r.normal = normal
        r.matt = 1.0
        if wp.static(features.light_tree and features.kinds != ("diffuse",)):
            if b.kind == CONDUCTOR or b.kind == PLASTIC or b.kind == PRINCIPLED:
                cosine = wp.dot(normal, wo)
                index = (b.eta - 1.0) / (b.eta + 1.0)
                metal = wp.where(b.kind == CONDUCTOR, 1.0, b.metallic)
                straight = wp.lerp(index * index * luminance(b.specular), luminance(b.color), metal)
                if b.complex_index != 0:
                    straight = luminance(b.specular)
                gloss = straight + (1.0 - straight) * wp.pow(wp.clamp(1.0 - cosine, 0.0, 1.0), 5.0)
                r.matt = wp.max((1.0 - metal) * (1.0 - gloss) * luminance(b.color) / wp.pi, _LEAST_MATT)
                if b.alpha >= SMOOTH:
                    r.mirror = normal * (2.0 * cosine) - wo
                    r.gloss = gloss
                    r.alpha2 = b.alpha * b.alpha
        return r

    return receiver


@wp.func_native(native_code("light_importance.h", {"LEAST": _LEAST}))
def _importances(
    nodes: wp.array[LightGroup], group: int, first: int, end: int, to: Receiver, glossy: bool, transmission: bool
) -> Eight:
    """Estimate what of each node's light a point sends on, never 0 where that may be something."""
    ...


def make_light_tree(features: Features) -> tuple[Any, Any]:
    """Return the Warp functions ``draw(tree, to, u, finer)``, of uniform numbers, and ``pdf(tree, light, to)``."""
    glossy = features.kinds != ("diffuse",)
    transmission = features.transmission

    @wp.func
    def importances(tree: LightTree, group: int, to: Receiver) -> Eight:
        # In the group 0 only the parts of the root count.
        first = wp.where(group == 0, tree.parts, 0)
        end = wp.where(group == 0, 2 * tree.parts, 8)
        return _importances(tree.nodes, group, first, end, to, wp.static(glossy), wp.static(transmission))

    @wp.func
    def draw(tree: LightTree, to: Receiver, u: float, finer: float) -> LightChoice:
        node = int(1)
        probability = float(1.0)
        rest = float(u)
        fresh = bool(False)
        while node < tree.leaves and probability > 0.0:
            group = wp.where(node == 1, tree.parts // 8, node)
            values = importances(tree, group, to)
            total = float(0.0)
            for k in range(8):
                total += values[k]
            place = rest * total
            before = float(0.0)
            drawn = int(0)
            own = float(0.0)
            left = float(0.0)
            for k in range(8):
                if values[k] > 0.0 and place >= before:
                    drawn = k
                    own = values[k]
                    left = place - before
                before += values[k]
            probability = probability * (own / wp.max(total, 1.0e-37))
            rest = wp.min(left / wp.max(own, 1.0e-37), _BELOW_1)
            node = 8 * group + drawn
            if probability < _FRESH and not fresh:
                fresh = True
                rest = finer
        choice = LightChoice(-1, 0.0)  # type: ignore[call-arg]
        if probability > 0.0:
            choice = LightChoice(tree.lights[node - tree.leaves], probability)  # type: ignore[call-arg]
        return choice

    @wp.func
    def pdf(tree: LightTree, light: int, to: Receiver) -> float:
        node = tree.leaves + tree.slots[light]
        probability = float(1.0)
        while node > 1:
            group = node // 8
            values = importances(tree, group, to)
            total = float(0.0)
            for k in range(8):
                total += values[k]
            probability = probability * (values[node % 8] / wp.max(total, 1.0e-37))
            node = wp.max(group, 1)
        return probability

    return draw, pdf
