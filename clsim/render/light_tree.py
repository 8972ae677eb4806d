# Warp: a variable that changes must be born by a call, and wp.static drops a branch only where it stands alone.
# ruff: noqa: UP018, RUF046, SIM102
"""Which of many lights is drawn for a point: by what each may send there, down a binary tree of lights.

A node bounds its lights: by a box, by a cone that holds the directions in which they face, and by the sum of what they
send out. At each node one of both halves is drawn, by an estimate of the irradiance that it gives the point; so a near
lamp is drawn more often than a far one, one that faces away never, and a hundred lamps cost little more than ten
(Conty Estevez and Kulla, "Importance Sampling of Many Lights with Adaptive Tree Splitting", 2018).

Nodes stand as in a heap: the halves of node i are 2i and 2i + 1, the root is 1, and the lights are the last row.
"""

from typing import Any

import warp as wp

from clsim.render.bsdf_kinds import CONDUCTOR, PLASTIC, PRINCIPLED
from clsim.render.features import Features
from clsim.render.materials import Bsdf
from clsim.render.microfacet import SMOOTH
from clsim.render.sampling import luminance

_FRESH = wp.constant(1.0 / 4096.0)
"""Where a branch is so rare, a number of 24 bits is used up, and another one goes on."""

_LEAST = wp.constant(0.01)
"""Cosine below which no light is thought to be seen: spots may shine at more than a right angle to their axis."""
_LEAST_MATT = wp.constant(0.001)


@wp.struct
class LightNode:
    """What is known of some lights.

    Attributes:
        middle, radius_m: of the sphere about the box around them [m].
        intensity: what they send out along their axis, in sum [W·sr⁻¹]; 0 where there is none.
        axis: the middle of the directions in which they face.
        facing, facing_sine: cosine and sine of the angle to the axis within which all face; −1 where they shine around.
        reach: cosine of the angle beyond which none of them shines, from where it faces.
        both: whether one of them shines from its back too.
    """

    middle: wp.vec3
    radius_m: float
    axis: wp.vec3
    intensity: float
    facing: float
    facing_sine: float
    reach: float
    both: int


@wp.struct
class LightTree:
    """The nodes; ``lights`` are those of the last row, whose first node is ``leaves``, and ``slots`` where lights are.

    A light that is not in the tree has the slot −1.
    """

    nodes: wp.array(dtype=LightNode)
    lights: wp.array(dtype=int)
    slots: wp.array(dtype=int)
    leaves: int
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


@wp.func
def _nearer(cosine: float, by_cosine: float, by_sine: float) -> float:
    """Return the cosine of an angle that is smaller by another one, but not below 0."""
    near = float(1.0)
    if cosine < by_cosine:
        near = cosine * by_cosine + wp.sqrt(wp.max(1.0 - cosine * cosine, 0.0)) * by_sine
    return near


def make_light_tree(features: Features) -> tuple[Any, Any]:
    """Return the Warp functions ``draw(tree, to, u, finer)``, of uniform numbers, and ``pdf(tree, light, to)``."""
    glossy = features.kinds != ("diffuse",)

    @wp.func
    def importance(node: LightNode, to: Receiver) -> float:
        """Estimate what of a node's light a point sends on, never 0 where that may be something."""
        value = float(0.0)
        if node.intensity > 0.0:
            away = node.middle - to.position
            distance2 = wp.max(wp.dot(away, away), 1.0e-30)
            distance = wp.sqrt(distance2)
            toward = away / distance
            # Sine and cosine of half the angle under which the node is seen; all around from inside.
            seen_sine = wp.min(node.radius_m / distance, 1.0)
            seen = float(-1.0)
            if seen_sine < 1.0:
                seen = wp.sqrt(1.0 - seen_sine * seen_sine)
            leaving = float(1.0)
            if node.facing > -1.0:
                leaving = -wp.dot(node.axis, toward)
                if node.both != 0:
                    leaving = wp.abs(leaving)
                leaving = _nearer(_nearer(leaving, node.facing, node.facing_sine), seen, seen_sine)
            if leaving > node.reach:
                leaving = wp.max(leaving, _LEAST)
                arriving = wp.dot(to.normal, toward)
                if wp.static(features.transmission):
                    arriving = wp.abs(arriving)
                # Between what its middle sends and the most that any part may.
                arriving = 0.5 * (wp.max(arriving, 0.0) + wp.max(_nearer(arriving, seen, seen_sine), 0.0))
                sent_on = arriving
                if wp.static(glossy):
                    sent_on = arriving * to.matt
                    if to.gloss > 0.0 and arriving > 0.0:
                        # The lobe, as wide as the node's lights make it; angles to the half vector are half as large.
                        alpha2 = wp.min(to.alpha2 + 0.25 * seen_sine * seen_sine, 1.0)
                        narrow = 0.5 * (1.0 + wp.dot(to.mirror, toward)) * (alpha2 - 1.0) + 1.0
                        sent_on = sent_on + 0.25 * to.gloss * alpha2 / (wp.pi * narrow * narrow)
                # The mean of the squared distance to a flat or long box, which the sphere is about.
                value = node.intensity * leaving * sent_on / (distance2 + node.radius_m * node.radius_m / 3.0)
        return value

    @wp.func
    def draw(tree: LightTree, to: Receiver, u: float, finer: float) -> LightChoice:
        node = int(1)
        probability = float(1.0)
        rest = float(u)
        fresh = bool(False)
        while node < tree.leaves and probability > 0.0:
            node = 2 * node
            left = importance(tree.nodes[node], to)
            right = importance(tree.nodes[node + 1], to)
            share = left / wp.max(left + right, 1.0e-37)
            if left + right <= 0.0:
                probability = 0.0
            elif rest < share:
                probability = probability * share
                rest = rest / share
            else:
                node = node + 1
                probability = probability * (1.0 - share)
                rest = (rest - share) / (1.0 - share)
            if probability < _FRESH and not fresh:
                fresh = True
                rest = finer
        choice = LightChoice(-1, 0.0)
        if probability > 0.0:
            choice = LightChoice(tree.lights[node - tree.leaves], probability)
        return choice

    @wp.func
    def pdf(tree: LightTree, light: int, to: Receiver) -> float:
        node = tree.leaves + tree.slots[light]
        probability = float(1.0)
        while node > 1:
            own = importance(tree.nodes[node], to)
            other = importance(tree.nodes[node ^ 1], to)
            probability = probability * (own / wp.max(own + other, 1.0e-37))
            node = node // 2
        return probability

    return draw, pdf
