"""A finished run of detectors in the explorer: its pictures, detectors and criterion."""

from __future__ import annotations

from pathlib import Path

from blurnoise_eval.answers.criterion import CONFIDENCE, KEPT, Criterion
from blurnoise_eval.detectors.contract_files import parse_contract
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.model import TIMEOUT_S, model_sha256
from blurnoise_eval.plan.axes import NAMES
from blurnoise_eval.plan.question import Question
from blurnoise_eval.run import run as opened
from blurnoise_eval.run.pictures import RunPictures
from blurnoise_eval.run.score_tables import criterion_of

USUAL = Criterion(KEPT, kept=True)
"""The criterion without a run, and of a run that is not judged by confidences."""


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
            # without clusters, as the pattern of a foreign run is not tried
            criterion = criterion_of(run, Question(cluster=""))
        self.criterion = criterion if criterion.score == CONFIDENCE else USUAL
        self.models: tuple[str, ...] = tuple(model["name"] for model in self.manifest["models"])

    @property
    def tested(self) -> dict[str, list[float]]:
        """The values that the run tested, by axis; none where it left the axis to the camera."""
        conditions = self.plan.conditions()
        values = {name: {at[name] for at in conditions} for name in NAMES}
        return {name: sorted(value for value in of if value is not None) for name, of in values.items()}

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
