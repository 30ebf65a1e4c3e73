"""One picture under one condition, as a sweep or a run takes it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from blurnoise.camera import Camera
from blurnoise.camera.colour import PictureTone
from blurnoise_eval import default_tone
from blurnoise_eval.cameras import find
from blurnoise_eval.datasets import Image, Picture
from blurnoise_eval.plan.axes import axis
from blurnoise_eval.plan.conditions import Cell, Conditions
from blurnoise_eval.plan.plan import usual_plan
from blurnoise_eval.run.exposing import Frame, PictureScene, frames

if TYPE_CHECKING:
    from blurnoise_eval.run.run import Run


def expose(
    picture: Picture | Image,
    camera: str | Camera,
    *,
    seed: int = 0,
    run: Run | None = None,
    grey_anchor: str | None = None,
    picture_tone: PictureTone = "srgb",
    **conditions: float | str,
) -> Frame:
    """Take a picture as a sweep does: its ``image`` is (H, W, 3), uint8, RGB.

    picture: (H, W, 3), uint8 or uint16, RGB, or one of :mod:`blurnoise_eval.datasets`, whose targets can move.
    camera: a preset's name, a file, or a camera. seed: of the noise. run: with this run's grey anchor, tone curve,
    trajectory and vehicle; picture then is ``run.picture(NAME)``. grey_anchor: the part of any other picture that
    reflects 18 %; None: brightness is reflectance. picture_tone: its curve; "typical", as sweeps take photographs, is
    also that of a camera whose file has no tone. conditions: by the names of the axes (:data:`blurnoise_eval.AXES`)
    and in their units, such as ``exposure_s=0.01, illuminance_lux=50.0, gain_db="auto"``; what is left out is the
    camera's own, and without motion. Raises ``ValueError`` that names the condition.

    >>> import numpy as np
    >>> from blurnoise_eval import expose
    >>> grey = np.full((24, 32, 3), 118, np.uint8)  # 18 % reflectance
    >>> frame = expose(grey, "imx250", exposure_s=0.005, illuminance_lux=50.0, gain_db="auto")
    >>> frame.image.shape, 110 < float(frame.image.mean()) < 125  # as bright as it was
    ((24, 32, 3), True)
    """
    stated = {name: axis(name).checked((value,))[0] for name, value in conditions.items()}
    cell = Cell("exposed", 0, Conditions(**stated), seed)
    by = find(camera) if isinstance(camera, str) else camera
    if (picture_tone if run is None else run.setup.plan.picture_tone) == default_tone.NAME:
        _, by = default_tone.of_photographs(None, by)
    if run is not None:
        if not isinstance(picture, Picture):
            raise TypeError("picture: must be a picture of the run, run.picture(NAME)")
        if grey_anchor is not None:
            raise ValueError(
                f"grey_anchor = {grey_anchor!r}: is that of the run's plan; must not be given beside run"
            )
        return run.expose(run.scene(picture), cell, by)
    of = picture if isinstance(picture, Picture) else None
    image = picture.load() if isinstance(picture, Picture) else picture
    plan = replace(usual_plan(), grey_anchor=grey_anchor, picture_tone=picture_tone)
    return next(frames(PictureScene(image, plan, of), [cell], by))
