"""Detectors in Python: a function, or a network of torchvision's detection API.

The protocol: a callable takes an RGB picture (H, W, 3), uint8, and returns boxes (N, 4), (left, top, right, bottom)
px of that picture, scores (N,) in [0, 1], and classes (N,), names or places in ``classes``.
"""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import nn

from blurnoise._core.checks import shown
from blurnoise_eval.detectors.contract import Contract, ModelError
from blurnoise_eval.detectors.detector import MIN_SCORE, MOST_DETECTIONS, Detector, OwnScores
from blurnoise_eval.detectors.records import Detections

Find = Callable[[NDArray[np.uint8]], tuple[ArrayLike, ArrayLike, ArrayLike]]
FAMILY = "python"


class PythonDetector(Detector):
    """A callable as a detector; what :func:`blurnoise_eval.evaluate` makes of one by itself.

    find: as the module says; what it raises is the model's failure on that picture. classes: names by number; what is
    found of other names is dropped. name: in tables, by default the function's. version: tells one state of the
    function from another; a run goes on only with the same. together: whether several threads may call it at once.
    The engine of processes takes functions of modules and of scripts that begin below ``if __name__ == "__main__":``,
    but no lambdas; Ray takes any whose values can be pickled.
    Raises ``TypeError`` or ``ValueError`` naming the argument.

    >>> import numpy as np
    >>> def find(picture):
    ...     return [(0, 0, 10, 10)], [0.9], ["stop sign"]
    >>> detector = PythonDetector(find, ["stop sign"])
    >>> detector.detect(np.zeros((20, 30, 3), np.uint8)).scores
    array([0.9], dtype=float32)
    """

    def __init__(
        self,
        find: Find,
        classes: Sequence[str],
        *,
        name: str | None = None,
        version: str = "",
        together: bool = False,
    ) -> None:
        if not callable(find):
            raise TypeError(f"find = {shown(find)}: must be callable")
        self.name = name or str(getattr(find, "__name__", type(find).__name__))
        self.contract = Contract(FAMILY, tuple(classes), resize="none", nms_iou=None)
        self.path = self.source = Path(self.name)
        qualified_name = (
            f"{getattr(find, '__module__', '')}.{getattr(find, '__qualname__', type(find).__qualname__)}"
        )
        self.sha256 = hashlib.sha256(f"{qualified_name} {version} {classes}".encode()).hexdigest()
        self.input_size_px = (0, 0)  # each picture's own
        self._find, self._version, self._together = find, version, together
        self._numbers = {label: number for number, label in enumerate(self.contract.classes)}
        self._one_at_a_time: AbstractContextManager[Any] = nullcontext() if together else threading.Lock()

    def __reduce__(self) -> tuple[Any, ...]:
        given = self.name, self._version, self._together
        return _again, (type(self), self._find, self.contract.classes, *given)

    @property
    def non_finite_values_here(self) -> int:
        """0: values that are not finite are the model's failure."""
        return 0

    def interrupt(self) -> None:
        """Do nothing; a call of Python ends by itself."""

    def with_contract(self, contract: Contract) -> Detector:
        """The same detector: it prepares its pictures itself."""
        return self

    def detect(
        self, image: NDArray[np.uint8], *, min_score: float = MIN_SCORE, max_detections: int = MOST_DETECTIONS
    ) -> Detections:
        """Return what it finds in an RGB picture (h, w, 3), uint8. Raises :class:`ModelError`."""
        try:
            with self._one_at_a_time:
                boxes, scores, classes = self._find(image)
            ids = self._ids(np.asarray(classes).reshape(-1))
            detections = Detections(np.asarray(boxes), np.asarray(scores), ids)
        except Exception as error:
            raise ModelError(f"{self.name}: failed on a picture ({type(error).__name__}: {error})") from error
        if detections.scores.max(initial=0) > 1 or detections.scores.min(initial=0) < 0:
            raise ModelError(f"{self.name}: score = {detections.scores.max():g}: must be >= 0 and <= 1")
        return detections[(detections.scores >= min_score) & (detections.class_ids >= 0)][:max_detections]

    def detect_all(self, image: NDArray[np.uint8]) -> tuple[Detections, OwnScores | None]:
        """The detections of :meth:`detect`; each box has the classes that the function returned."""
        return self.detect(image), None

    def _ids(self, classes: NDArray[Any]) -> NDArray[np.int64]:
        if classes.dtype.kind in "UO":
            return np.array([self._numbers.get(str(label), -1) for label in classes], np.int64)
        if len(classes) and not 0 <= classes.min() <= classes.max() < len(self._numbers):
            raise ValueError(f"class = {int(classes.max())}: must be >= 0 and <= {len(self._numbers) - 1}")
        return classes.astype(np.int64)


class TorchvisionDetector(PythonDetector):
    """A network of torchvision's detection API, in evaluation mode, on its own device.

    It takes a list of pictures (3, H, W) in [0, 1] and returns for each a mapping of "boxes", "scores" and "labels".
    classes: names by label, as ``weights.meta["categories"]``. Its identity is that of its weights.
    """

    def __init__(self, network: nn.Module, classes: Sequence[str], *, name: str | None = None) -> None:
        self._network = network.eval()
        digest = hashlib.sha256(type(network).__qualname__.encode())
        for key, value in network.state_dict().items():
            digest.update(
                key.encode() + value.detach().cpu().contiguous().view(-1).view(torch.uint8).numpy().tobytes()
            )
        named = name or type(network).__name__
        super().__init__(self._answer, classes, name=named, version=digest.hexdigest(), together=True)

    def __reduce__(self) -> tuple[Any, ...]:
        return _again, (type(self), self._network, self.contract.classes, self.name)

    def _answer(self, image: NDArray[np.uint8]) -> tuple[ArrayLike, ArrayLike, ArrayLike]:
        device = next(self._network.parameters()).device
        with torch.inference_mode():
            picture = torch.from_numpy(np.ascontiguousarray(image)).to(device).permute(2, 0, 1).float() / 255
            answer = self._network([picture])[0]
        return tuple(answer[key].detach().cpu().numpy() for key in ("boxes", "scores", "labels"))


def _again(kind: Any, find: Any, classes: Sequence[str], name: str, *further: Any) -> PythonDetector:
    """The detector in another process."""
    options = dict(zip(("version", "together"), further, strict=False))
    made: PythonDetector = kind(find, classes, name=name, **options)
    return made
