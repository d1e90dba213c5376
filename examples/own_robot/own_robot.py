"""A robot of your own as a package: its files, this function, and one entry point make Goal_Tug_8Hazards a name.

In the package's pyproject.toml:

    [project.entry-points."guard.robots"]
    own = "own_robot:robots"

`guard robot check robots/urdf/tug/tug.urdf` compares it between the engines before that.
"""

from __future__ import annotations

from pathlib import Path


def robots() -> Path:
    """Return the folder of `urdf/<robot>/<robot>.urdf` or `mjcf/<robot>/<robot>.xml`, each beside its `robot.toml`."""
    return Path(__file__).parent / "robots"
