"""Digital numbers of pictures in one call: :func:`simulate`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import torch
from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.borders import Border
from blurnoise._core.checks import Numbers, an_instance
from blurnoise._core.threads import same_bits
from blurnoise.blur.layer import Layers
from blurnoise.camera import Camera
from blurnoise.camera.colour import PictureTone
from blurnoise.camera.spectra import Curve
from blurnoise.motion.trajectory import Trajectory
from blurnoise.scene.exposure import Exposure
from blurnoise.scene.metering import anchored
from blurnoise.scene.plan import TOLERANCE_DN
from blurnoise.scene.scene import Scene, scene_reflectance
from blurnoise.scene.take import TakeOptions, take
from blurnoise.sensor.readout import Fidelity


@same_bits
def simulate(
    image: Tensor,
    camera: Camera,
    *,
    exposure_s: Numbers,
    illuminance_lux: Numbers,
    velocity_px_s: Tensor | Iterable[float] = (0.0, 0.0),
    trajectory: Trajectory | Sequence[Trajectory | None] | None = None,
    temperature_c: Numbers = 25.0,
    encoding: PictureTone = "srgb",
    grey_anchor: str | None = None,
    illuminant: str | Curve = "D55",
    border: Border = "reflect",
    pattern_seed: int = 0,
    generator: rng.Randomness = None,
    fidelity: Fidelity = "auto",
    tolerance_dn: float = TOLERANCE_DN,
    noise: bool = True,
    quantised: bool = True,
    layers: Layers = (),
    headlamp_lux: Tensor | None = None,
) -> Tensor:
    """Expose ``image`` with ``camera``; returns digital numbers, integral values, of the same shape.

    For a camera with a mosaic, or one plane of light, the result is the raw plane (B, 1, H, W); C must be 1 or 3. For
    a camera of several captures a frame for each of them, (captures, B, C, H, W).

    >>> import torch
    >>> from blurnoise import Camera
    >>> grey = torch.full((1, 1, 2, 3), 0.5)
    >>> simulate(grey, Camera.preset("imx250"), exposure_s=0.01, illuminance_lux=50.0, generator=[1]).shape
    torch.Size([1, 1, 2, 3])

    image: (B, C, H, W) in [0, 1], the scene's reflectance, 1 is white. encoding: its tone curve, "srgb", "linear",
    "filmic", "typical" or points (light, value), see :mod:`blurnoise.camera.colour`. exposure_s
    (s) and illuminance_lux (lux on the scene) >= 0, temperature_c (degC): a number or one per image.
    grey_anchor: "mean", "pNN" or "x0,y0,x1,y1": the part of each picture that reflects 18 %; None: brightness is
    reflectance (:mod:`blurnoise.scene.metering`). Light above white is kept. illuminant: the light's spectrum.
    velocity_px_s: (2,) or (B, 2), motion in the image, x right, y down; or of each pixel, (2, H, W) or (B, 2, H, W),
    as :mod:`blurnoise.motion.ego` computes it for a moving camera.
    trajectory: a :class:`blurnoise.Trajectory` for all images, or one or None for each: a path centred on
    mid-exposure, added to the velocity. It has no gradient (that of exposure_s is right to 1 %); use
    :func:`.convolution.path_blur` for one.
    layers: objects in front of ``image`` with motion of their own, in linear light, each a :class:`blurnoise.Layer`;
    the same for all pictures, or a sequence for each. ``velocity_px_s`` is then the velocity of the background.
    headlamp_lux: what headlamps add to illuminance_lux on each pixel, lux, (B, 1, H, W) or (1, 1, H, W); layers have
    their own, ``Layer(..., headlamp_lux={"low": ...})``. :meth:`.Headlamps.onto` reckons it of a scene's geometry.
    pattern_seed: selects the specimen of the camera (its fixed pattern). generator: a ``torch.Generator``, one
    seed per image, or None for torch's default generator; image i depends on its own seed alone.

    Order: linear light, :data:`blurnoise.light.effects.EFFECTS` (lens, motion), the colour filters, then
    :data:`blurnoise.sensor.stages.STAGES` (shot, dark and read noise, full well, gain, rounding, converter limits).

    fidelity: "full" models everything; "auto" models the parts that :func:`blurnoise.plan` keeps for each image
    within ``tolerance_dn`` (DN RMS). noise: False returns the mean frame. quantised: False omits rounding.
    Gradients reach image, exposure, illuminance, velocity and temperature; they are of the full model, and the
    numbers are the same with them and without.
    ``torch.compile`` breaks its graph here and runs it uncompiled, with the same result.
    Raises ``TypeError`` or ``ValueError`` naming the argument, its value and what is allowed: at most 3600 s,
    1e9 lux, 1e7 px/s, and 1e5 px of motion during the exposure.
    """
    an_instance("camera", camera, Camera)
    scene = Scene(
        anchored(scene_reflectance(image, encoding), grey_anchor),
        layers=layers,
        border=border,
        headlamp_lux={} if headlamp_lux is None else {"low": headlamp_lux},
    )
    exposure: Exposure[Any] = Exposure(
        camera,
        exposure_s,
        illuminance_lux,
        velocity_px_s=velocity_px_s,
        temperature_c=temperature_c,
        trajectory=trajectory,
        illuminant=illuminant,
        headlamp="off" if headlamp_lux is None else "low",  # a name for the one beam there is
        seed=rng.item_seeds(generator, len(image)),
    )
    options = TakeOptions(
        wanted=("raw",),
        fidelity=fidelity,
        tolerance_dn=tolerance_dn,
        noise=noise,
        quantised=quantised,
        pattern_seed=pattern_seed,
    )
    raw = take(scene, exposure, options).raw
    return raw[0] if len(raw) == 1 else torch.stack(raw)
