"""Labelled pictures of stop signs among everything else, each from its seed and index alone.

Domain: sRGB-coded RGB, uint8. Boxes are px, x right and y down, in a picture that spans [0, W] x [0, H]. All
light is mixed linearly and averaged over pixels. Exposure, motion and sensor noise are left to
:mod:`blurnoise.simulate`: a scene is what a still, well-lit camera would have stored.

Convention: a box bounds the octagon as projected, whatever stands before it, cut off at the picture's edge.
Every octagon in red with a legend is labelled, and nothing else is.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from blurnoise._core.writing import check_own_folder, remove, write_whole
from blurnoise_models.scenes.drawing import Bytes, Easel, Floats, Plane, Points, Sprite, dim
from blurnoise_models.scenes.grounds import ground
from blurnoise_models.scenes.paint import Draws
from blurnoise_models.scenes.signs import BOX, octagon, stop_sign, weathered
from blurnoise_models.scenes.things import thing

_ALLOWED = {"seed": (0, 2**63 - 1), "index": (0, 10**9), "count": (1, 10**7), "size_px": (64, 8192)}
LABEL = "stop sign"
SMALLEST_PX, LARGEST_PX = 16.0, 200.0  # larger side of a sign's box, in a picture of 320 px
_DESIGN_PX = 320
_SIGNS = (0.35, 0.8, 0.94, 1.0)  # cumulative shares of scenes with no, one, two, three signs
_RETROREFLECTING = 1 / 3  # share of the other things, so that bright alone does not mean stop sign
_LEVELS = 4096  # linear levels between which the tone curve is looked up


@dataclass(frozen=True)
class DrawnScene:
    """A picture and its stop signs.

    picture: (H, W, 3) sRGB-coded RGB.
    boxes_xyxy: (n, 4) px, clipped to the picture; n may be 0.
    retroreflects: (H, W), the share of each pixel that returns the light of headlamps: that of all stop signs, and of
    every third other thing.

    >>> one = scene(seed=1, index=0, size_px=64)
    >>> one.picture.shape, one.boxes_xyxy.shape[1]
    ((64, 64, 3), 4)
    """

    picture: NDArray[np.uint8]
    boxes_xyxy: NDArray[np.float32]
    retroreflects: NDArray[np.float32]


@dataclass(frozen=True)
class _Canvas:
    """What is drawn on: the light (H, W, 3), and in each of three equal planes what retroreflects."""

    light: Floats
    retroreflects: Floats

    def paste(
        self, plane: Plane, sprite: Sprite, box: tuple[float, float, float, float], returns: bool
    ) -> None:
        """Lay a sprite into the picture, which then returns light there, or hides what does."""
        plane.paste(self.light, sprite, box)
        coverage = sprite[..., 3]
        plane.paste(self.retroreflects, cv2.merge([coverage * np.float32(returns)] * 3 + [coverage]), box)


def scene(seed: int, index: int, *, size_px: int = 320) -> DrawnScene:
    """Scene ``index`` of the stream ``seed``, size_px x size_px: a function of these three alone.

    Raises ``TypeError`` for numbers that are not integers, ``ValueError`` for a negative seed or index or
    fewer than 64 px.

    >>> from blurnoise_models.scenes import scene
    >>> first, again = scene(seed=1, index=3, size_px=64), scene(seed=1, index=3, size_px=64)
    >>> bool((first.picture == again.picture).all())  # a function of seed, index and size alone
    True
    """
    _check(seed=seed, index=index, size_px=size_px)
    rng, n = Draws(seed, index), size_px
    canvas = _Canvas(ground(rng, n), np.zeros((n, n, 3), np.float32))
    boards = Draws(seed, index, 1)  # a stream of its own: a scene's picture does not depend on it
    wanted = int(np.searchsorted(_SIGNS, rng.random()))
    for _ in range(int(rng.exponential(3.0 if wanted else 5.0))):
        _scatter(rng, canvas, [], boards.chance(_RETROREFLECTING))
    boxes: list[Points] = []
    for _ in range(wanted):
        placed = _place(rng, n, boxes)
        if placed is not None:
            plane, box, size = placed
            _erect(rng, canvas, plane, size)
            boxes.append(box)
    for _ in range(int(rng.exponential(1.0))):
        _scatter(rng, canvas, boxes, boards.chance(_RETROREFLECTING))
    picture = _developed(rng, _lit(rng, canvas.light))
    boxes_xyxy = np.array(boxes, np.float32).reshape(-1, 4)
    return DrawnScene(picture, boxes_xyxy, np.ascontiguousarray(canvas.retroreflects[..., 0]))


def write_coco(
    folder: Path, seed: int, count: int, *, size_px: int = 320, progress: Callable[[int], None] | None = None
) -> Path:
    """Write scenes 0 to count - 1 as PNG files with a COCO ``instances.json``, whose path is returned.

    The JSON file comes last, and whole: where it stands, all its pictures do. progress: called with 1
    after each scene. Raises as :func:`scene`, and ``OSError`` where nothing can be written.

    >>> import tempfile
    >>> from blurnoise_models.scenes import write_coco
    >>> listing = write_coco(Path(tempfile.mkdtemp()), seed=1, count=2, size_px=64)
    >>> [image["file_name"] for image in json.loads(listing.read_text())["images"]]
    ['000000.png', '000001.png']
    """
    _check(seed=seed, count=count, size_px=size_px)  # before anything is written
    check_own_folder(folder)
    folder.mkdir(parents=True, exist_ok=True)
    listing = folder / "instances.json"
    remove(listing)  # an older one does not belong to the new pictures
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for number in range(1, count + 1):
        one, name = scene(seed, number - 1, size_px=size_px), f"{number - 1:06d}.png"
        data = cv2.imencode(".png", np.ascontiguousarray(one.picture[..., ::-1]))[1]
        write_whole(folder / name, data.tobytes())
        images.append({"id": number, "file_name": name, "width": size_px, "height": size_px})
        for x0, y0, x1, y1 in one.boxes_xyxy.tolist():
            box = {"bbox": [x0, y0, x1 - x0, y1 - y0], "area": (x1 - x0) * (y1 - y0), "iscrowd": 0}
            annotations.append({"id": len(annotations) + 1, "image_id": number, "category_id": 1, **box})
        if progress is not None:
            progress(1)
    document = {"images": images, "annotations": annotations, "categories": [{"id": 1, "name": LABEL}]}
    write_whole(listing, json.dumps(document).encode())
    return listing


def _place(rng: Draws, n: int, taken: list[Points]) -> tuple[Plane, Points, float] | None:
    """A view of a sign that is at least half in the picture and hides no other; None if none fits."""
    for _ in range(8):
        plane, size = _view(rng, n)
        corners = plane.project(octagon())
        low, high = corners.min(axis=0), corners.max(axis=0)
        box = np.concatenate([np.clip(low, 0, n), np.clip(high, 0, n)])
        tall = high[1] - low[1]
        column = box + np.array([0, -tall, 0, 2 * tall])  # what else belongs to the sign
        if _shown(corners, n) >= 0.55 and all(_overlap(column, other) == 0 for other in taken):
            return plane, box, size
    return None


def _view(rng: Draws, n: int) -> tuple[Plane, float]:
    """Where a sign stands and how it is turned; and its larger side, px."""
    low, high = (SMALLEST_PX, 34.0) if rng.chance(0.35) else (22.0, LARGEST_PX)
    size = math.exp(rng.between(math.log(low), math.log(high))) * n / _DESIGN_PX
    yaw = float(np.clip(rng.normal(0, 20), -50, 50))
    pitch = float(np.clip(rng.normal(0, 7), -20, 20))
    roll = float(np.clip(rng.normal(0, 12 if rng.chance(0.12) else 4), -28, 28))
    plane = Plane.seen(yaw, pitch, roll, rng.between(2.5, 12.0))
    margin = -0.25 * size if rng.chance(0.15) else 0.5 * size
    x, y = rng.uniform(margin, n - margin, 2).tolist() if margin < n / 2 else (n / 2, n / 2)
    return plane.placed(octagon(), size, (x, y)), size


def _shown(corners: Points, n: int) -> float:
    """Share of a convex polygon's area that lies in the picture."""
    frame = np.array([[0, 0], [n, 0], [n, n], [0, n]], np.float32)
    area, _ = cv2.intersectConvexConvex(np.asarray(corners, np.float32), frame)
    return float(area) / float(cv2.contourArea(np.asarray(corners, np.float32)))


