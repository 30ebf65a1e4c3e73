"""Benches of augmentations: ours beside a training step, over the length of the blur, and in data loaders.

Every contender blurs and adds noise to all pictures of 320x320 in colour: ``RandomExposure``, Kornia's
``RandomMotionBlur`` and ``RandomGaussianNoise``, albumentations' ``MotionBlur`` and ``ISONoise``, and nrtk's
``PybsmPerturber``, which computes the optics and noise of an aerial sensor and is given no length. torchvision has no
motion blur: its ``GaussianBlur`` with a kernel of that side, and ``GaussianNoise``.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import kornia.augmentation as kornia
import numpy as np
import torch
from blurnoise_models import training
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.utils.data import DataLoader, Dataset

import blurnoise
from blurnoise_eval.bench.contest import Case, Contender, Contest

Arrays = list[NDArray[np.uint8]]
LENGTHS_PX = (3, 5, 9, 15, 25, 35, 51)
_EXPOSURE_S = 0.01
_ANY_LENGTH_PX = (3, 61)
_DIM: dict[str, Any] = {
    "camera": "imx250",
    "exposure_s": (0.001, 0.06),
    "illuminance_lux": (5.0, 500.0),
    "gain_db": 0.0,
}
_WORKERS = 2
_LOADED = 128  # pictures of an epoch: workers begin once in it
_TWICE = ("albumentations", "albucore")  # modules of albumentations and of AlbumentationsX
_NOISE = 0.05  # standard deviation of Kornia's and torchvision's noise, of white
_OURS: Any = blurnoise.RandomExposure  # of Kornia's classes, which mypy does not follow


def augment(*, quick: bool) -> Contest:
    """A batch of the small detector's training, once in tensors and once in uint8 NumPy pictures."""
    return Contest(
        "augment", "Augmentations and a training step, 320x320 in colour",
        [partial(_beside_training, 8 if quick else training.BATCH)], unit="ms per picture", seconds=20.0,
    )  # fmt: skip


def lengths(peers: Path | None = None, *, quick: bool) -> Contest:
    """All pictures blurred over the same length, in tensors and in uint8 NumPy pictures.

    peers: a folder of other packages (``pip install --target``), such as AlbumentationsX, whose module has the same
    name as that of albumentations.
    """
    some = LENGTHS_PX[::3] if quick else LENGTHS_PX
    pictures, _, _ = training.batch(0, 4 if quick else training.BATCH)
    cases = [
        partial(each, pictures, length)
        for each in (_tensors, partial(_arrays, peers=peers))
        for length in some
    ]
    title = "Motion blur and noise of all pictures, 320x320 in colour"
    return Contest("lengths", title, cases, unit="ms per picture", seconds=2.0, along="blur length, px")


def loaders(*, quick: bool) -> Contest:
    """Data loaders with workers, whose pictures go through an augmentation one by one."""
    return Contest(
        "loaders", f"{_WORKERS} workers of a DataLoader, 320x320 in colour, half of the pictures changed",
        [partial(_loaded, 32 if quick else _LOADED)], unit="ms per picture", seconds=4.0,
    )  # fmt: skip


def _beside_training(count: int) -> Case:
    pictures, _, boxes = training.batch(0, count)
    ways = [Contender("training step", partial(training.Training(1, {}, None).learn, pictures, boxes))]
    for p in (0.5, 1.0):
        ways.append(Contender(f"RandomExposure, p = {p:g}", partial(_OURS(p=p), pictures), True))
        theirs = _kornia(_ANY_LENGTH_PX, p)
        ways.append(Contender(f"Kornia's blur and noise, p = {p:g}", partial(theirs, pictures)))
    return Case(f"batch of {count}", ways + _of_arrays(_uint8(pictures), _ANY_LENGTH_PX, _DIM), units=count)


def _tensors(pictures: Tensor, length_px: int) -> Case:
    ours = _OURS(**_moved(length_px), p=1.0)
    ways = [
        Contender("RandomExposure", partial(ours, pictures), True),
        Contender("Kornia", partial(_kornia((length_px, length_px), 1.0), pictures)),
    ]
    if theirs := _torchvision(length_px):
        ways.append(Contender("torchvision, Gaussian blur", partial(theirs, pictures)))
    return Case("tensors", ways, units=len(pictures), at=length_px)


def _arrays(pictures: Tensor, length_px: int, peers: Path | None) -> Case:
    arrays, of_length = _uint8(pictures), (length_px, length_px)
    ways = [Contender("expose_numpy", partial(_exposed, arrays, length_px), True)]
    ways += _of_arrays(arrays, of_length, _moved(length_px))
    if peers is not None:
        with _first_from(peers):
            ways += [
                each
                for each in _of_arrays(arrays, of_length, None)
                if each.name not in {w.name for w in ways}
            ]
    return Case("8-bit NumPy pictures", ways, units=len(arrays), at=length_px)


def _loaded(count: int) -> Case:
    pictures, _, _ = training.batch(0, count)
    arrays = _uint8(pictures)
    doors: list[tuple[str, Callable[[Any], Any], Any, bool]] = [
        ("RandomExposure of tensors", _OURS(p=0.5, keepdim=True), pictures, True),
        ("Kornia's blur and noise", partial(_of_one, _kornia(_ANY_LENGTH_PX, 0.5)), pictures, False),
        ("nothing", nn.Identity(), pictures, False),
    ]
    with suppress(ImportError):  # also where it is of another build than torch
        from blurnoise.training.torchvision import RandomExposureV2

        doors.append(("RandomExposureV2 in torchvision", RandomExposureV2(p=0.5), pictures, True))
    if find_spec("albumentations"):
        for name, pipeline, is_ours in _pipelines(_ANY_LENGTH_PX, {}, p=0.5):
            doors.append((name, partial(_image, pipeline), arrays, is_ours))
    doors.append(("expose_numpy", _sometimes_exposed, arrays, True))
    ways = [
        Contender(name, partial(_epoch, _Changed(source, change)), is_ours)
        for name, change, source, is_ours in doors
    ]
    return Case(f"{count} pictures", ways, units=count)


