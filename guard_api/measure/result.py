"""Reading a `transfer.json`, for everything that shows it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from guard_api.errors import RunError
from guard_api.runs.atomic import read_json

TRANSFER_FORMAT: Final = "guard-transfer-1"


class TransferResult:
    """The content of a transfer.json. The rows of `cells`, `transfers` and `training` are plain JSON data."""

    def __init__(self, data: Mapping[str, Any]) -> None:
        self.manifest: dict[str, Any] = data["manifest"]
        self.backends: list[str] = data["backends"]
        self.sources: list[str] = data["sources"]
        self.seeds: list[int] = data["seeds"]
        self.cost_names: list[str] = data["cost_names"]
        self.cost_limit: float | None = data["cost_limit"]
        self.cells: list[dict[str, Any]] = data["cells"]
        self.transfers: list[dict[str, Any]] = data["transfers"]
        self.training: list[dict[str, Any]] = data["training"]

    @property
    def episodes(self) -> int:
        """Episodes per policy and backend."""
        return int(self.manifest["episodes"])

    def cell(self, source: str, target: str) -> dict[str, Any]:
        """Return the cell of policies trained in `source` and run in `target`. Raises KeyError when there is none."""
        for cell in self.cells:
            if cell["source"] == source and cell["target"] == target:
                return cell
        raise KeyError((source, target))

    def estimate(self, source: str, target: str, quantity: str) -> dict[str, Any]:
        """Return one estimate of that cell, as JSON data: value, low, high, per_seed, reason."""
        return self.cell(source, target)["estimates"][quantity]


def read_result(out: Path | str) -> TransferResult:
    """Read the transfer.json in the folder `out`. Raises RunError when it is missing, foreign or corrupt."""
    path = Path(out) / "transfer.json"
    data = read_json(path, "run `guard transfer` to its end first")
    if data.get("format") != TRANSFER_FORMAT:
        raise RunError(f"{path}: format {data.get('format')!r} is not {TRANSFER_FORMAT!r}: not a result of this GUARD")
    try:
        return TransferResult(data)
    except KeyError as error:
        raise RunError(f"{path}: has no field {error}: run `guard transfer` again to write it anew") from error