def _overlap(box: Points, other: Points) -> float:
    """Share of ``other`` that ``box`` covers."""
    sides = np.minimum(box[2:], other[2:]) - np.maximum(box[:2], other[:2])
    return float(np.prod(np.maximum(sides, 0)) / np.prod(other[2:] - other[:2]))


def _erect(rng: Draws, canvas: _Canvas, plane: Plane, size: float) -> None:
    """Pole and sign, in the sign's plane."""
    n = int(np.clip(2 * size, 48, 256))
    if rng.chance(0.7):
        half = rng.between(0.02, 0.06)
        pole = Easel.blank(64, 8)
        pole.rectangle(0, 0, 1, 1, rng.colour() if rng.chance(0.6) else (150, 152, 154))
        sprite = weathered(rng, pole.sprite())
        canvas.paste(plane, sprite, (-half, -0.5, half, rng.between(1.0, 2.4)), returns=False)
    canvas.paste(plane, stop_sign(rng, n), BOX, returns=True)


def _scatter(rng: Draws, canvas: _Canvas, spare: list[Points], returns: bool) -> None:
    """Put a thing somewhere, but hide no more than a quarter of any box in ``spare``. returns: light of headlamps."""
    n = canvas.light.shape[0]
    size = math.exp(rng.between(math.log(10), math.log(250))) * n / _DESIGN_PX
    x, y = rng.uniform(0, n, 2)
    reach = 0.5 * size * np.array([-1.6, -1.1, 1.6, 1.1])  # most things are no wider than this
    if any(_overlap(np.array([x, y, x, y]) + reach, box) > 0.25 for box in spare):
        return
    sprite = thing(rng, int(np.clip(1.3 * size, 32, 192)))
    ratio = sprite.shape[1] / sprite.shape[0]
    if ratio > 1.4:  # wide things keep their area, not their height
        size *= math.sqrt(1.4 / ratio) if not spare else 1.4 / ratio
    turn = rng.normal(0, 60 if rng.chance(0.1) else 7)
    plane = Plane.seen(rng.normal(0, 20), rng.normal(0, 8), turn, rng.between(2.5, 10.0))
    frame = np.array([[-ratio / 2, -0.5], [ratio / 2, -0.5], [ratio / 2, 0.5], [-ratio / 2, 0.5]])
    place = plane.placed(frame, size * max(1.0, ratio), (x, y))
    canvas.paste(place, sprite, (-ratio / 2, -0.5, ratio / 2, 0.5), returns)


