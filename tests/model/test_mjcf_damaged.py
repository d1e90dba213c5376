"""Whatever happens to an MJCF file, it is read as a sound robot or refused with a ModelError: nothing else."""

from __future__ import annotations

import re
from pathlib import Path
from tempfile import TemporaryDirectory

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from lxml import etree

from guard_api.errors import ModelError
from tests.model.mjcf_comparison import read
from tests.model.test_damaged_files import assert_sound
from tests.model.test_mjcf import TEXT

NASTY = [
    "nan",
    "1e999",
    "1e30",
    "-1e30",
    "1e-12",
    "0",
    "-1",
    "1 2",
    "0 0 0",
    "",
    " ",
    "é",
    "hip",
    "leg",
    "world",
    "free",
]
many = settings(suppress_health_check=[HealthCheck.too_slow])


def assert_sound_or_refused(text: bytes) -> None:
    with TemporaryDirectory() as folder:
        place = Path(folder)
        try:
            assert_sound(read(place, text))
        except ModelError as error:
            assert all(re.match(r".*(r\.xml|robot\.toml)(:| )", line) for line in str(error).splitlines()), error


@many
@given(st.data())
def test_replaced_values(data: st.DataObject) -> None:
    text = TEXT
    for _ in range(data.draw(st.integers(1, 3))):
        start, end = data.draw(st.sampled_from([match.span(1) for match in re.finditer(r'="([^"]*)"', text)]))
        text = text[:start] + data.draw(st.sampled_from(NASTY)) + text[end:]
    assert_sound_or_refused(text.encode())


@many
@given(st.data())
def test_removed_doubled_moved_and_renamed_elements(data: st.DataObject) -> None:
    root = etree.fromstring(TEXT.encode())
    for _ in range(data.draw(st.integers(1, 3))):
        elements = list(root.iterdescendants())
        element, other = data.draw(st.sampled_from(elements)), data.draw(st.sampled_from([root, *elements]))
        match data.draw(st.sampled_from(["remove", "double", "move", "rename", "strip"])):
            case "remove" if len(elements) > 1:
                element.getparent().remove(element)
            case "double":
                element.addnext(etree.fromstring(etree.tostring(element, with_tail=False)))
            case "move" if other not in element.iter():
                other.append(element)
            case "rename":
                element.tag = other.tag
            case _:
                element.attrib.clear()
        if not len(root):
            break
    assert_sound_or_refused(etree.tostring(root))
