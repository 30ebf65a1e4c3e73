"""A finished run in the explorer: its heat map and detectors, beside its pictures."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import NamedTuple

from blurnoise_eval.answers.criterion import CONFIDENCE, KEPT, Criterion
from blurnoise_eval.detectors.contract_files import parse_contract
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.model import TIMEOUT_S, model_sha256
from blurnoise_eval.grid.axes import AXES, EXPOSURE, Axis
from blurnoise_eval.run import run as opened
from blurnoise_eval.run.pictures import RunPictures
from blurnoise_eval.run.score_tables import criterion_of
from blurnoise_eval.store import queries
from blurnoise_eval.store.store import Store

USUAL = Criterion(KEPT, kept=True)
"""The criterion where no run has one in confidences."""


class HeatMap(NamedTuple):
    """A detector's mean confidence by ``across`` and ``down``. cells: by the values on these two, those on all axes,
    and the mean there."""

    across: Axis
    down: Axis
    columns: list[float]
    rows: list[float]
    cells: dict[tuple[float, float], tuple[dict[str, float], float]]


class Run(RunPictures):
    """A run's folder, read, of detectors. Raises ``ValueError`` for one of readers, else as :class:`RunPictures`."""

    def __init__(
        self, folder: str | Path, images: str | Path | None = None, *, trusted: bool = False
    ) -> None:
        with opened.Run.open(folder, trust=trusted) as run:
            super().__init__(run, images)
            if any(model["kind"] != "detector" for model in self.manifest["models"]):
                raise ValueError(
                    f"run = {str(folder)!r}: must be a run of detectors, not of text recognisers"
                )
            asked = criterion_of(run)
        self.criterion = asked if asked.score == CONFIDENCE else USUAL
        self.means = cache(self._read_means)
        self.models: tuple[str, ...] = tuple(model["name"] for model in self.manifest["models"])

    def _read_means(self, model: str) -> list[tuple[dict[str, float], float]]:
        """A detector's mean confidence under each condition."""
        with Store(self.folder) as store:
            means = queries.mean_confidences(store, model)
        return [(dict(at), mean) for at, mean in means if not at.original]

    def heat_map(self, model: str, near: Mapping[str, float]) -> HeatMap:
        """By exposure, or what varies most, and what else varies; the other axes at the tested value nearest to
        ``near``. Of a detector that is not the run's, the first one's."""
        means = self.means(model if model in self.models else self.models[0])
        tested = {each: sorted({at[each.name] for at, _ in means}) for each in AXES}
        varied = sorted(
            AXES, key=lambda each: (len(tested[each]) < 2, each is not EXPOSURE, -len(tested[each]))
        )
        across, down = varied[:2]
        for each in varied[2:]:
            wanted = near[each.name]
            away = {value: (value != wanted, abs(value - wanted)) for value in tested[each]}
            nearest = min(away, key=away.__getitem__, default=None)
            means = [(at, mean) for at, mean in means if at[each.name] == nearest]
        cells = {(at[across.name], at[down.name]): (at, mean) for at, mean in means}
        return HeatMap(across, down, tested[across], tested[down], cells)

    def model(self, name: str, timeout_s: float = TIMEOUT_S) -> Detector:
        """A detector of the run, opened again; the built-in one wherever it lay then. Raises ``ValueError`` where it
        is gone or another, and for files outside of a run that is not trusted."""
        from blurnoise_models.detector import STOP_SIGN

        note = next(model for model in self.manifest["models"] if model["name"] == name)
        built_in = note["sha256"] == model_sha256(STOP_SIGN)
        path = STOP_SIGN if built_in else self._trusted("model", note["file"])
        if not path.is_file() or model_sha256(path) != note["sha256"]:
            raise ValueError(f"model = {note['file']!r}: is missing, or has changed since the run")
        contract = parse_contract(note["contract"], "the run's contract")
        return Detector(path, contract=contract, timeout_s=timeout_s)
