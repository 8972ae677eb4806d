"""Launches of kernels whose arguments are given by name, so that their order matters nowhere."""

from typing import Any

import warp as wp


def record(kernel: Any, dim: int, device: Any, **arguments: Any) -> Any:
    """Return a launch that can be repeated; ``set_param_by_name`` changes an argument.

    Raises:
        KeyError: an argument is missing.
        TypeError: the kernel has no argument of a name.
    """
    names = [argument.label for argument in kernel.adj.args]
    if unknown := arguments.keys() - set(names):
        raise TypeError(f"the kernel takes {', '.join(names)}, got {', '.join(sorted(unknown))}")
    return wp.launch(kernel, dim=dim, inputs=[arguments[name] for name in names], device=device, record_cmd=True)
