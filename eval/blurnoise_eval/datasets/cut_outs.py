"""Cut-outs: a picture's targets as layers before their background, each of which moves for itself.

Convention: crowds, targets whose speed is 0, and all that is no target, are background. Of targets that touch or
overlap each other the one whose box ends further down is in front. What is behind a target is true where the picture
was rendered, else invented from around it (:mod:`blurnoise.scene.cutting`).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import groupby
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core.borders import Window, placed
from blurnoise.blur.layers import Layer, flattened, meeting, seen_behind
from blurnoise.scene import cutting
from blurnoise.scene.cutting import Cut, Matte
from blurnoise.scene.exposure import Exposure
from blurnoise.scene.scene import Scene
from blurnoise_eval.datasets import segmentation
from blurnoise_eval.datasets.records import Picture, PictureSet, Target
from blurnoise_eval.plan.objects import Objects

_NEAR_PX = 32  # between windows that are cheaper apart than as one


class CutOut(NamedTuple):
    """A cut picture. targets: of each layer its place among the picture's targets; speeds: as of ``Objects``."""

    cut: Cut
    targets: tuple[int, ...]
    speeds: tuple[float, ...]


def check_labelled(pictures: PictureSet, setting: str, otherwise: str) -> None:
    """Raise ``ValueError`` if the pictures have no labels, which a setting needs."""
    if not pictures.labelled:
        raise ValueError(f"{setting}: needs labelled targets (labels) or rendered signs; {otherwise}")


def check_cut(pictures: PictureSet, objects: Objects) -> None:
    """Raise ``ValueError`` if the pictures have no labels, or if no target has a class that ``objects`` names."""
    check_labelled(pictures, "moves = targets or background", "pictures without labels allow only all")
    known = {target.label for picture in pictures for target in picture.targets or ()}
    if unknown := sorted({*objects.speeds} - known):
        raise ValueError(f"speeds: {', '.join(unknown)}: must be classes of the targets")


def cut_out(
    picture: Picture, light: Tensor, objects: Objects, scale: float = 1.0, emitters: float = 1.0
) -> CutOut:
    """The targets of a picture cut out of its light (1, C, H, W), those that show, back to front.

    scale: by which a grey anchor made the light more than the picture's own; emitters: by which targets are
    brighter. Targets that cover all of a picture have the picture itself behind them, which is never seen.
    """
    every, size = picture.targets or (), (light.shape[-2], light.shape[-1])
    if picture.cut is not None:
        known, places = picture.cut(), [*range(len(every))]
        layers = tuple(replace(layer, light=layer.light * (scale * emitters)) for layer in known.layers)
        cut = Cut(known.background * scale, layers, known.invented)
    else:
        backmost = [place for place, target in enumerate(every) if not target.crowd]
        backmost.sort(key=lambda place: every[place].box_xyxy[3])
        mattes = {place: _matte(every[place], size) for place in _apart(backmost, every, objects)}
        places = [place for place, matte in mattes.items() if matte.any()]
        found = [mattes[place] for place in places]
        covered = np.any([matte > 0 for matte in found], axis=0) if found else np.zeros(size, bool)
        behind = light if not found or cutting.hole_of(covered).all() else None
        cut = cutting.cut_out(light, found, [(0.0, 0.0)] * len(found), behind)
        speeds = [objects.speed_of(every[place].label) for place in places]
        hidden = [_hidden(number, found, speeds) for number in range(len(found))]
        layers = tuple(_of_picture(layer, light, by) for layer, by in zip(cut.layers, hidden, strict=True))
        cut = cut._replace(layers=layers, invented=cut.invented if behind is None else covered)
    return CutOut(cut, tuple(places), tuple(objects.speed_of(every[place].label) for place in places))


def target_mask(picture: Picture, size: tuple[int, int]) -> Matte:
    """Where the targets of a picture (H, W) are: the share of each pixel that one of them covers, (H, W)."""
    if picture.cut is not None:
        whole = Window(0, 0, *size)
        layers = picture.cut().layers
        alphas = (
            placed(layer.alpha[None, None], layer.place_px, whole, size, "replicate") for layer in layers
        )
        mattes = [alpha[0, 0].numpy() for alpha in alphas]
    else:
        mattes = [_matte(target, size) for target in picture.targets or () if not target.crowd]
    return np.asarray(np.max(mattes, axis=0), np.float32) if mattes else np.zeros(size, np.float32)