class _Changed(Dataset[Any]):
    """Pictures, each changed when it is asked for."""

    def __init__(self, pictures: Any, change: Callable[[Any], Any]) -> None:
        self.pictures, self.change = pictures, change

    def __len__(self) -> int:
        return len(self.pictures)

    def __getitem__(self, index: int) -> Any:
        return self.change(self.pictures[index])


def _epoch(pictures: _Changed) -> int:
    return sum(1 for _ in DataLoader(pictures, training.BATCH, num_workers=_WORKERS))


def _of_one(change: nn.Module, picture: Tensor) -> Any:
    return change(picture[None])[0]


def _image(pipeline: Callable[..., Any], array: NDArray[np.uint8]) -> Any:
    return pipeline(image=array)["image"]


def _uint8(pictures: Tensor) -> Arrays:
    return list((255 * pictures).round().byte().permute(0, 2, 3, 1).contiguous().numpy())


def _moved(length_px: float) -> dict[str, Any]:
    """Ranges in which all pictures move as far, in any direction."""
    return {
        "exposure_s": _EXPOSURE_S,
        "illuminance_lux": (50.0, 5000.0),
        "speed_px_s": length_px / _EXPOSURE_S,
    }


def _exposed(arrays: Arrays, length_px: float) -> Any:
    drawn = np.random.default_rng().random((len(arrays), 2))
    exposures = [_exposure(length_px, 2 * np.pi * turn, seed) for seed, (turn, _) in enumerate(drawn)]
    return blurnoise.expose_numpy(np.stack(arrays), exposures)


def _sometimes_exposed(array: NDArray[np.uint8]) -> Any:
    chance, turn, share = torch.rand(3).tolist()
    if chance >= 0.5:
        return array
    seed = int(torch.randint(1 << 31, ()))
    return blurnoise.expose_numpy(array, _exposure(share * _ANY_LENGTH_PX[1], 2 * np.pi * turn, seed))


def _exposure(length_px: float, angle: float, seed: int) -> blurnoise.Exposure:
    speed = length_px / _EXPOSURE_S
    velocity = float(speed * np.cos(angle)), float(speed * np.sin(angle))
    camera = blurnoise.Camera.preset("imx250c")
    return blurnoise.Exposure(camera, _EXPOSURE_S, 500.0, velocity_px_s=velocity, seed=seed)


def _all(change: Callable[..., Any], arrays: Arrays) -> list[Any]:
    return [change(image=array) for array in arrays]


def _kornia(length_px: tuple[int, int], p: float) -> nn.Module:
    blur = kornia.RandomMotionBlur(length_px, (-180.0, 180.0), 0.0, border_type="reflect", p=p)
    return nn.Sequential(blur, kornia.RandomGaussianNoise(std=_NOISE, p=p), nn.Hardtanh(0.0, 1.0))


def _torchvision(length_px: int) -> Callable[[Tensor], Tensor] | None:
    try:
        from torchvision.transforms import v2
    except (ImportError, RuntimeError):  # not installed, or of another build than torch
        return None
    changes: Any = v2.Compose([v2.GaussianBlur(length_px), v2.GaussianNoise(sigma=_NOISE)])
    return lambda pictures: torch.stack([changes(picture) for picture in pictures])


def _of_arrays(arrays: Arrays, length_px: tuple[int, int], ranges: dict[str, Any] | None) -> list[Contender]:
    """What takes uint8 NumPy pictures, of the packages that are there. ranges: of ours; None for theirs alone."""
    ways = []
    if find_spec("albumentations"):
        for name, pipeline, is_ours in _pipelines(length_px, ranges, p=1.0):
            ways.append(Contender(name, partial(_all, pipeline, arrays), is_ours))
    if find_spec("nrtk") and find_spec("pybsm"):
        from nrtk.impls.perturb_image.optical import PybsmPerturber

        change = partial(PybsmPerturber(int_time=0.03, seed=1), img_gsd=0.02)
        ways.append(Contender("nrtk's PybsmPerturber", partial(_all, change, arrays)))
    return ways


def _pipelines(
    length_px: tuple[int, int], ranges: dict[str, Any] | None, p: float
) -> Iterator[tuple[str, Callable[..., Any], bool]]:
    """Pipelines of albumentations or AlbumentationsX, whichever is imported under that name."""
    library: Any = import_module("albumentations")
    changes = [library.MotionBlur(length_px, p=p), library.ISONoise(p=p)]
    if ranges is not None:
        from blurnoise.albumentations import RandomExposure

        yield "RandomExposure in albumentations", library.Compose([RandomExposure(**ranges, p=p)]), True
    last = (2, 0, 8)  # of albumentations, whose module AlbumentationsX continues
    version = tuple(int(part) for part in library.__version__.split(".")[:3])
    name = "AlbumentationsX" if version > last else "albumentations"
    yield f"{name} {library.__version__}", library.Compose(changes), False


@contextmanager
def _first_from(folder: Path) -> Iterator[None]:
    """Import from a folder first, albumentations anew: two libraries have this name."""
    hidden = {name: sys.modules.pop(name) for name in list(sys.modules) if name.startswith(_TWICE)}
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        sys.path.remove(str(folder))
        for name in [name for name in sys.modules if name.startswith(_TWICE)]:
            del sys.modules[name]
        sys.modules.update(hidden)
