"""Flat things drawn large, then laid into a picture as a camera's pixels see them: by area, in linear light.

Domain: a :data:`Sprite` is (h, w, 4) float32, linear RGB times coverage, then coverage. A canvas is (H, W, 3)
float32 linear RGB. x points right and y down, a picture spans [0, W] x [0, H], pixel centres lie at
integer + 0.5. Colours are sRGB-coded triples of 0-255.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import matplotlib
import numpy as np
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Bytes = NDArray[np.uint8]
Points = NDArray[np.float64]
Sprite = NDArray[np.float32]
Colour = tuple[int, int, int]

_CODED = np.arange(256) / 255
_LINEAR = np.where(_CODED <= 0.04045, _CODED / 12.92, ((_CODED + 0.055) / 1.055) ** 2.4).astype(np.float32)
_FROM_INDEX = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])  # OpenCV's indices are pixel centres
_TO_INDEX = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1]])
_SHIFT = 4  # OpenCV's sub-pixel bits

_DEJAVU = tuple(f"DejaVu{style}.ttf" for style in ("Sans-Bold", "Sans", "Serif-Bold", "SansMono-Bold"))
FONTS = (*_DEJAVU, "STIXGeneralBol.ttf", "cmss10.ttf")


def linear(coded: Bytes) -> Floats:
    """Linear light of sRGB-coded values, any shape.

    >>> linear(np.array([[0, 188, 255]], np.uint8)).round(2).tolist()  # 188 is half of the light
    [[0.0, 0.5, 1.0]]
    """
    return np.asarray(cv2.LUT(coded, _LINEAR), np.float32)


@dataclass(frozen=True)
class Easel:
    """A sheet to draw on without antialiasing: coordinates are in sheet heights.

    rgba: (2h, 2w, 4) sRGB-coded colour, and 255 where something was drawn; twice as fine as its sprite.

    >>> easel = Easel.blank(height_px=1, width_px=2)  # two heights wide
    >>> easel.rectangle(0.0, 0.0, 2.0, 1.0, (255, 255, 255))
    >>> easel.width, easel.sprite()[..., 3].tolist()
    (2.0, [[1.0, 1.0]])
    """

    rgba: Bytes

    @classmethod
    def blank(cls, height_px: int, width_px: int) -> Easel:
        """A transparent sheet for a sprite of this size."""
        return cls(np.zeros((2 * height_px, 2 * width_px, 4), np.uint8))

    @property
    def width(self) -> float:
        """Width in heights."""
        height, width = self.rgba.shape[:2]
        return float(width / height)

    def polygon(self, points: Points | Sequence[tuple[float, float]], colour: Colour) -> None:
        """Fill a polygon, (n, 2)."""
        cv2.fillPoly(self.rgba, [self._fixed(points)], (*colour, 255), cv2.LINE_8, _SHIFT)

    def rectangle(self, x0: float, y0: float, x1: float, y1: float, colour: Colour) -> None:
        """Fill an upright rectangle."""
        self.polygon([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], colour)

    def ellipse(
        self, x: float, y: float, rx: float, ry: float, colour: Colour, turn_deg: float = 0.0
    ) -> None:
        """Fill an ellipse."""
        n = self.rgba.shape[0] << _SHIFT
        half = 1 << (_SHIFT - 1)
        centre = round(x * n) - half, round(y * n) - half
        size = max(0, round(rx * n)), max(0, round(ry * n))
        ink = (*colour, 255)
        cv2.ellipse(self.rgba, centre, size, turn_deg, 0.0, 360.0, ink, cv2.FILLED, cv2.LINE_8, _SHIFT)

    def line(self, points: Points | Sequence[tuple[float, float]], colour: Colour, thickness: float) -> None:
        """Draw an open line through points, (n, 2)."""
        pixels = max(1, round(thickness * self.rgba.shape[0]))
        cv2.polylines(self.rgba, [self._fixed(points)], False, (*colour, 255), pixels, cv2.LINE_8, _SHIFT)

    def text(
        self,
        words: str,
        box: tuple[float, float, float, float],
        colour: Colour,
        *,
        font: str = FONTS[0],
        weight: float = 0.0,
        stretch: float | None = None,
    ) -> None:
        """Write words into box (x0, y0, x1, y1).

        The height is the box's. The width is ``stretch`` times the font's own, or less where the box is
        narrower, or the box's where stretch is None. weight: added stroke, in heights of the sheet.
        """
        contours, aspect = outline(words, font)
        x0, y0, x1, y1 = box
        width = x1 - x0
        if stretch is not None:
            width = min(width, stretch * aspect * (y1 - y0))
        left = (x0 + x1 - width) / 2
        placed = [self._fixed(contour * (width, y1 - y0) + (left, y0)) for contour in contours]
        cv2.fillPoly(self.rgba, placed, (*colour, 255), cv2.LINE_8, _SHIFT)
        pixels = round(weight * self.rgba.shape[0])
        if pixels > 0:
            cv2.polylines(self.rgba, placed, True, (*colour, 255), pixels, cv2.LINE_8, _SHIFT)

    def sprite(self) -> Sprite:
        """What was drawn, as linear light, (h, w, 4): the mean over 2 x 2 points."""
        light = linear(self.rgba)  # undrawn is black: premultiplied as it stands; 255 stands for 1 either way
        height, width = light.shape[:2]
        return np.asarray(cv2.resize(light, (width // 2, height // 2), interpolation=cv2.INTER_AREA))

    def _fixed(self, points: Points | Sequence[tuple[float, float]]) -> NDArray[np.int32]:
        pixels = np.asarray(points) * self.rgba.shape[0] - 0.5  # OpenCV's integers are pixel centres
        return np.asarray(np.rint(pixels * (1 << _SHIFT)), np.int32)


@lru_cache(maxsize=4096)
def outline(words: str, font: str) -> tuple[tuple[Points, ...], float]:
    """Contours of words, to be filled even-odd, scaled to the unit square, y down; and their width / height.

    >>> contours, aspect = outline("O", FONTS[0])
    >>> len(contours), aspect < 1.2  # an outer and an inner line
    (2, True)
    """
    path = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / font
    shape = TextPath((0, 0), words, size=100, prop=FontProperties(fname=str(path)))
    contours = [np.asarray(polygon, np.float64) * (1, -1) for polygon in shape.to_polygons()]
    every = np.concatenate(contours)
    low, extent = every.min(axis=0), np.maximum(np.ptp(every, axis=0), 1e-3)
    return tuple((contour - low) / extent for contour in contours), float(extent[0] / extent[1])


@dataclass(frozen=True)
class Plane:
    """A plane in front of the camera. matrix: (3, 3), from the plane's units to canvas px.

    >>> square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    >>> ahead = Plane.seen(0.0, 0.0, 0.0, distance=5.0).placed(square, 20.0, (50.0, 50.0))
    >>> ahead.project(square)[0].tolist()  # 20 px wide, about (50, 50)
    [40.0, 40.0]
    """

    matrix: Points

    @classmethod
    def seen(cls, yaw_deg: float, pitch_deg: float, roll_deg: float, distance: float) -> Plane:
        """The plane turned about its origin, seen from ``distance`` units, in units before any scaling.

        roll turns counter-clockwise as displayed.
        """
        yaw, pitch, roll = (math.radians(angle) for angle in (yaw_deg, pitch_deg, -roll_deg))
        about_y = np.array([[math.cos(yaw), 0, math.sin(yaw)], [0, 1, 0], [-math.sin(yaw), 0, math.cos(yaw)]])
        about_x = np.array([[1, 0, 0], [0, math.cos(pitch), 0], [0, math.sin(pitch), 0]])
        about_z = np.array(
            [[math.cos(roll), -math.sin(roll), 0], [math.sin(roll), math.cos(roll), 0], [0, 0, 1]]
        )
        matrix = about_z @ about_x @ about_y  # of points with z = 0
        matrix[2] = [*(matrix[2, :2] / distance), 1.0]
        matrix[:2, 2] = 0.0
        return cls(matrix)

    def project(self, points: Points) -> Points:
        """Canvas points (n, 2) of plane points (n, 2)."""
        flat = points @ self.matrix[:, :2].T + self.matrix[:, 2]
        return np.asarray(flat[:, :2] / flat[:, 2:])

    def placed(self, shape: Points, size_px: float, centre: tuple[float, float]) -> Plane:
        """Scaled and moved so that the larger side of ``shape``'s box is size_px, about ``centre``."""
        seen = self.project(shape)
        low, high = seen.min(axis=0), seen.max(axis=0)
        scale = size_px / float((high - low).max())
        shift = np.asarray(centre) - (low + high) / 2 * scale
        return Plane(np.array([[scale, 0, shift[0]], [0, scale, shift[1]], [0, 0, 1]]) @ self.matrix)

    def paste(self, canvas: Floats, sprite: Sprite, box: tuple[float, float, float, float]) -> None:
        """Lay a sprite over the canvas, into ``box`` (x0, y0, x1, y1) of the plane.

        The sprite is first averaged down to about the samples it needs, then sampled and averaged: 4² samples
        per pixel for small things, one for large ones, whose edges are soft enough by then.
        """
        x0, y0, x1, y1 = box
        corners = self.project(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], float))
        height, width = canvas.shape[:2]
        left, top = (max(0, math.floor(edge)) for edge in corners.min(axis=0))
        right = min(width, math.ceil(corners[:, 0].max()))
        bottom = min(height, math.ceil(corners[:, 1].max()))
        if right <= left or bottom <= top:
            return
        extent = max(right - left, bottom - top)
        fine = 4 if extent <= 40 else 2 if extent <= 130 else 1
        sides = np.linalg.norm(corners - np.roll(corners, -1, axis=0), axis=1) * fine
        columns, rows = math.ceil(max(sides[0], sides[2])), math.ceil(max(sides[1], sides[3]))
        columns, rows = (
            seen if 1.5 * seen < drawn else drawn
            for seen, drawn in zip((columns, rows), sprite.shape[1::-1], strict=True)
        )
        if (rows, columns) != sprite.shape[:2]:
            sprite = np.asarray(cv2.resize(sprite, (columns, rows), interpolation=cv2.INTER_AREA))
        to_plane = np.array([[(x1 - x0) / columns, 0, x0], [0, (y1 - y0) / rows, y0], [0, 0, 1]])
        to_samples = np.array([[fine, 0, -fine * left], [0, fine, -fine * top], [0, 0, 1]])
        matrix = _TO_INDEX @ to_samples @ self.matrix @ to_plane @ _FROM_INDEX
        size = ((right - left) * fine, (bottom - top) * fine)
        warped = cv2.warpPerspective(sprite, matrix, size, flags=cv2.INTER_LINEAR)
        over(
            canvas[top:bottom, left:right],
            np.asarray(cv2.resize(warped, (right - left, bottom - top), interpolation=cv2.INTER_AREA)),
        )


