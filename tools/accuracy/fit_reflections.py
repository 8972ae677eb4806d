"""Fit cosine lobes to what rough surfaces reflect of lamps: writes clsim/render/surfaces/reflections.npz.

    python -m tools.accuracy.fit_reflections        # ten minutes

A cosine lobe whose directions are transformed by a matrix looks much like a lobe of microfacets, and how much of it a
polygon covers is known in closed form (Heitz, Dupuy, Hill and Neubelt, Real-Time Polygonal-Light Shading with Linearly
Transformed Cosines, SIGGRAPH 2016). The table has for each model of microfacets, at even steps of √α and of √(1 − cos)
of the direction in which light leaves, the inverse matrix (four entries of it; the middle one is 1, the others are 0),
the share of light that is reflected from all around without Fresnel's term, and that share times Schlick's (1 − cos)⁵.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from clsim.render.surfaces import plastic_tables as tables
from clsim.render.surfaces import reflection_table

NODES = 32
"""Directions drawn along each axis, of those that the lobe sends and of those of a cosine."""
LEAST_ALPHA = 1e-3


def microfacets(model, alpha, wo, wi):
    """Return D·G / (4 wo.z) [N] and the cosine between ``wo`` and the microfacets."""
    h = wi + wo
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    z = np.maximum(h[:, 2], 1e-9)
    tan2 = (1 - z**2) / z**2
    if model == "beckmann":
        normals = np.exp(-tan2 / alpha**2) / (np.pi * alpha**2 * z**4)
        hidden = tables._beckmann_g1(wi[:, 2], alpha) * tables._beckmann_g1(wo[2], alpha)
    else:
        normals = 1 / (np.pi * alpha**2 * z**4 * (1 + tan2 / alpha**2) ** 2)
        out, inwards = tables._ggx_g1(wo[2], alpha), tables._ggx_g1(wi[:, 2], alpha)
        hidden = out * inwards if model == "separable" else 1 / (1 / out + 1 / inwards - 1)
    return np.where(wi[:, 2] > 0, normals * hidden / (4 * wo[2]), 0.0), h @ wo


def directions(model, alpha, wo):
    """Return directions [N, 3] over the hemisphere and what each is worth in a sum over solid angle [N]."""
    u0, u1 = (np.ravel(each) for each in np.meshgrid(*[(np.arange(NODES) + 0.5) / NODES] * 2))
    h = tables._visible_normals(wo, alpha, u0, u1)
    sent = 2 * (h @ wo)[:, None] * h - wo
    radius, turn = np.sqrt(u0), 2 * np.pi * u1
    around = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.sqrt(1 - u0)], axis=1)
    wi = np.concatenate([sent, around])
    wi = wi[wi[:, 2] > 1e-6]
    h = (wi + wo) / np.linalg.norm(wi + wo, axis=1, keepdims=True)
    tan2 = (1 - h[:, 2] ** 2) / h[:, 2] ** 2
    normals = 1 / (np.pi * alpha**2 * h[:, 2] ** 4 * (1 + tan2 / alpha**2) ** 2)
    drawn = normals * tables._ggx_g1(wo[2], alpha) / (4 * wo[2])
    return wi, 1 / (NODES**2 * (drawn + wi[:, 2] / np.pi))


def transformed_cosine(inverse, wi):
    """Return the density [N] of the cosine lobe that ``inverse`` turns back into a plain one."""
    turned = wi @ inverse.T
    length = np.linalg.norm(turned, axis=1)
    return np.maximum(turned[:, 2], 0) / np.pi * abs(np.linalg.det(inverse)) / length**4


def matrix(middle, parameters):
    """Return the matrix that turns a cosine lobe into one around ``middle``, wide as the three parameters say."""
    along, across, leaning = parameters
    x, z = np.array([middle[2], 0, -middle[0]]), middle
    turn = np.stack([x, [0, 1, 0], z], axis=1)
    return turn @ np.array([[along, 0, leaning], [0, across, 0], [0, 0, 1]])


def fit(model, alpha, cosine, start):
    """Return the six entries of the table, and the parameters that were found."""
    wo = np.array([np.sqrt(1 - cosine**2), 0, cosine])
    wi, worth = directions(model, alpha, wo)
    lobe, facing = microfacets(model, alpha, wo, wi)
    sent = np.sum(lobe * worth)
    grazing = np.sum(lobe * worth * (1 - facing) ** 5)
    middle = np.sum(wi * (lobe * worth)[:, None], axis=0) * (1, 0, 1)
    middle /= np.linalg.norm(middle)
    upright = cosine > 1 - 1e-6

    def inverse_of(parameters):
        along, across, leaning = np.maximum(np.abs(parameters), (1e-4, 1e-4, 0)) * np.where(parameters < 0, -1, 1)
        if upright:
            across, leaning = along, 0.0
        return np.linalg.inv(matrix(middle, (abs(along), abs(across), leaning)))

    def off(parameters):
        return np.sum(np.abs(transformed_cosine(inverse_of(parameters), wi) - lobe / sent) ** 2 * worth)

    tries = [start, (alpha, alpha, 0.0), (alpha * cosine, alpha, 0.0)]
    found = min(
        (
            minimize(off, each, method="Nelder-Mead", options={"maxiter": 400, "xatol": 1e-6, "fatol": 1e-9})
            for each in tries
        ),
        key=lambda each: each.fun,
    )
    inverse = inverse_of(found.x)
    inverse /= inverse[1, 1]
    return (inverse[0, 0], inverse[0, 2], inverse[2, 0], inverse[2, 2], sent, grazing), found.x


def fit_model(model):
    """Return the table of a model, ``[SIZE, SIZE, 6]``: α, then direction."""
    size = reflection_table.SIZE
    table = np.zeros((size, size, 6))
    row = [(1.0, 1.0, 0.0)] * size
    for i in reversed(range(size)):
        alpha = max((i / (size - 1)) ** 2, LEAST_ALPHA)
        start = row[0]
        for j in range(size):
            cosine = max(1 - (j / (size - 1)) ** 2, 2e-3)
            table[i, j], start = fit(model, alpha, cosine, start)
    return table


def main():
    """Write the table of all models."""
    found = {model: fit_model(model).astype(np.float32) for model in reflection_table.MODELS}
    np.savez_compressed(Path(reflection_table.__file__).with_name("reflections.npz"), **found)


if __name__ == "__main__":
    main()
