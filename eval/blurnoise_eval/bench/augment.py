"""Bench of the augmentation: time per picture beside a training step, and beside the libraries that are installed.

Every contender blurs and adds noise to all pictures of 320x320 in colour: ``RandomExposure``, Kornia's
``RandomMotionBlur`` and ``RandomGaussianNoise``, albumentations' ``MotionBlur`` and ``ISONoise``, and nrtk's
``PybsmPerturber``, which computes the optics and noise of an aerial sensor.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from typing import Any

import kornia.augmentation as kornia
import numpy as np
from blurnoise_models import training
from torch import Tensor, nn

import blurnoise
from blurnoise_eval.bench.contest import Case, Contender, Contest


def augment(*, quick: bool) -> Contest:
    """A batch of the small detector's training, once in tensors and once in uint8 NumPy pictures."""
    return Contest(
        "augment", "Augmentations beside a training step, 320x320 in colour",
        [partial(_case, 8 if quick else training.BATCH)], cost_unit="ms per picture", seconds=20.0,
    )  # fmt: skip


def _case(count: int) -> Case:
    pictures, boxes = training.batch(0, count)
    ways = [Contender("training step", partial(training.Training(1, {}, None).learn, pictures, boxes))]
    ours: Any = blurnoise.RandomExposure  # of Kornia's classes, which mypy does not follow
    for p in (0.5, 1.0):
        ways.append(Contender(f"RandomExposure, p = {p:g}", partial(ours(p=p), pictures), True))
        ways.append(Contender(f"Kornia's blur and noise, p = {p:g}", partial(_kornia(p), pictures)))
    arrays = _uint8(pictures)
    if find_spec("albumentations"):
        ways += _albumentations(arrays)
    if find_spec("nrtk") and find_spec("pybsm"):
        ways.append(Contender("nrtk's PybsmPerturber", partial(_each, _nrtk(), arrays)))
    return Case(f"batch of {count}", ways, units=count)


def _uint8(pictures: Tensor) -> list[np.ndarray[Any, Any]]:
    return list((255 * pictures).round().byte().permute(0, 2, 3, 1).contiguous().numpy())


def _each(change: Callable[..., Any], arrays: list[np.ndarray[Any, Any]]) -> list[Any]:
    return [change(image=each) for each in arrays]


def _kornia(p: float) -> nn.Module:
    blur = kornia.RandomMotionBlur((3, 61), (-180.0, 180.0), 0.0, border_type="reflect", p=p)
    return nn.Sequential(blur, kornia.RandomGaussianNoise(std=0.05, p=p), nn.Hardtanh(0.0, 1.0))


def _albumentations(arrays: list[np.ndarray[Any, Any]]) -> list[Contender]:
    import albumentations

    from blurnoise.albumentations import RandomExposure

    theirs = albumentations.Compose(
        [albumentations.MotionBlur((3, 61), p=1.0), albumentations.ISONoise(p=1.0)]
    )
    taken: dict[str, Any] = {"exposure_s": (0.001, 0.06), "illuminance_lux": (5.0, 500.0), "gain_db": 0.0}
    ours = albumentations.Compose([RandomExposure("imx250", **taken, p=1.0)])
    return [
        Contender("RandomExposure in albumentations", partial(_each, ours, arrays), True),
        Contender("albumentations' blur and noise", partial(_each, theirs, arrays)),
    ]


def _nrtk() -> Callable[..., Any]:
    from nrtk.impls.perturb_image.optical import PybsmPerturber

    return partial(PybsmPerturber(int_time=0.03, seed=1), img_gsd=0.02)
