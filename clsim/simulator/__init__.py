"""The synchronous driver: a scene that is driven step by step."""

from clsim.simulator.simulator import RigSimulator, Simulator

__all__ = ["RigSimulator", "Simulator"]
