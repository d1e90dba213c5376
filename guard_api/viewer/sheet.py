"""One sheet of captioned pictures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from PIL import Image as Pillow
from PIL import ImageDraw, ImageFont

from guard_api.errors import SpecError
from guard_api.model.robot import RobotModel
from guard_api.viewer.picture import Image, robot_picture

CELL: Final = (480, 380)
"""Width and height of one robot's picture on the sheet [pixel]."""

GAP: Final = 8
CAPTION: Final = 52
"""Space between pictures, and below each for its caption [pixel]."""

INK, MUTED, PAPER = (31, 41, 51), (103, 114, 126), (255, 255, 255)


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """One picture of the sheet: `image` (CELL[1], CELL[0], 3) uint8 over its `title` and `caption`."""

    title: str
    caption: str
    image: Image


def contact_sheet(robots: Sequence[RobotModel], columns: int = 4) -> Image:
    """Return one picture (height, width, 3) of all `robots` at home. SpecError when there are none."""
    cells = [Cell(title=r.name, caption=caption(r), image=robot_picture(r, size=CELL)) for r in robots]
    return captioned_sheet(cells, columns)


def captioned_sheet(cells: Sequence[Cell], columns: int = 4) -> Image:
    """Return one picture (height, width, 3) of all `cells`, row by row. SpecError when there are none."""
    if not cells:
        raise SpecError("there is nothing to show")
    columns = min(columns, len(cells))
    rows = math.ceil(len(cells) / columns)
    width, height = CELL[0] + GAP, CELL[1] + CAPTION + GAP
    page = Pillow.new("RGB", (columns * width + GAP, rows * height + GAP), PAPER)
    draw = ImageDraw.Draw(page)
    for i, cell in enumerate(cells):
        x, y = GAP + i % columns * width, GAP + i // columns * height
        page.paste(Pillow.fromarray(cell.image), (x, y))
        draw.text((x + 4, y + CELL[1] + 4), cell.title, fill=INK, font=ImageFont.load_default(22))
        draw.text((x + 4, y + CELL[1] + 31), cell.caption, fill=MUTED, font=ImageFont.load_default(14))
    return np.asarray(page)


def caption(robot: RobotModel) -> str:
    """Return what a robot is in a few words."""
    mass = sum(link.mass for link in robot.links)
    joints = sum(not joint.name.startswith("base_") for joint in robot.joints)
    weight = f"{mass:.3g} kg" if mass >= 1.0 else f"{1000 * mass:.3g} g"
    return f"{robot.base} base, {joints} joints, {len(robot.actuators)} actuators, {weight}"
