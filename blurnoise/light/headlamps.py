"""Headlamps: the light of low and high beam on a scene, and what retroreflective targets return of it to the camera.

Domain: m right of the vehicle's axis, up from the road and ahead of the lamps; degrees right and up of the direction
ahead, on a sphere with a vertical polar axis, as UN Regulation 149 measures; cd of one lamp, lux, cd/m2. Light of
headlamps is known to a factor of 2: lamps that are allowed differ by that much in what they stray above the cut-off.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, replace
from typing import Annotated, Literal, NamedTuple, cast

import numpy as np
import torch
from annotated_types import Ge, Gt, Le
from numpy.typing import ArrayLike
from torch import Tensor

from blurnoise._core.beams import BEAMS as BEAMS
from blurnoise._core.beams import Beam
from blurnoise._core.borders import Border
from blurnoise._core.checks import limited
from blurnoise._core.fields import Figure, check_fields
from blurnoise.blur.layer import Layer
from blurnoise.camera.spectra import Floats
from blurnoise.light.effect import LightEffect
from blurnoise.light.resolved import BeamLight, Number, Resolved
from blurnoise.light.sheeting import Sheeting, numbers

_FARTHEST_M = 1e6
_NEAREST_M = 0.1  # ahead of lamps, which are no points from nearer by


class Lit(NamedTuple):
    """Light of both lamps on points: illuminance E_h, lux, and the luminance L_r that sheeting returns, cd/m2.

    >>> person = Headlamps("low").onto(1.0, [0.25, 0.9, 1.4], 40.0)  # legs, hips and chest, in matte clothes
    >>> person.illuminance_lux.round(2).tolist(), person.luminance_cd_m2.tolist()
    ([21.44, 1.37, 0.31], [0.0, 0.0, 0.0])
    """

    illuminance_lux: Floats
    luminance_cd_m2: Floats


@dataclass(frozen=True)
class Headlamps:
    """A vehicle's two headlamps: a beam, mounted height_m above the road and apart_m from each other.

    output: a factor on the light, of dirty or stronger lamps. traffic: the side of the road that vehicles keep to, to
    which the low beam rises. Raises ``TypeError`` or ``ValueError`` naming the field and what is allowed.

    >>> Headlamps("low").intensity_cd([1.5, 0.0], [-1.5, 4.0]).round().tolist()  # on the road, above the cut-off
    [15696.0, 102.0]
    """

    beam: Beam = "low"
    height_m: Annotated[Figure, Gt(0), Le(5)] = 0.65
    apart_m: Annotated[Figure, Ge(0), Le(5)] = 1.2
    output: Annotated[Figure, Gt(0), Le(1000)] = 1.0
    traffic: Literal["right", "left"] = "right"

    def __post_init__(self) -> None:
        check_fields(self)

    def intensity_cd(self, right_deg: ArrayLike, up_deg: ArrayLike) -> Floats:
        """Luminous intensity of one lamp, cd, in directions; arrays that broadcast against each other.

        A formula of our own that keeps the limits of UN Regulation 149 (passing beam C, driving beam B) and of FMVSS
        108 (LB2V, UB2) but for four points, by up to 27 %, which tests/blurnoise/light/test_headlamp_limits.py names.
        The low beam ends at the cut-off, .57 degrees (1 %) below the lamps and rising by 15 degrees on the side of
        the road; beneath it there is a hot spot and a wide spread, above it stray light as that of a measured lamp.
        The high beam adds a spot straight ahead.
        """
        right = numbers("right_deg", right_deg, -180.0, 180.0)
        up = numbers("up_deg", up_deg, -90.0, 90.0)
        right = -right if self.traffic == "left" else right
        cut = np.clip(_CUT_DEG + _RISE * np.maximum(right, 0.0), _CUT_DEG, _HIGHEST_CUT_DEG)
        depth = cut - up
        below = np.maximum(depth, 0.0)
        spot = 18000.0 * np.exp(-(((right - 1.5) / 4.5) ** 2) / 2 - below / 4.0)
        spread = 3000.0 * np.exp(-((right / 14.0) ** 2) / 2 - below / 5.0)
        stray = 510.0 / (1.0 + np.maximum(up, 0.0)) * np.exp(-((right / 20.0) ** 2) / 2)
        intensity = (spot + spread) / (1.0 + np.exp(-np.maximum(depth, -20.0) / _EDGE_DEG)) + stray
        if self.beam == "high":
            intensity += 40000.0 * np.exp(-((right / 3.0) ** 2 + (up / 1.5) ** 2) / 2)
            intensity += 3000.0 * np.exp(-((right / 12.0) ** 2 + (up / 3.0) ** 2) / 2)
        return np.asarray(self.output * intensity)

    def onto(
        self,
        right_m: ArrayLike,
        up_m: ArrayLike,
        ahead_m: ArrayLike,
        sheeting: Sheeting | None = None,
        camera_height_m: float = 1.5,
    ) -> Lit:
        """Light of both lamps on points of a scene, for a camera above the middle between the lamps.

        Points: arrays that broadcast against each other, at least .1 m ahead; their surface faces the lamps.
        E_h = sum of I / r^2, and L_r = sum of R_A(alpha) I / r^2, where alpha is the angle at the point between lamp
        and camera. Without sheeting the luminance is 0. Raises ``TypeError`` or ``ValueError`` naming the argument.

        >>> from blurnoise.light.sheeting import SHEETINGS
        >>> sign = Headlamps("low").onto(3.0, 2.2, 50.0, SHEETINGS["III"])
        >>> round(float(sign.illuminance_lux), 4), round(float(sign.luminance_cd_m2), 3)
        (0.1443, 2.178)
        """
        x = numbers("right_m", right_m, -_FARTHEST_M, _FARTHEST_M)
        y = numbers("up_m", up_m, -_FARTHEST_M, _FARTHEST_M)
        z = numbers("ahead_m", ahead_m, _NEAREST_M, _FARTHEST_M)
        camera = _Away.of(x, y - limited("camera_height_m", camera_height_m), z)
        lux, luminance = np.zeros(np.broadcast_shapes(x.shape, y.shape, z.shape)), np.zeros(())
        for side in (-1, 1):
            lamp = _Away.of(x - side * self.apart_m / 2, y - self.height_m, z)
            of_lamp = self.intensity_cd(*lamp.direction_deg) / lamp.squared_m2
            lux = lux + of_lamp
            if sheeting is not None:
                luminance = luminance + of_lamp * sheeting.at(lamp.angle_deg(camera))
        return Lit(lux, np.broadcast_to(luminance, lux.shape))


_CUT_DEG = -0.57  # 1 % down
_RISE = float(np.tan(np.radians(15.0)))
_HIGHEST_CUT_DEG = 0.1
_EDGE_DEG = 0.12  # of the cut-off: from a quarter to three quarters of the light within .26 degrees


class _Away(NamedTuple):
    """Vectors from a lamp or a camera to points, m right, up and ahead."""

    x: Floats
    y: Floats
    z: Floats

    @classmethod
    def of(cls, *axes: Floats) -> _Away:
        return cls(*np.broadcast_arrays(*axes))

    @property
    def squared_m2(self) -> Floats:
        return np.asarray(self.x**2 + self.y**2 + self.z**2)

    @property
    def direction_deg(self) -> tuple[Floats, Floats]:
        across, up = np.arctan2(self.x, self.z), np.arctan2(self.y, np.hypot(self.x, self.z))
        return np.degrees(across), np.degrees(up)

    def angle_deg(self, other: _Away) -> Floats:
        """Angle between the vectors, exact where it is small, as an arc cosine is not."""
        (x, y, z), (u, v, w) = self, other  # by hand, as np.cross takes ten times as long
        across = np.sqrt((y * w - z * v) ** 2 + (z * u - x * w) ** 2 + (x * v - y * u) ** 2)
        return np.asarray(np.degrees(np.arctan2(across, x * u + y * v + z * w)))


class HeadlampLight(LightEffect):
    """The light of a beam on the scene, which the exposure's illuminance lights already.

    A surface of light l under E lux has l (1 + X / E) where headlamps add X lux, whatever it reflects. X of
    retroreflective targets stands for what they return: E_h + pi L_r / w gives a white of reflectance w the luminance
    L_r beside that of the matte white.

    >>> import torch
    >>> from blurnoise import Camera, Exposure, Scene, plan
    >>> scene = Scene(torch.full((1, 1, 4, 6), 0.2), headlamp_lux={"low": torch.full((1, 1, 4, 6), 9.0)})
    >>> plan(Exposure(Camera.preset("imx250"), 0.01, 1.0, headlamp="low"), scene).stages[0].how
    'low beam, X 9 to 9 lux'
    """

    name = "headlamps"
    essential = True
    of_scene = True

    def acts(self, at: Resolved[Number]) -> bool:
        return at.headlamp is not None

    def bound(self, at: Resolved[float]) -> float:
        """RMS of the light that a white picture lacks without them, relative to the brightest white."""
        if at.headlamp is None:
            return 0.0
        ((_, most, rms),) = at.headlamp.ranges_lux
        return rms / (at.illuminance_lux + most)

    def apply(self, light: Tensor, at: Resolved[Tensor], border: Border) -> Tensor:
        return light * (1 + _ratio(at).to(light))

    def apply_to_layer(self, layer: Layer, like: Tensor, at: Resolved[Tensor], border: Border) -> Layer:
        return replace(layer, light=layer.light * (1 + _ratio(at, layer).to(layer.light)))

    def how(self, at: Resolved[float]) -> str:
        if at.headlamp is None:
            return "none here"
        ((least, most, _),) = at.headlamp.ranges_lux
        return f"{at.headlamp.beam} beam, X {least:.3g} to {most:.3g} lux"

    def key(self, at: Resolved[float]) -> Hashable:
        # Exposures that share light are of one scene, which has one plane for each beam.
        return (at.headlamp, at.illuminance_lux) if at.headlamp else None


def ambient_share(at: Resolved[Tensor], layer: Layer | None = None) -> Tensor | float:
    """Share of other light than headlamps', of pictures (B, 1, H, W), or of a layer (1, h, w) of the only one.

    >>> from blurnoise import Camera
    >>> lit = BeamLight("low", ((3.0, 3.0, 3.0),), torch.full((1, 1, 1, 1), 3.0))
    >>> one = torch.ones(1)
    >>> ambient_share(Resolved(Camera.preset("imx250"), one, one, one, illuminance_lux=one, headlamp=lit)).item()
    0.25
    """
    return 1.0 if at.headlamp is None else 1 / (1 + _ratio(at, layer))


def _ratio(at: Resolved[Tensor], layer: Layer | None = None) -> Tensor:
    """X / E: of pictures (B, 1, H, W), or of a layer (1, h, w) of the only one."""
    lit, lux = cast(BeamLight, at.headlamp), at.illuminance_lux
    if layer is not None:
        return layer.headlamp_lux[lit.beam] / lux
    ratio: Tensor = lit.lux / torch.as_tensor(lux).view(-1, 1, 1, 1)
    return ratio


HEADLAMPS = HeadlampLight()
