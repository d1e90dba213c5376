"""GUARD: one robot, one task, three simulators.

The neutral core: robots, scenes, tasks, constraints, sensors, the environment and the transfer measurement.
It imports no simulator and no learning library; backends and algorithms are plugins (see `guard_api.plugins`).
"""

__version__ = "0.1.0"
