"""Cut-outs: a picture's targets as layers in front of their background, each of which moves by itself.

Convention: crowds, targets whose speed is 0, and everything that is no target, are background. Of targets that touch
or overlap, the one whose box ends further down is in front. The background behind a target is known where the picture
was rendered, else inpainted from around it (:mod:`blurnoise.scene.cutting`).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import groupby
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core.borders import Window, placed
from blurnoise.blur.layer import Layer, flattened
from blurnoise.blur.layers import meeting, seen_behind
from blurnoise.light.headlit import Outline
from blurnoise.scene import cutting
from blurnoise.scene.cutting import Cut, Matte
from blurnoise.scene.exposure import Exposure
from blurnoise.scene.scene import Scene
from blurnoise_eval.datasets import segmentation
from blurnoise_eval.datasets.records import Picture, PictureSet, Target
from blurnoise_eval.plan.objects import ObjectSettings

_NEAR_PX = 32  # between windows that are cheaper apart than as one


class CutOut(NamedTuple):
    """A cut picture. targets: the index of each layer's target; speeds: of the layers, as of ``ObjectSettings``."""

    cut: Cut
    targets: tuple[int, ...]
    speeds: tuple[float, ...]


def check_labelled(pictures: PictureSet, setting: str, otherwise: str) -> None:
    """Raise ``ValueError`` if the pictures have no labels, which a setting needs."""
    if not pictures.labelled:
        raise ValueError(f"{setting}: needs labelled targets (labels) or rendered signs; {otherwise}")


def check_cut(pictures: PictureSet, objects: ObjectSettings) -> None:
    """Raise ``ValueError`` if the pictures have no labels, or if no target has a class that ``objects`` names."""
    check_labelled(pictures, "moves = targets or background", "pictures without labels allow only all")
    known = {target.label for picture in pictures for target in picture.targets or ()}
    if unknown := sorted({*objects.speeds} - known):
        raise ValueError(f"speeds: {', '.join(unknown)}: must be classes of the targets")


def cut_out(
    picture: Picture, light: Tensor, objects: ObjectSettings, scale: float = 1.0, emitters: float = 1.0
) -> CutOut:
    """Cut the visible targets of a picture out of its light (1, C, H, W), back to front.

    scale: factor of a grey anchor on the picture's light. emitters: factor on that of targets. Targets that cover the
    whole picture have the picture itself as background, which is never visible.
    """
    targets, size = picture.targets or (), (light.shape[-2], light.shape[-1])
    if picture.cut is not None:
        known, indices = picture.cut(), [*range(len(targets))]
        layers = tuple(replace(layer, light=layer.light * (scale * emitters)) for layer in known.layers)
        cut = Cut(known.background * scale, layers, known.invented)
    else:
        back_to_front = [index for index, target in enumerate(targets) if not target.crowd]
        back_to_front.sort(key=lambda index: targets[index].box_xyxy[3])
        needed = _need_layers(back_to_front, targets, objects)
        mattes = {index: _matte(targets[index], size) for index in needed}
        indices = [index for index, matte in mattes.items() if matte.any()]
        visible = [mattes[index] for index in indices]
        covered = np.any([matte > 0 for matte in visible], axis=0) if visible else np.zeros(size, bool)
        # Nothing is left to fill the background from where targets cover the whole picture.
        behind = light if not visible or cutting.hole_of(covered).all() else None
        cut = cutting.cut_out(light, visible, [(0.0, 0.0)] * len(visible), behind)
        speeds = [objects.speed_of(targets[index].label) for index in indices]
        hidden = [_hidden(number, visible, speeds) for number in range(len(visible))]
        layers = tuple(_of_picture(layer, light, by) for layer, by in zip(cut.layers, hidden, strict=True))
        cut = cut._replace(layers=layers, invented=cut.invented if behind is None else covered)
    return CutOut(cut, tuple(indices), tuple(objects.speed_of(targets[index].label) for index in indices))


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


def outlines(picture: Picture, size: tuple[int, int]) -> list[Outline | None]:
    """The targets of a picture (H, W) for headlamps to light, in their order; None of crowds.

    A rendered target has its own matte, others that of their segmentation; without either the whole box counts.
    """
    targets = picture.targets or ()
    if picture.cut is None:
        return [None if target.crowd else _outline(target, size) for target in targets]
    layers = picture.cut().layers
    return [
        Outline(target.label, target.box_xyxy, *_within(layer, size))
        for target, layer in zip(targets, layers, strict=True)
    ]


