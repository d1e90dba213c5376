"""Pictures without a display, a GPU or an engine, from robots, scenes and states alone."""

from guard_api.viewer.camera import Camera
from guard_api.viewer.picture import SIZE, environment_picture, picture, png, robot_picture, write_png
from guard_api.viewer.sheet import CELL, Cell, captioned_sheet, contact_sheet

__all__ = [
    "CELL", "SIZE", "Camera", "Cell", "captioned_sheet", "contact_sheet", "environment_picture", "picture", "png",
    "robot_picture", "write_png",
]  # fmt: skip
