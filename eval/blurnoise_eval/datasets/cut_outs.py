"""Cut-outs: a picture's targets as layers before their background, by what is known of where they are.

Convention: crowds, targets whose speed is 0, and all that is no target, are background. Of targets that touch or
overlap each other the one whose box ends further down is in front. What is behind a target is true where the picture
was rendered, the user's where there is a plate, else invented from around it (:mod:`blurnoise.scene.cutting`).
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise.blur.layers import Layer
from blurnoise.scene import cutting
from blurnoise.scene.cutting import Cut, Matte
from blurnoise.scene.scene import ExposedScene
from blurnoise_eval.datasets import segmentation
from blurnoise_eval.datasets.images import MOST_MEGAPIXELS, content, read_picture
from blurnoise_eval.datasets.records import Image, Picture, PictureSet, Target, UnreadablePicture
from blurnoise_eval.grid.objects import Objects
from blurnoise_eval.system.urls import Location, location, versions


class CutOut(NamedTuple):
    """A cut picture. targets: of each layer its place among the picture's targets; speeds: as of ``Objects``."""

    cut: Cut
    targets: tuple[int, ...]
    speeds: tuple[float, ...]


def check_cut(pictures: PictureSet, objects: Objects) -> None:
    """Raise ``ValueError`` where it is not known what the targets are, or what is asked for is missing."""
    if not pictures.labelled:
        raise ValueError(
            "moves: targets or background: needs to know where targets are; use --coco, --yolo, --bdd or --text, or "
            "rendered signs; without labels only all can move"
        )
    known = {target.label for picture in pictures for target in picture.targets or ()}
    for name, stated in (("speeds", dict(objects.speeds)), ("crossings", dict(objects.crossings))):
        if unknown := sorted({*stated} - known):
            raise ValueError(f"{name}: {', '.join(unknown)}: no target is one")
    if objects.mattes == "segmentation":
        cut = [target for each in pictures if each.cut is None for target in each.targets or ()]
        if lacking := sum(not target.crowd and not target.annotation.get("segmentation") for target in cut):
            must = "must be auto, grabcut or box"
            raise ValueError(f"mattes = 'segmentation': {lacking} targets have none; {must}")
    if objects.plates is not None:
        held = versions(location(objects.plates), [picture.name for picture in pictures])
        if missing := [picture.name for picture in pictures if picture.name not in held]:
            raise ValueError(f"plates = {objects.plates!r}: holds no {missing[0]!r}")


def source_identity(picture: Picture, objects: Objects) -> str:
    """The picture's identity with that of its plate, if there is one: of every file that reaches its pixels."""
    if objects.plates is None or picture.cut is not None:
        return picture.identity
    found = versions(location(objects.plates), [picture.name])
    return f"{picture.identity}, plate {picture.name} {found.get(picture.name, 'missing')}"


def source_content(picture: Picture, image: Image, objects: Objects) -> str:
    """What tells the picture and its plate from any other. Raises ``UnreadablePicture`` for a plate that is none."""
    own = content(image)
    if objects.plates is None or picture.cut is not None:
        return own
    return f"{own} {content(read_picture(location(objects.plates) / picture.name, MOST_MEGAPIXELS))}"


