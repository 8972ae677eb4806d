"""What the functions of all scattering models exchange."""

import warp as wp


@wp.struct
class Outgoing:
    """The way to where a point is seen from, ``wo`` in the ``frame`` of its shading normal.

    Of plastic also what hangs on that way alone: the share of light that the coat lets pass, the probability with which
    the ``coat`` is drawn, and the colour ``below`` it, which light meets again and again.
    """

    frame: wp.mat33
    wo: wp.vec3
    passing: float
    coat: float
    below: wp.vec3


@wp.struct
class Scattering:
    """f·cos θ [sr⁻¹] and the density of the model's own sampling [sr⁻¹] for one pair of directions, without mirrors."""

    value: wp.vec3
    pdf: float


@wp.struct
class Scattered:
    """A direction that a model drew: weight f·cos θ / density, and 0 where there is none.

    ``delta`` says that it was drawn by a perfect mirror, so that no light could have been sampled there and ``pdf`` is
    not used. Light that crosses an interface changes its radiance by 1 / ``eta2``, the square of the relative index,
    which the weight contains (Veach 1997, section 5.2).
    """

    direction: wp.vec3
    weight: wp.vec3
    pdf: float
    delta: bool
    eta2: float
