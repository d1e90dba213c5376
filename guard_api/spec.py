"""An environment is data: a frozen, JSON-serialisable specification with a fingerprint."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, Literal, TypeAlias, get_args

from guard_api import plugins
from guard_api.constraints import CONSTRAINTS, Constraint
from guard_api.errors import PluginError, SpecError, unknown_name
from guard_api.scene.checks import check_extents, check_groups
from guard_api.scene.limits import check_limits
from guard_api.scene.spec import BodyGroup, ContactPreset, Placement
from guard_api.tasks import TASKS, Task
from guard_api.typed import Reader, plain

Kind: TypeAlias = Literal["task", "constraint"]

_TERMS: Final[dict[Kind, tuple[dict[str, type], plugins.Group]]] = {
    "task": (TASKS, "guard.tasks"),
    "constraint": (CONSTRAINTS, "guard.constraints"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class EnvSpec:
    """Everything that defines an environment but the simulator.

    name: its id, such as Goal_Point_8Hazards. version: raised when the same id begins to mean something else.
    robot: its name, or the path of its URDF or MJCF file, see `guard_api.model.library`.
    extents: (xmin, ymin, xmax, ymax) [m] of the placement area. robot_placement: where the robot may start.
    episode_length: steps until truncation. preset: contact settings, see `guard_api.scene.spec`.
    scenery: what is placed, moves and is observed like constraints, but costs nothing.
    graded: whether costs say how bad a violation is, as in GUARD, or 1 for any, as in Safety Gym.
    """

    name: str
    robot: str
    task: Task
    constraints: tuple[Constraint, ...]
    version: int = 0
    extents: tuple[float, float, float, float] = (-2.0, -2.0, 2.0, 2.0)
    robot_placement: Placement = dataclasses.field(default_factory=Placement)
    episode_length: int = 1000
    preset: ContactPreset = "rigid"
    scenery: tuple[Constraint, ...] = ()
    graded: bool = True

    def __post_init__(self) -> None:
        """Refuse what means nothing: one SpecError that names the field."""
        try:
            for term in self.terms:
                check_limits(term, type(term).__name__)
            check_groups(self.groups, self.robot_placement)
            check_extents(self.extents)
        except SpecError as error:
            raise SpecError(f"environment {self.name!r}: {error}") from None
        if type(self.episode_length) is not int or self.episode_length < 1:
            raise SpecError(f"environment {self.name!r}: episode_length is {self.episode_length!r}: at least 1")
        if self.preset not in get_args(ContactPreset):
            raise unknown_name("contact preset", self.preset, get_args(ContactPreset))

    @property
    def terms(self) -> tuple[Task | Constraint, ...]:
        """Everything that places, moves and observes objects, in this order."""
        return (self.task, *self.constraints, *self.scenery)

    @property
    def groups(self) -> tuple[BodyGroup, ...]:
        """The body groups of all terms, in the order in which they are placed."""
        return tuple(group for term in self.terms for group in term.objects())

    def to_json(self) -> dict[str, Any]:
        """Return the specification as JSON data; `EnvSpec.from_json` reads it back."""
        data: dict[str, Any] = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        data["task"] = _term_to_json(self.task)
        for part in ("constraints", "scenery"):
            data[part] = [_term_to_json(constraint) for constraint in getattr(self, part)]
        data["robot_placement"] = dataclasses.asdict(self.robot_placement)
        return plain(data)

    @classmethod
    def from_json(cls, data: Mapping[str, Any], source: str | None = None) -> EnvSpec:
        """Read a specification written by `to_json`, in which everything that has a default may be missing.

        source: the file it comes from, for errors. Raises SpecError with every fault, one per line, by key.
        """
        reader = Reader({Task: partial(term_type, "task"), Constraint: partial(term_type, "constraint")})
        try:
            spec = reader.read(cls, data)
        except SpecError as error:  # Everything can be read, but not all of it means something.
            raise SpecError(f"{source}: {error}" if source else str(error)) from error
        if spec is None:
            place = source or f"environment spec {data.get('name', '?')!r}"
            raise SpecError("\n".join(f"{place}: {fault}" for fault in reader.faults))
        return spec

    @property
    def fingerprint(self) -> str:
        """A 16-digit hash of the specification: with equal robot files, equal fingerprints mean the same task."""
        text = json.dumps(self.to_json(), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def term_names(kind: Kind) -> list[str]:
    """Return the names of GUARD's own tasks or constraints and those of installed packages, importing none of them."""
    own, group = _TERMS[kind]
    return [*own, *(name for name in plugins.names(group) if name not in own)]


def term_type(kind: Kind, name: str) -> Any:
    """Return the task or constraint dataclass called `name`: GUARD's own, or that of an installed package.

    Raises SpecError for an unknown name (nearest names given), PluginError for one that cannot be imported or is no
    dataclass of that name: then a specification could not be written and read again.
    """
    own, group = _TERMS[kind]
    if name in own:
        return own[name]
    if name not in plugins.names(group):
        raise unknown_name(kind, name, term_names(kind))
    term = plugins.load(group, name)
    if not dataclasses.is_dataclass(term) or getattr(term, "__name__", "") != name:
        raise PluginError(f"{kind} {name!r}: its entry point names {term!r}: it must name a dataclass called {name}")
    return term


def _term_to_json(term: Any) -> dict[str, Any]:
    return {"type": type(term).__name__, **dataclasses.asdict(term)}
