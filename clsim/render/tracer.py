"""A world seen by its own camera."""

from __future__ import annotations

from typing import Any

from clsim.frames import InterestBoard
from clsim.render.device.devices import fastest_tree
from clsim.render.options import RenderOptions
from clsim.render.scene_data import SceneData
from clsim.render.view import View
from clsim.scene import World


class PathTracer(View):
    """Renders a world as its own camera sees it: a ``SceneData`` and the one ``View`` of it."""

    def __init__(self, world: World, options: RenderOptions, board: InterestBoard | None = None) -> None:
        """Copy the world to the device and build its kernel.

        Args:
            world: what is rendered.
            options: how it is rendered.
            board: where interest maps are found, one frame's for each that is filled; without, no event is ever near.

        Raises:
            InputError: the world or an option cannot be used.
        """
        super().__init__(SceneData(world, options.device, options.tree, ahead=options), options, board)


def describe_build(world: World, options: RenderOptions) -> dict[str, Any]:
    """Return what is "built in" to this world's kernel and what is "left out".

    With it the "device" and the "tree" that rays search there.
    """
    facts = options.features_of(world).describe()
    place = {"device": options.device, "tree": options.tree or fastest_tree(options.device)}
    return place | facts
