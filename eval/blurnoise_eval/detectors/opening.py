"""Opens model files; the graph decides whether a model is a detector or a text recogniser."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count

from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.model import TIMEOUT_S, OnnxModel
from blurnoise_eval.detectors.ocr import Recogniser, is_recogniser
from blurnoise_eval.system.urls import Location

Opened = Detector | Recogniser


def open_models(
    paths: Sequence[str | Location],
    contracts: Sequence[str | None] = (None,),
    *,
    dictionary: Location | None = None,
    timeout_s: float = TIMEOUT_S,
) -> list[Opened]:
    """The models of the files, in their order. Equal names get a number.

    contracts: one for all, or one for each; files or presets. dictionary: a recogniser's characters. timeout_s: how
    long loading a model, and its first answer, may take. Raises ``ValueError`` where detectors and recognisers are
    named together: their targets differ; :class:`~blurnoise_eval.detectors.contract.ModelError`, ``TimeoutError``.
    """
    if len(contracts) not in (1, len(paths)):
        must = f"must be one, or one for each of the {len(paths)} models"
        raise ValueError(f"contract: got {len(contracts)}; {must}")
    # The graph alone may not show that it reads text.
    for_text = dictionary is not None or any(str(preset).split(",")[0] == "ppocr" for preset in contracts)
    models = [OnnxModel(path, timeout_s=timeout_s) for path in paths]
    reads = [for_text or is_recogniser(model) for model in models]
    if len(set(reads)) > 1:
        must = "use a run for each kind"
        raise ValueError(f"model: must be all detectors or all text recognisers; {must}")
    opened: list[Opened] = []
    for index, model in enumerate(models):
        contract = contracts[index % len(contracts)]
        if reads[index]:
            opened.append(Recogniser(model, contract=contract, dictionary=dictionary))
        else:
            opened.append(Detector(model, contract=contract))
    names = {model.name for model in opened}
    for index, model in enumerate(opened):
        if model.name in [before.name for before in opened[:index]]:
            numbered = (f"{model.name}-{number}" for number in count(2))
            model.name = next(name for name in numbered if name not in names)
            names.add(model.name)
    return opened
