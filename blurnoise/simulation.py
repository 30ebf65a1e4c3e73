"""Simulation of one exposure: pictures as a camera would take them, from reflectance to digital numbers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.borders import Border
from blurnoise._core.checks import Numbers
from blurnoise._core.uncompiled import uncompiled
from blurnoise.camera import Camera
from blurnoise.encoding import Encoding
from blurnoise.error_budget import TOLERANCE_DN
from blurnoise.exposure import ExposedScene, anchored, scene_reflectance
from blurnoise.layers import Layers
from blurnoise.sensor.readout import Fidelity
from blurnoise.spectra import Curve
from blurnoise.trajectory import Trajectory


@uncompiled
def simulate(
    image: Tensor,
    camera: Camera,
    *,
    exposure_s: Numbers,
    illuminance_lux: Numbers,
    velocity_px_s: Tensor | Iterable[float] = (0.0, 0.0),
    trajectory: Trajectory | Sequence[Trajectory | None] | None = None,
    temperature_c: Numbers = 25.0,
    encoding: Encoding = "srgb",
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
) -> Tensor:
    """Expose ``image`` with ``camera``; returns digital numbers, integral values, of the same shape.

    Of a camera with a mosaic, or of one plane of light, it is the raw plane: (B, 1, H, W), C being 1 or 3.

    image: (B, C, H, W) in [0, 1], the scene's reflectance, sRGB-coded or "linear"; 1 is white. exposure_s
    (s) and illuminance_lux (lux on the scene) >= 0, temperature_c (degC): a number or one per image.
    grey_anchor: "mean", "pNN" or "x0,y0,x1,y1": what of each picture is 18 % reflectance instead of its brightness
    being reflectance (:mod:`blurnoise.grey_anchor`); more than white stays.
    velocity_px_s: (2,) or (B, 2), motion in the image, x right, y down; or of each pixel, (2, H, W) or (B, 2, H, W),
    as :mod:`blurnoise.ego_motion` gives it for a moving camera. illuminant: the light's spectrum.
    trajectory: :class:`blurnoise.Trajectory`, one for all or one, or None, per image: a path about mid-exposure,
    added to the velocity, whose gradient it stops; :func:`blurnoise.path_blur.polyline_blur` has one of its own.
    pattern_seed: which specimen of the camera (its fixed pattern). generator: a ``torch.Generator``, one
    seed per image, or None for torch's default generator; image i depends on its own seed alone.

    layers: objects that move for themselves before ``image``, in linear light, each a :class:`blurnoise.Layer` with
    its velocity; those of all pictures, or a sequence for each. ``velocity_px_s`` is then the background's.

    Order: linear light, then :data:`blurnoise.light.effects.EFFECTS` (lens, motion), the colour filters
    (:mod:`blurnoise.sensor.mosaic`), then
    :data:`blurnoise.sensor.stages.STAGES` (light level, shot, dark and read noise, full well, gain, black level,
    rounding, converter limits).

    fidelity: "full" models everything, "auto" what :func:`blurnoise.plan` keeps of it for each image
    within ``tolerance_dn`` (DN RMS). noise: without it, the mean frame. quantised: without it, before rounding.
    Gradients reach image, exposure, illuminance, velocity and temperature; with them, everything is modelled.
    ``torch.compile`` breaks its graph here and runs it uncompiled, with the same result.
    Raises ``TypeError`` or ``ValueError`` naming the argument, its value and what is allowed: at most 3600 s,
    1e9 lux, 1e7 px/s, and 1e5 px of motion during the exposure.
    """
    scene = ExposedScene(
        anchored(scene_reflectance(image, encoding), grey_anchor),
        border=border,
        illuminant=illuminant,
        pattern_seed=pattern_seed,
        fidelity=fidelity,
        tolerance_dn=tolerance_dn,
        layers=layers,
    )
    return scene.expose(
        camera,
        exposure_s=exposure_s,
        illuminance_lux=illuminance_lux,
        velocity_px_s=velocity_px_s,
        trajectory=trajectory,
        temperature_c=temperature_c,
        generator=generator,
        noise=noise,
        quantised=quantised,
    )
