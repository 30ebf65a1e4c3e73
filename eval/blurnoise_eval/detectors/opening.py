"""Models opened from their files: detectors and text recognisers, told apart by their graphs."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count

from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.model import TIMEOUT_S, OnnxModel
from blurnoise_eval.detectors.ocr import Recogniser, TextSpotter, is_recogniser
from blurnoise_eval.system.urls import Location

Opened = Detector | Recogniser | TextSpotter


def open_models(
    paths: Sequence[str | Location],
    contracts: Sequence[str | None] = (None,),
    *,
    dictionary: Location | None = None,
    text_detector: Location | None = None,
    timeout_s: float = TIMEOUT_S,
) -> list[Opened]:
    """The models of the files, in their order. Equal names get a number.

    contracts: one for all, or one for each; files or presets. dictionary: a recogniser's characters.
    text_detector: finds the text that is read; without it known boxes are read. timeout_s: how long loading a model,
    and its first answer, may take. Raises ``ValueError`` where detectors and recognisers are named together: their
    targets differ; :class:`~blurnoise_eval.detectors.contract.ModelError`, ``TimeoutError``.
    """
    if len(contracts) not in (1, len(paths)):
        must = f"must be one, or one for each of {len(paths)} models"
        raise ValueError(f"contract: {len(contracts)} are given; {must}")
    contracts = [*contracts] * (len(paths) if len(contracts) == 1 else 1)
    # The graph alone may not show that it reads text.
    stated = dictionary is not None or any(str(each).split(",")[0] == "ppocr" for each in contracts)
    models = [OnnxModel(path, timeout_s=timeout_s) for path in paths]
    kinds = {stated or is_recogniser(model) for model in models}
    reads = True in kinds
    if len(kinds) > 1:
        must = "give each a run of its own"
        raise ValueError(f"model: a sweep runs detectors or text recognisers, not both; {must}")
    if (dictionary or text_detector) and not reads:
        raise ValueError("dictionary, text-detector: go with text recognisers, as --model")
    found: list[Opened] = []
    for model, contract in zip(models, contracts, strict=True):
        if reads:
            reader = Recogniser(model, contract=contract, dictionary=dictionary)
            found.append(TextSpotter(text_detector, reader, timeout_s=timeout_s) if text_detector else reader)
        else:
            found.append(Detector(model, contract=contract))
    _tell_apart(found)
    return found


def _tell_apart(models: Sequence[Opened]) -> None:
    taken = {model.name for model in models}
    named: set[str] = set()
    for model in models:
        numbered = (f"{model.name}-{number}" for number in count(2))
        if model.name in named:
            model.name = next(name for name in numbered if name not in taken)
        taken.add(model.name)
        named.add(model.name)
