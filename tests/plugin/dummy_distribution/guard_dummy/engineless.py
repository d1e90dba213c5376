"""A backend whose engine is not installed."""

raise ModuleNotFoundError("No module named 'pybullet'", name="pybullet")