def _apart(backmost: Sequence[int], every: Sequence[Target], objects: Objects) -> list[int]:
    """The targets that move, stand before one that does or right behind it; the others are background."""
    movers = [place for place in backmost if objects.speed_of(every[place].label)]
    first = backmost.index(movers[0]) if movers else len(backmost)
    return [
        place
        for number, place in enumerate(backmost)
        if number >= first or _meets(every[place], [every[mover] for mover in movers])
    ]


def _meets(target: Target, others: Collection[Target]) -> bool:
    x0, y0, x1, y1 = target.box_xyxy
    boxes = [other.box_xyxy for other in others]
    return any(x0 < right and left < x1 and y0 < bottom and top < y1 for left, top, right, bottom in boxes)


def _hidden(place: int, found: Sequence[Matte], speeds: Sequence[float]) -> NDArray[np.bool_]:
    """Where (H, W) objects that move otherwise hide this one: what the picture shows there is theirs."""
    hidden = np.zeros(found[place].shape, bool)
    for other in range(place + 1, len(found)):
        if speeds[other] != speeds[place] and ((found[other] >= 1) & (found[place] > 0)).any():
            hidden |= found[other] > 0
    return cutting.hole_of(hidden) if hidden.any() else hidden


def _of_picture(layer: Layer, light: Tensor, hidden: NDArray[np.bool_]) -> Layer:
    """With the picture's own colours to its edge: what is mixed there with the background is the smaller error, for
    small targets, than what is lost of their outline (3 to 5 against 11 to 17 DN for signs of 24 to 64 px). What is
    hidden of it is invented from what shows of it, if anything does."""
    (left, top), (height, width) = layer.place_px, layer.alpha.shape
    within = (slice(top, top + height), slice(left, left + width))
    own, unknown = light[..., *within], hidden[within]
    if unknown.any():
        unknown = unknown | (layer.alpha.numpy() == 0)
        own = own if unknown.all() else cutting.filled(own, unknown)
    return replace(layer, light=own[0])


def _matte(target: Target, size: tuple[int, int]) -> Matte:
    """Where a target is in a picture (H, W): its segmentation, else its box; all of the box of a text, since what
    carries it is not known, but moves with it."""
    with suppress(ValueError):  # none, of another size, or broken
        matte = segmentation.of_annotation(target.annotation, size)
        if matte.any():
            return matte
    x0, y0, x1, y1 = target.box_xyxy
    return segmentation.of_box(x0, y0, x1 - x0, y1 - y0, size)


class CutScene:
    """A picture with its targets cut out, so that either may move without the other, as ``Exposure.moves`` says.

    scene: the background, and before it the targets as layers that move at a speed. speeds: one for each layer of the
    cut, by default 1: a multiple of the exposure's velocity. Where the camera tracks targets of speed 1, one of speed
    s is left with 1 - s, so that one that stands moves with the background.
    """

    def __init__(
        self, cut: Cut, speeds: Sequence[float] | None = None, lamp_mask: Tensor | None = None
    ) -> None:
        factors = (1.0,) * len(cut.layers) if speeds is None else speeds
        self._cut = cut
        self._targets = [replace(layer, speed=by) for layer, by in zip(cut.layers, factors, strict=True)]
        self._joined: list[Layer] = []  # those that move alike and are near each other as one
        for speed, group in groupby(self._targets, key=lambda layer: layer.speed):
            alike = list(group)
            near = meeting([layer.window.grown(_NEAR_PX // 2, _NEAR_PX // 2) for layer in alike])
            together = (flattened([alike[index] for index in indices]) for _, indices in near)
            self._joined += [replace(layer, speed=speed) for layer in together]
        self.scene = Scene(cut.background, layers=tuple(self._joined), lamp_mask=lamp_mask)
        self._shares: dict[tuple[float, ...], tuple[float, ...]] = {}

    def invented(self, exposure: Exposure) -> tuple[float, ...]:
        """Per target: the share of the background hidden at mid-exposure that becomes visible and was filled in.

        It depends on the target's motion relative to its background, whichever of the two moves.
        """
        if exposure.moves == "all" or not self._cut.invented.any():
            return (0.0,) * len(self._targets)
        relative = replace(exposure, moves="targets")

        def moved_px(layer: Layer) -> tuple[float, float]:
            x, y = relative.velocity_of(layer)
            return float(x) * exposure.exposure_s, float(y) * exposure.exposure_s

        key = (*exposure.velocity_px_s, exposure.exposure_s)
        if key not in self._shares:
            movers = [(layer, moved_px(layer)) for layer in self._joined]
            self._shares[key] = tuple(
                seen_behind(layer, movers, self.scene.size) if any(moved_px(layer)) else 0.0
                for layer in self._targets
            )
        return self._shares[key]
