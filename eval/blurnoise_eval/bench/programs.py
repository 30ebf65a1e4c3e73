"""Benches of whole programs: a sweep and its inference alone; the augmentation, a training step and other libraries.

Every contender of the augmentations blurs and adds noise to all pictures of 320x320 in colour: ``RandomExposure``,
Kornia's ``RandomMotionBlur`` and ``RandomGaussianNoise``, albumentations' ``MotionBlur`` and ``ISONoise``, and nrtk's
``PybsmPerturber``, which computes the optics and noise of an aerial sensor.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib.util import find_spec
from typing import Any

import kornia.augmentation as kornia
import numpy as np
from blurnoise_models import training
from torch import Tensor, nn

import blurnoise
from blurnoise_eval import datasets
from blurnoise_eval.bench.contest import Case, Contender, Contest
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.run.engines import ThreadEngine
from blurnoise_eval.run.evaluation import evaluate
from blurnoise_eval.system.machine import limited_threads

_EXPOSURES_S = (0.001, 0.002, 0.005, 0.01, 0.015, 0.02, 0.03, 0.045, 0.06, 0.09)


def sweep(detector: Detector, pictures: datasets.PictureSet, threads: int, *, quick: bool) -> Contest:
    """Cells of up to twenty pictures by a sweep, and ``session.run`` alone on as many prepared inputs.

    The sweep reads, simulates with the default camera, infers, decodes, scores and stores.
    """
    plan = sweep_plan(quick=quick)
    some = datasets.PictureSet(pictures.kind, pictures.source, pictures.pictures[:20])
    return Contest(
        "sweep", f"A sweep of {detector.name}",
        [partial(_cells, detector, some, plan, threads)],
        unit="ms per cell", seconds=10.0,
    )  # fmt: skip


def sweep_plan(*, quick: bool) -> SweepPlan:
    """The conditions of the benches of a sweep: ten exposures, three lights, four speeds; two exposures of them.

    >>> len(sweep_plan(quick=True).conditions())
    24
    """
    axes = {
        "exposure_s": _EXPOSURES_S[::5] if quick else _EXPOSURES_S,
        "illuminance_lux": (1.0, 10.0, 100.0),
        "velocity_x_px_s": (0.0, 200.0, 500.0, 1000.0),
    }
    return SweepPlan(axes, examples=False)


def _cells(detector: Detector, pictures: datasets.PictureSet, plan: SweepPlan, threads: int) -> Case:
    inputs = [detector.prepare(datasets.eight_bit(picture.load()))[0] for picture in pictures]
    cells = len(pictures) * (1 + len(plan.conditions()))  # each picture is inferred as it is, too

    def bare() -> None:
        with limited_threads(1), ThreadPoolExecutor(threads) as pool:
            list(pool.map(detector.run, [inputs[index % len(inputs)] for index in range(cells)]))

    def swept() -> None:
        with tempfile.TemporaryDirectory() as folder:
            engine = ThreadEngine(threads)
            evaluate(
                detector,
                pictures,
                plan=plan,
                output=folder,
                engine=engine,
                strategy="grid",
                progress=False,
            )

    ways = [Contender("bare onnxruntime", bare), Contender("sweep", swept, True)]
    return Case(f"{cells} cells, {threads} threads", ways, units=cells)


def augment(*, quick: bool) -> Contest:
    """A batch of the small detector's training, once in tensors and once in uint8 NumPy pictures."""
    return Contest(
        "augment", "Augmentations and a training step, 320x320 in colour",
        [partial(_batch, 8 if quick else training.BATCH)], unit="ms per picture", seconds=20.0,
    )  # fmt: skip


def _batch(count: int) -> Case:
    pictures, _, boxes = training.batch(0, count)
    ways = [Contender("training step", partial(training.Training(1, {}, None).learn, pictures, boxes))]
    ours: Any = blurnoise.RandomExposure  # of Kornia's classes, which mypy does not follow
    for p in (0.5, 1.0):
        ways.append(Contender(f"RandomExposure, p = {p:g}", partial(ours(p=p), pictures), True))
        ways.append(Contender(f"Kornia's blur and noise, p = {p:g}", partial(_kornia(p), pictures)))
    arrays = _uint8(pictures)
    if find_spec("albumentations"):
        ways += _albumentations(arrays)
    if find_spec("nrtk") and find_spec("pybsm"):
        ways.append(Contender("nrtk's PybsmPerturber", partial(_all, _nrtk(), arrays)))
    return Case(f"batch of {count}", ways, units=count)


def _uint8(pictures: Tensor) -> list[np.ndarray[Any, Any]]:
    return list((255 * pictures).round().byte().permute(0, 2, 3, 1).contiguous().numpy())


def _all(change: Callable[..., Any], arrays: list[np.ndarray[Any, Any]]) -> list[Any]:
    return [change(image=array) for array in arrays]


def _kornia(p: float) -> nn.Module:
    blur = kornia.RandomMotionBlur((3, 61), (-180.0, 180.0), 0.0, border_type="reflect", p=p)
    return nn.Sequential(blur, kornia.RandomGaussianNoise(std=0.05, p=p), nn.Hardtanh(0.0, 1.0))


def _albumentations(arrays: list[np.ndarray[Any, Any]]) -> list[Contender]:
    import albumentations

    from blurnoise.albumentations import RandomExposure

    theirs = albumentations.Compose(
        [albumentations.MotionBlur((3, 61), p=1.0), albumentations.ISONoise(p=1.0)]
    )
    ranges: dict[str, Any] = {"exposure_s": (0.001, 0.06), "illuminance_lux": (5.0, 500.0), "gain_db": 0.0}
    ours = albumentations.Compose([RandomExposure("imx250", **ranges, p=1.0)])
    return [
        Contender("RandomExposure in albumentations", partial(_all, ours, arrays), True),
        Contender("albumentations' blur and noise", partial(_all, theirs, arrays)),
    ]


def _nrtk() -> Callable[..., Any]:
    from nrtk.impls.perturb_image.optical import PybsmPerturber

    return partial(PybsmPerturber(int_time=0.03, seed=1), img_gsd=0.02)
