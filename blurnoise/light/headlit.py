"""Headlit targets: from labelled boxes and the camera to the light that headlamps add to a picture, lux.

A photograph says neither how far its targets are nor where the road is. The size of a target's class does: a stop
sign of .762 m that is 32 px wide before a lens of 1108 px stands 26 m away, and its lower edge at the height at which
such signs are mounted. From there the light of the lamps is known, by rows, since a low beam lights legs 40 times as
much as a chest. A target adds

    X = E_h + pi L_r / w,

E_h the illuminance by both lamps, L_r the luminance that its sheeting returns, and w the target's white in the
picture: its 95th percentile of luminance, so that the white gets L_r however the photograph was exposed, and the
other colours their share.

Domain: px from the picture's corner, boxes (x0, y0, x1, y1); m right of the vehicle's axis, up from the road and
ahead; lux of light on white, whose luminance is lux / pi.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core.checks import in_range, one_of
from blurnoise._core.luminance import LUMINANCE
from blurnoise.camera import Camera
from blurnoise.camera.spectra import Floats
from blurnoise.light.headlamps import Headlamps
from blurnoise.light.road_objects import RoadObject, road_object, sheeting_of
from blurnoise.light.sheeting import Sheeting
from blurnoise.motion.ego import USUAL_VEHICLE, Vehicle

Background = Literal["dark", "lit"]
BACKGROUNDS: tuple[Background, ...] = ("dark", "lit")
NEAREST_M = 8.0
"""Nearer targets are lit as at this distance: close-ups of photographs would stand between the lamps."""
FARTHEST_M = 1e5
_LEAST_WHITE = 0.02  # of a target: a darker one is a silhouette, and shows no white
_WHITE = 0.95
_MOST_PX = 4096  # that a percentile is taken of
_FLATTEST = 4.0  # ratio of the sides of a box, where one of them alone has a known size
_LEAST_PX = 1.0
_EVERY_PX = 4  # columns of a wall that are reckoned, between which light is straight: the beam is wide

Alpha = NDArray[np.float32]


class Outline(NamedTuple):
    """A labelled target in a picture: class, box (x0, y0, x1, y1), px, and where it is known its matte.

    alpha: (h, w), the share of each pixel that it covers, from the pixel place_px = (left, top) on; None: all of the
    box. A matte may be that of the box where ``outlined`` is false.

    >>> Outline("person", (10.0, 20.0, 30.0, 80.0)).outlined
    False
    """

    label: str
    box_xyxy: tuple[float, float, float, float]
    alpha: Alpha | None = None
    place_px: tuple[int, int] = (0, 0)
    outlined: bool = False


class Standing(NamedTuple):
    """Where a target stands: m right of the vehicle's axis, ahead, and up in a row y: base_m + (foot_px - y) row_m.

    wall_row_m: a row of what else stands at its distance, which differs where that does not follow from its size.
    measured_m: its distance by its size, before it is limited.

    >>> at = Standing(3.0, 50.0, base_m=1.8, foot_px=360.0, row_m=0.05, wall_row_m=0.05, measured_m=50.0)
    >>> at.up_m(np.array([360.0, 350.0, 500.0])).tolist()
    [1.8, 2.3, 0.0]
    """

    right_m: float
    ahead_m: float
    base_m: float
    foot_px: float
    row_m: float
    wall_row_m: float
    measured_m: float

    def up_m(self, rows_px: Floats) -> Floats:
        """Height of rows above the road, m; what a box shows below the road is at its level."""
        return np.maximum(self.base_m + (self.foot_px - rows_px) * self.row_m, 0.0)


@dataclass(frozen=True)
class RoadView:
    """How a camera on a vehicle sees targets: what fixes their places on the road and what covers them.

    own: classes beside those of the table, by their plain names, or in place of them. sheeting: of the classes that
    have one, in place of theirs, as of :class:`RoadObject`; "none": all are matt. distance_m: of all targets, in
    place of that by their size. background: "dark" receives no light of the lamps; "lit": it is a wall at the
    distance of the median target, matt. Raises ``TypeError`` or ``ValueError`` naming the field.

    >>> view = RoadView(Camera.preset("imx250"), sheeting="XI")
    >>> view.material(RoadObject(width_m=0.6, sheeting="III")).name, view.material(RoadObject(height_m=1.7))
    ('XI', None)
    """

    camera: Camera
    vehicle: Vehicle = USUAL_VEHICLE
    own: Mapping[str, RoadObject] = field(default_factory=dict)
    sheeting: str | None = None
    distance_m: float | None = None
    background: Background = "dark"

    def __post_init__(self) -> None:
        one_of("background", self.background, BACKGROUNDS)
        sheeting_of(self.sheeting)
        if self.distance_m is not None:
            in_range("distance_m", self.distance_m, NEAREST_M / 8, FARTHEST_M)

    def material(self, of: RoadObject) -> Sheeting | None:
        """The sheeting of a class."""
        own = of.material
        return own if own is None or self.sheeting is None else sheeting_of(self.sheeting)

    def directions(self, points: Floats, size: tuple[int, int]) -> Floats:
        """Directions (2, ...), X/Z and Y/Z, of points (2, ...) in a picture (H, W), px from its corner.

        By the camera's own lens, unless the vehicle states another; NaN behind the camera.
        """
        if self.vehicle.hfov_deg is None and self.vehicle.lens is None:
            return self.camera.field.directions(points - 0.5, size)
        rays = self.vehicle.view(self.camera, size).rays(points - 0.5)
        return np.asarray(rays[:2] / np.where(rays[2] > 0, rays[2], np.nan))

    def standing(self, box_xyxy: Sequence[float], of: RoadObject, size: tuple[int, int]) -> Standing | None:
        """Where a target with this box stands in a picture (H, W); None outside of the picture.

        d = size_m / (difference of directions), for a pinhole f size_m / size_px. Where width and height are known
        the nearer one holds: what turns away or leaves the picture looks smaller, never larger.

        >>> camera = Camera.preset("imx250").with_figures(width_px=1280, height_px=720, hfov_deg=60.0)
        >>> at = RoadView(camera).standing((640, 350, 656.9, 366.9), road_object("stop sign"), (720, 1280))
        >>> round(at.ahead_m, 1), round(float(at.up_m(np.array([366.9, 350.0]))[1]), 2)
        (50.0, 2.56)
        """
        x0, y0, x1, y1 = box_xyxy
        x0, x1 = max(x0, 0.0), min(x1, float(size[1]))
        y0, y1 = max(y0, 0.0), min(y1, float(size[0]))
        if not (x1 > x0 and y1 > y0):
            return None
        x1, y1 = max(x1, x0 + _LEAST_PX), max(y1, y0 + _LEAST_PX)
        x, y = (x0 + x1) / 2, (y0 + y1) / 2
        seen = self.directions(np.array([[x, x0, x1, x, x], [y, y, y, y0, y1]]), size)
        if not np.isfinite(seen).all():
            return None
        across, down = float(seen[0, 2] - seen[0, 1]), float(seen[1, 4] - seen[1, 3])
        row_slope = down / (y1 - y0)
        wide, high = (of.width_m, across), (of.height_m, down)
        if of.width_m is None:
            high = of.height_m, max(down, across / _FLATTEST)
        elif of.height_m is None:
            wide = of.width_m, max(across, down / _FLATTEST)
        by_size = min(length / slope for length, slope in (wide, high) if length is not None and slope > 0)
        limited_m = min(max(by_size, NEAREST_M), FARTHEST_M)
        depth = limited_m if self.distance_m is None else self.distance_m
        towards = np.array([seen[0, 0], seen[1, 0], 1.0])
        down_axis, ahead_axis = self.vehicle.down, self.vehicle.ahead
        right_axis = np.cross(down_axis, ahead_axis)
        ahead = depth * float(towards @ ahead_axis)
        if ahead <= 1.0:  # beside the vehicle, where no lamp shines
            return None
        base, foot, row_m = of.base_m, y1, by_size * row_slope
        if base is None:
            base, foot, row_m = (
                self.vehicle.height_m - depth * float(towards @ down_axis),
                y,
                depth * row_slope,
            )
        right = depth * float(towards @ right_axis)
        return Standing(right, ahead, base, float(foot), float(row_m), float(depth * row_slope), by_size)


@dataclass(frozen=True)
class HeadlitTarget:
    """A target in the light of headlamps. outline: its place in the picture; white: w.

    illuminance_lux: E_h, luminance_cd_m2: L_r of its white, observation_deg: the angle between lamps and camera, at
    the middle of the target. nearer: it is lit as at 8 m. cut_off: its box reaches a side of the picture, so that it
    may be nearer than its size says.

    >>> outline = Outline("stop sign", (600.0, 352.0, 617.0, 369.0))
    >>> row_m = 0.762 / 17
    >>> at = Standing(3.0, 50.0, 1.819, foot_px=369.0, row_m=row_m, wall_row_m=row_m, measured_m=50.0)
    >>> sign = HeadlitTarget(outline, at, Headlamps("low"), sheeting_of("III"), 1.5, 0.341, False, False)
    >>> round(sign.illuminance_lux, 4), round(sign.luminance_cd_m2, 3), round(sign.observation_deg, 2)
    (0.1443, 2.178, 1.19)
    """

    outline: Outline
    standing: Standing
    lamps: Headlamps
    material: Sheeting | None
    camera_height_m: float
    white: float
    nearer: bool
    cut_off: bool

    def lux(self, top_px: int, rows: int) -> Floats:
        """X of rows of pixels from ``top_px`` on, (rows,)."""
        lit = self._at(top_px + 0.5 + np.arange(rows, dtype=np.float64))
        return np.asarray(lit[0] + math.pi * lit[1] / self.white)

    @property
    def distance_m(self) -> float:
        """Distance ahead."""
        return self.standing.ahead_m

    @property
    def illuminance_lux(self) -> float:
        """E_h in the middle."""
        return float(self._at(self._middle)[0][0])

    @property
    def luminance_cd_m2(self) -> float:
        """L_r in the middle."""
        return float(self._at(self._middle)[1][0])

    @property
    def observation_deg(self) -> float:
        """Mean angle at the target between the camera and each of the lamps."""
        at = self.standing
        place_m = at.right_m, float(at.up_m(self._middle)[0]), at.ahead_m
        return observation_deg(self.lamps, place_m, self.camera_height_m)

    @property
    def _middle(self) -> Floats:
        return np.array([(self.outline.box_xyxy[1] + self.outline.box_xyxy[3]) / 2])

    def _at(self, rows_px: Floats) -> tuple[Floats, Floats]:
        at = self.standing
        return self.lamps.onto(at.right_m, at.up_m(rows_px), at.ahead_m, self.material, self.camera_height_m)


@dataclass(frozen=True)
class HeadlitPicture:
    """A picture's targets in the light of headlamps, in the order of their labels; None: no light is known of it.

    wall: X (H, W) of the background; None: it receives no light of the lamps.

    >>> HeadlitPicture((2, 3), targets=(None,)).plane().shape
    torch.Size([1, 1, 2, 3])
    """

    size: tuple[int, int]
    targets: tuple[HeadlitTarget | None, ...]
    wall: Floats | None = None

    def plane(self, but: Sequence[int] = ()) -> Tensor:
        """X of the whole picture, (1, 1, H, W), lux. but: the places of targets that are left out.

        Of targets that overlap, the one whose box ends further down is in front.
        """
        found = np.zeros(self.size, np.float32) if self.wall is None else self.wall.astype(np.float32)
        lit = [each for place, each in enumerate(self.targets) if each is not None and place not in but]
        for target in sorted(lit, key=lambda each: each.outline.box_xyxy[3]):
            (left, top), alpha = target.outline.place_px, _alpha(target.outline, self.size)
            rows, columns = slice(top, top + alpha.shape[0]), slice(left, left + alpha.shape[1])
            x = target.lux(top, alpha.shape[0]).astype(np.float32)[:, None]
            found[rows, columns] += alpha * (x - found[rows, columns])
        return torch.from_numpy(found)[None, None]


def headlit(
    light: Tensor, targets: Sequence[Outline | None], view: RoadView, lamps: Headlamps
) -> HeadlitPicture:
    """The targets of a picture, light (1, C, H, W), in the light of headlamps.

    Targets of unknown classes, those outside of the picture, and None receive none, as no distance of them is known.

    >>> camera = Camera.preset("imx250").with_figures(width_px=1280, height_px=720, hfov_deg=60.0)
    >>> sign = Outline("stop sign", (698.06, 335.94, 714.96, 352.84))
    >>> picture = headlit(torch.full((1, 3, 720, 1280), 0.341), [sign], RoadView(camera), Headlamps("low"))
    >>> picture.plane()[0, 0, 344, 706].round().item()
    20.0
    """
    size = (light.shape[-2], light.shape[-1])
    found = tuple(None if each is None else _headlit(light, each, view, lamps) for each in targets)
    return HeadlitPicture(size, found, _wall(found, view, lamps, size))


def _headlit(light: Tensor, outline: Outline, view: RoadView, lamps: Headlamps) -> HeadlitTarget | None:
    of, size = road_object(outline.label, view.own), (light.shape[-2], light.shape[-1])
    standing = None if of is None else view.standing(outline.box_xyxy, of, size)
    if of is None or standing is None or (outline.alpha is not None and not outline.alpha.size):
        return None
    outline = outline if outline.alpha is not None else _of_box(outline, size)
    material = view.material(of)
    x0, y0, x1, y1 = outline.box_xyxy
    return HeadlitTarget(
        outline,
        standing,
        lamps,
        material,
        view.vehicle.height_m,
        _white(light, outline),
        nearer=view.distance_m is None and standing.measured_m < NEAREST_M,
        cut_off=x0 <= 1 or y0 <= 1 or x1 >= size[1] - 1 or y1 >= size[0] - 1,
    )


def observation_deg(lamps: Headlamps, place_m: tuple[float, float, float], camera_height_m: float) -> float:
    """Mean angle between the camera and each of the lamps, as a place sees them, m right, up and ahead.

    >>> round(observation_deg(Headlamps("low"), (3.0, 2.2, 50.0), 1.5), 3)
    1.189
    """
    right, up, ahead = place_m
    camera = np.array([right, up - camera_height_m, ahead])
    angles = []
    for side in (-1, 1):
        lamp = np.array([right - side * lamps.apart_m / 2, up - lamps.height_m, ahead])
        angles.append(math.atan2(float(np.linalg.norm(np.cross(lamp, camera))), float(lamp @ camera)))
    return math.degrees(sum(angles) / 2)


def _of_box(outline: Outline, size: tuple[int, int]) -> Outline:
    """The target with the matte of its box: the area of each pixel that the box covers."""
    shares, firsts = [], []
    for low, high, most in zip(outline.box_xyxy[:2], outline.box_xyxy[2:], size[::-1], strict=True):
        first, last = max(math.floor(low), 0), min(math.ceil(high), most)
        pixels = np.arange(first, max(last, first + 1))
        shares.append(np.clip(np.minimum(high, pixels + 1) - np.maximum(low, pixels), 0, 1))
        firsts.append(first)
    across, down = shares
    alpha = np.asarray(down[:, None] * across, np.float32)
    return outline._replace(alpha=alpha, place_px=(firsts[0], firsts[1]))


def _alpha(outline: Outline, size: tuple[int, int]) -> Alpha:
    return outline.alpha if outline.alpha is not None else np.zeros((0, 0), np.float32)


def _white(light: Tensor, outline: Outline) -> float:
    """w of a target. Of a box without outline only the ellipse inside counts: its corners may show the sky."""
    alpha, (left, top) = _alpha(outline, (0, 0)), outline.place_px
    inside = alpha > 0.5
    if not outline.outlined:
        down, across = (np.linspace(-1, 1, count + 2)[1:-1] ** 2 for count in alpha.shape)
        inside &= down[:, None] + across <= 1
    if not inside.any():
        inside = alpha >= alpha.max()
    part = light.detach()[0, :, top : top + alpha.shape[0], left : left + alpha.shape[1]].cpu().numpy()
    step = max(1, math.isqrt(inside.size // _MOST_PX))
    some = inside[::step, ::step] if inside[::step, ::step].any() else inside
    seen = part[:, ::step, ::step][:, some] if some is not inside else part[:, inside]
    luminance = np.asarray(LUMINANCE, np.float32) @ seen if len(seen) == 3 else seen.mean(0)
    place = min(len(luminance) - 1, int(_WHITE * len(luminance)))
    return max(float(np.partition(luminance, place)[place]), _LEAST_WHITE)


def _wall(
    targets: Sequence[HeadlitTarget | None], view: RoadView, lamps: Headlamps, size: tuple[int, int]
) -> Floats | None:
    """X (H, W) of a wall at the median target's distance, on the road on which that target stands."""
    known = sorted((each for each in targets if each is not None), key=lambda each: each.distance_m)
    if view.background == "dark" or not known:
        return None
    at = known[(len(known) - 1) // 2].standing
    some = np.unique(np.append(np.arange(0, size[1], _EVERY_PX), size[1] - 1))
    across = view.directions(np.stack([some + 0.5, np.full(len(some), size[0] / 2)]), size)[0]
    right = np.clip(np.nan_to_num(across * at.ahead_m), -FARTHEST_M, FARTHEST_M)
    up = at._replace(row_m=at.wall_row_m).up_m(np.arange(size[0], dtype=np.float64) + 0.5)
    lit = lamps.onto(right[None], up[:, None], at.ahead_m, None, view.vehicle.height_m).illuminance_lux
    columns = np.arange(size[1])
    after = np.searchsorted(some, columns).clip(1, max(1, len(some) - 1))
    if len(some) == 1:
        return lit
    share = (columns - some[after - 1]) / (some[after] - some[after - 1])
    return np.asarray(lit[:, after - 1] * (1 - share) + lit[:, after] * share)