def _lit(rng: Draws, canvas: Floats) -> Floats:
    """The scene's light: its colour, its fall-off, haze; and the lens's softness."""
    n = canvas.shape[0]
    if rng.chance(0.2):
        dim(canvas, rng.ramp(n, n, rng.between(0.15, 0.8)))
    warmth = rng.normal(0, 0.16 if rng.chance(0.25) else 0.05)
    tint = np.array([math.exp(warmth), math.exp(rng.normal(0, 0.03)), math.exp(-warmth)])
    metered = rng.between(0.08, 0.4)  # a camera meters the scene, not always well
    key = metered / max(cv2.mean(canvas)[1], 1e-3)
    tint *= np.clip(key, 0.6, 2.2) ** rng.between(0.0, 1.0)
    haze = rng.between(0.03, 0.25) if rng.chance(0.08) else 0.0
    veil = np.full((3, 1), 0.7 * haze)
    canvas = np.asarray(cv2.transform(canvas, np.hstack([np.diag(tint * (1 - haze)), veil])))
    if rng.chance(0.5):
        canvas = np.asarray(cv2.GaussianBlur(canvas, (0, 0), rng.between(0.3, 1.0) * n / _DESIGN_PX))
    return canvas


def _developed(rng: Draws, canvas: Floats) -> Bytes:
    """The coded picture: tone curve, colourfulness, resampling, sharpening and JPEG of a stored photograph."""
    n = canvas.shape[0]
    table = _tone_curve(rng.between(-0.1, 0.5))
    canvas *= np.float32(_LEVELS - 1)
    picture = np.take(table, canvas.astype(np.int32), mode="clip")
    if rng.chance(0.4):  # more or less colourful, or grey
        grey = cv2.cvtColor(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)
        colourful = 0.0 if rng.chance(0.08) else rng.between(0.4, 1.3)
        picture = np.asarray(cv2.addWeighted(picture, colourful, grey, 1 - colourful, 0), np.uint8)
    if rng.chance(0.35):
        side = int(n * rng.between(0.65, 1.0))
        smaller = cv2.resize(picture, (side, side), interpolation=cv2.INTER_AREA)
        way = cv2.INTER_CUBIC if rng.chance(0.5) else cv2.INTER_LINEAR
        picture = np.asarray(cv2.resize(smaller, (n, n), interpolation=way), np.uint8)
    if rng.chance(0.35):
        soft, amount = cv2.GaussianBlur(picture, (0, 0), rng.between(0.6, 1.2)), rng.between(0.15, 0.9)
        picture = np.asarray(cv2.addWeighted(picture, 1 + amount, soft, -amount, 0), np.uint8)
    if rng.chance(0.5):
        quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(40, 96))]
        coded = cv2.imencode(".jpg", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), quality)[1]
        picture = np.asarray(cv2.cvtColor(cv2.imdecode(coded, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB), np.uint8)
    return picture


def _tone_curve(contrast: float) -> Bytes:
    """sRGB coding of linear levels, then an S of the given strength about the middle."""
    linear = np.linspace(0, 1, _LEVELS)
    high = 1.055 * np.maximum(linear, 1e-4) ** (1 / 2.4) - 0.055
    coded = np.where(linear <= 0.0031308, 12.92 * linear, high)
    coded += contrast * (coded * coded * (3 - 2 * coded) - coded)
    return np.asarray(np.rint(coded * 255), np.uint8)


def _check(**given: int) -> None:
    for name, value in given.items():
        low, high = _ALLOWED[name]
        if not isinstance(value, int) or isinstance(value, bool):
            raise TypeError(f"{name} = {value!r}: must be an integer")
        if not low <= value <= high:
            raise ValueError(f"{name} = {value!r}: must be >= {low} and <= {high}")