def _within(layer: Layer, size: tuple[int, int]) -> tuple[Matte, tuple[int, int], bool]:
    """The matte of a layer within the picture, its place, and that it is an outline."""
    alpha = placed(layer.alpha[None, None], layer.place_px, Window(0, 0, *size), size, "replicate")[0, 0]
    return (*_trimmed(alpha.numpy()), True)


def _outline(target: Target, size: tuple[int, int]) -> Outline:
    with suppress(ValueError):
        matte = segmentation.of_annotation(target.annotation, size)
        if matte.any():
            return Outline(target.label, target.box_xyxy, *_trimmed(matte), outlined=True)
    return Outline(target.label, target.box_xyxy)


def _trimmed(matte: Matte) -> tuple[Matte, tuple[int, int]]:
    rows, columns = np.flatnonzero(matte.any(1)), np.flatnonzero(matte.any(0))
    if not len(rows):
        return matte[:0, :0], (0, 0)
    part = matte[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return part, (int(columns[0]), int(rows[0]))


def _need_layers(
    back_to_front: Sequence[int], targets: Sequence[Target], objects: ObjectSettings
) -> list[int]:
    """Targets that need a layer: moving ones, those in front of one, and those that overlap one. The others are
    background."""
    moving = [index for index in back_to_front if objects.speed_of(targets[index].label)]
    first = back_to_front.index(moving[0]) if moving else len(back_to_front)
    return [
        index
        for number, index in enumerate(back_to_front)
        if number >= first or _overlaps(targets[index], [targets[mover] for mover in moving])
    ]


def _overlaps(target: Target, others: Collection[Target]) -> bool:
    x0, y0, x1, y1 = target.box_xyxy
    boxes = [other.box_xyxy for other in others]
    return any(x0 < right and left < x1 and y0 < bottom and top < y1 for left, top, right, bottom in boxes)


def _hidden(index: int, mattes: Sequence[Matte], speeds: Sequence[float]) -> NDArray[np.bool_]:
    """Where (H, W) targets in front that move differently hide this one: the picture shows them there."""
    hidden = np.zeros(mattes[index].shape, bool)
    for other in range(index + 1, len(mattes)):
        if speeds[other] != speeds[index] and ((mattes[other] >= 1) & (mattes[index] > 0)).any():
            hidden |= mattes[other] > 0
    return cutting.hole_of(hidden) if hidden.any() else hidden


def _of_picture(layer: Layer, light: Tensor, hidden: NDArray[np.bool_]) -> Layer:
    """Keep the picture's colours up to the edge of a layer; fill hidden parts from visible ones."""
    # The edge's pixels are mixed with the background. For small targets that is a smaller error than the outline that
    # unmixing would lose: 3 to 5 against 11 to 17 DN for signs of 24 to 64 px.
    (left, top), (height, width) = layer.place_px, layer.alpha.shape
    within = (slice(top, top + height), slice(left, left + width))
    colours, unknown = light[..., *within], hidden[within]
    if unknown.any():
        unknown = unknown | (layer.alpha.numpy() == 0)
        colours = colours if unknown.all() else cutting.filled(colours, unknown)
    return replace(layer, light=colours[0])


def _matte(target: Target, size: tuple[int, int]) -> Matte:
    """Where a target is in a picture (H, W): its segmentation, else its box.

    A text moves with its sign or label, which no annotation outlines: its whole box is the best that is known.
    """
    with suppress(ValueError):  # no segmentation, one of another size, or a broken one
        matte = segmentation.of_annotation(target.annotation, size)
        if matte.any():
            return matte
    x0, y0, x1, y1 = target.box_xyxy
    return segmentation.of_box(x0, y0, x1 - x0, y1 - y0, size)


class CutScene:
    """A picture with its targets cut out, so that either may move without the other, as ``Exposure.moves`` says.

    scene: the background, and before it the targets as layers that move at a speed. speeds: one for each layer of the
    cut, by default 1: a multiple of the exposure's velocity. Where the camera tracks targets of speed 1, one of speed
    s is left with 1 - s, so that one that stands moves with the background. headlamp_lux: of the background by beam;
    layers have their own.
    """

    def __init__(
        self,
        cut: Cut,
        speeds: Sequence[float] | None = None,
        lamp_mask: Tensor | None = None,
        headlamp_lux: Mapping[str, Tensor] = {},
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
        self.scene = Scene(
            cut.background, layers=tuple(self._joined), lamp_mask=lamp_mask, headlamp_lux=headlamp_lux
        )
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