def over(canvas: Floats, sprite: Sprite) -> None:
    """Lay a sprite of its size over a canvas (h, w, 3) or another sprite (h, w, 4), in place.

    >>> canvas, white = np.full((1, 1, 3), 0.5, np.float32), np.full((1, 1, 4), 0.5, np.float32)
    >>> over(canvas, white)  # it covers half of the pixel
    >>> canvas.tolist()
    [[[0.75, 0.75, 0.75]]]
    """
    canvas *= cv2.merge([1 - sprite[..., 3]] * canvas.shape[2])
    canvas += sprite[..., : canvas.shape[2]]


def dim(light: Floats, factor: Floats) -> None:
    """Multiply light (h, w, 3 or 4), in place, by a factor (h, w); coverage stays.

    >>> light = np.full((1, 1, 3), 0.5, np.float32)
    >>> dim(light, np.full((1, 1), 0.5, np.float32))
    >>> light.tolist()
    [[[0.25, 0.25, 0.25]]]
    """
    # OpenCV makes the fourth channel, its opacity, 1. NumPy is slow where it repeats a number three times.
    light *= cv2.cvtColor(factor, cv2.COLOR_GRAY2RGB if light.shape[2] == 3 else cv2.COLOR_GRAY2RGBA)


def cut(sprite: Sprite, coverage: Floats) -> None:
    """Leave of a sprite, in place, what lies within a coverage (h, w).

    >>> sprite = np.ones((1, 2, 4), np.float32)
    >>> cut(sprite, np.array([[1.0, 0.0]], np.float32))
    >>> sprite[0, :, 3].tolist()
    [1.0, 0.0]
    """
    sprite *= cv2.merge([coverage] * 4)
