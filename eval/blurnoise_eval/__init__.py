"""Runs detectors over simulated exposures: the ``blurnoise`` command, and :func:`evaluate` for Python.

Names are imported when they are first used, so that the command's ``--help`` is immediate.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path

    from blurnoise_eval import datasets
    from blurnoise_eval.detectors.detector import Detector
    from blurnoise_eval.detectors.python_models import PythonDetector, TorchvisionDetector
    from blurnoise_eval.plan.axes import AXES
    from blurnoise_eval.plan.plan import SweepPlan
    from blurnoise_eval.plan.question import Question
    from blurnoise_eval.run.evaluation import evaluate
    from blurnoise_eval.run.run import Run
    from blurnoise_eval.single_picture import expose
    from blurnoise_eval.testing import assert_works

    STOP_SIGN: Path

__all__ = [
    "AXES", "STOP_SIGN", "Detector", "PythonDetector", "Question", "Run", "SweepPlan", "TorchvisionDetector",
    "assert_works", "datasets", "evaluate", "expose",
]  # fmt: skip
_FROM = {
    "AXES": "plan.axes",
    "Detector": "detectors.detector",
    "PythonDetector": "detectors.python_models",
    "Question": "plan.question",
    "Run": "run.run",
    "SweepPlan": "plan.plan",
    "TorchvisionDetector": "detectors.python_models",
    "assert_works": "testing",
    "evaluate": "run.evaluation",
    "expose": "single_picture",
}


def __getattr__(name: str) -> Any:
    if name == "datasets":
        return import_module(f"{__name__}.datasets")
    if name == "STOP_SIGN":  # the built-in detector's file
        return import_module("blurnoise_models.detector").STOP_SIGN
    if name not in _FROM:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_FROM[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
