"""Default classes: what an element's attributes are where it does not say."""

from __future__ import annotations

from guard_api.model.element import Element
from guard_api.model.mjcf.attributes import extended
from guard_api.model.problems import did_you_mean

MAIN = "main"
"""Name of the outermost class."""

ACTUATORS = ("general", "motor", "position", "velocity")
"""Kinds of actuators that share their transmission and limits: a default of one holds for all."""

_OWN = {"kp", "kv", "dampratio", "timeconst", "inheritrange", "gainprm", "biasprm", "gaintype", "biastype", "dyntype"}
"""Attributes of an actuator that mean something for its own kind only."""


class Defaults:
    """The default classes of a file. Reports a class that two elements define, and one that nothing defines."""

    def __init__(self, root: Element) -> None:
        self._classes: dict[str, dict[str, dict[str, str]]] = {MAIN: {}}
        for node in root.children("default"):
            if node.attributes.get("class", MAIN) != MAIN:
                node.error(f"the outermost default class is called {MAIN!r}: nest others in it")
            self._read(node, MAIN)

    def applied(self, node: Element, childclass: str | None) -> Element:
        """Return `node` with the attributes of its class; `childclass` is the one around it, checked before."""
        own = node.attributes.get("class")
        self.check_class(node, own)
        return extended(node, self._classes.get(own or childclass or MAIN, {}).get(node.tag, {}))

    def check_class(self, node: Element, name: str | None) -> None:
        """Report a class that nothing defines."""
        if name is not None and name not in self._classes:
            node.error(f"default class {name!r} does not exist: {did_you_mean(name, list(self._classes))}")

    def _read(self, node: Element, name: str) -> None:
        own = self._classes[name]
        written = [child for child in node.children() if child.tag != "default"]
        for number, child in enumerate(written):
            if child.tag in [other.tag for other in written[:number]]:
                child.error(f"class {name!r} has more than one <{child.tag}>: keep one")
            for tag in ACTUATORS if child.tag in ACTUATORS else (child.tag,):
                shared = {k: v for k, v in child.attributes.items() if tag == child.tag or k not in _OWN}
                own[tag] = own.get(tag, {}) | shared
        for child in node.children("default"):
            inner = child.text("class")
            if inner in self._classes:
                child.error(f"default class {inner!r} is defined already: rename one")
            self._classes[inner] = {tag: dict(attributes) for tag, attributes in own.items()}
            self._read(child, inner)