def cut_out(
    picture: Picture, image8: NDArray[np.uint8], light: Tensor, objects: Objects, scale: float = 1.0
) -> CutOut:
    """The targets of a picture cut out of its light (1, C, H, W), those that show, back to front.

    scale: by which a grey anchor made the light more than the picture's own. Targets that cover all of a picture have
    the picture itself behind them, which is never seen. Raises ``UnreadablePicture`` for a plate that is none, and
    where segmentations alone are asked for and one is not of this picture.
    """
    every = picture.targets or ()
    if picture.cut is not None:
        known = picture.cut()
        layers = tuple(replace(layer, light=layer.light * scale) for layer in known.layers)
        return _told(Cut(known.background * scale, layers, known.invented), range(len(every)), every, objects)
    backmost = sorted(range(len(every)), key=lambda place: (every[place].box_xyxy[3], place))
    backmost = [place for place in backmost if not every[place].crowd]
    cut_off = [place for place in backmost if _comes_apart(place, backmost, every, objects)]
    try:
        own = [(place, _matte(every[place], image8, objects.mattes)) for place in cut_off]
    except (TypeError, ValueError) as fault:
        raise UnreadablePicture(f"{picture.name}: mattes = {objects.mattes!r}: {fault}") from fault
    own = [(place, matte) for place, matte in own if matte.any()]
    found = [matte for _, matte in own]
    plate = None if objects.plates is None else _plate(location(objects.plates), picture, light, scale)
    still = [(0.0, 0.0)] * len(found)
    covered = np.any([matte > 0 for matte in found], axis=0) if found else np.zeros(light.shape[-2:], bool)
    hole = cutting.hole_of(covered)
    if plate is not None:  # only there: what stands, crowds too, is background
        plate = torch.where(torch.from_numpy(hole), plate, light)
    if plate is None and (not found or hole.all()):
        cut = cutting.cut_out(light, found, still, light)._replace(invented=covered)
    else:
        cut = cutting.cut_out(light, found, still, plate)
    motions = [_motion(every[place], objects) for place, _ in own]
    hidden = [_before(place, found, motions) for place in range(len(found))]
    layers = tuple(_of_picture(layer, light, by) for layer, by in zip(cut.layers, hidden, strict=True))
    cut = cut._replace(layers=layers)
    return _told(cut, [place for place, _ in own], every, objects)


def _comes_apart(place: int, backmost: Sequence[int], every: Sequence[Target], objects: Objects) -> bool:
    """Whether a target moves, or stands before one that does or right behind it; else it is background."""
    if not objects.stands(every[place].label):
        return True
    order = backmost.index(place)
    movers = {other for other in backmost if not objects.stands(every[other].label)}
    x0, y0, x1, y1 = every[place].box_xyxy
    return bool(movers.intersection(backmost[:order])) or any(
        x0 < right and left < x1 and y0 < bottom and top < y1
        for left, top, right, bottom in (every[other].box_xyxy for other in movers)
    )


def _told(cut: Cut, places: Sequence[int], targets: Sequence[Target], objects: Objects) -> CutOut:
    return CutOut(cut, tuple(places), tuple(objects.speed_of(targets[place].label) for place in places))


def _motion(target: Target, objects: Objects) -> Hashable:
    """Equal for targets that move alike."""
    return target if objects.crosses(target.label) else objects.speed_of(target.label)


def _before(place: int, found: Sequence[Matte], motions: Sequence[Hashable]) -> NDArray[np.bool_]:
    """Where (H, W) objects that move otherwise hide this one: what the picture shows there is theirs."""
    hidden = np.zeros(found[place].shape, bool)
    for other in range(place + 1, len(found)):
        if motions[other] != motions[place] and ((found[other] >= 1) & (found[place] > 0)).any():
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


def _matte(target: Target, image8: NDArray[np.uint8], how: str) -> Matte:
    """Where a target is. A text is all of its box: what carries it is not known, but moves with it."""
    size = (image8.shape[0], image8.shape[1])
    if how in ("auto", "segmentation") and target.annotation.get("segmentation"):
        if how == "segmentation":
            return segmentation.of_annotation(target.annotation, size)
        with suppress(TypeError, ValueError):  # of another size, or broken: the box is left
            matte = segmentation.of_annotation(target.annotation, size)
            if matte.any():
                return matte
    x0, y0, x1, y1 = target.box_xyxy
    if how == "box" or target.text is not None:
        return segmentation.of_box(x0, y0, x1 - x0, y1 - y0, size)
    return segmentation.of_object_in(image8, target.box_xyxy)


def _plate(folder: Location, picture: Picture, light: Tensor, scale: float) -> Tensor:
    found = ExposedScene.of_picture(read_picture(folder / picture.name, MOST_MEGAPIXELS)).light * scale
    if found.shape != light.shape:
        sizes = " and ".join(f"{each.shape[-1]} x {each.shape[-2]}" for each in (found, light))
        raise UnreadablePicture(
            f"{folder / picture.name}: a plate has its picture's size; they are {sizes} px"
        )
    return found
