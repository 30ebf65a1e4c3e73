"""Whether a camera can take pictures under a plan's conditions: checked before a folder is made."""

from __future__ import annotations

from dataclasses import replace
from math import hypot

import torch

from blurnoise._core.checks import limited_motion
from blurnoise.optics.camera import Camera
from blurnoise_eval.datasets import PictureSet, check_cut
from blurnoise_eval.grid.conditions import SweepPlan


def check_plan(plan: SweepPlan, camera: Camera, pictures: PictureSet) -> None:
    """Raise ``ValueError`` for what of the plan does not go with the camera, or with the pictures.

    That is: targets that move alone without knowing where they are, a trajectory that is too short or needs a focal
    length, figures that the camera's lens does not take, and motion beyond the limits.
    """
    fastest: dict[str, tuple[float, float]] = {}  # by class, of targets that cross the view
    if plan.cuts:
        check_cut(pictures, plan.objects)
        for target in (target for picture in pictures for target in picture.targets or ()):
            if plan.objects.crosses(target.label):
                own = plan.objects.own_px_s(target.label, target.box_xyxy, camera, camera.field.size)
                fastest[target.label] = max(
                    fastest.get(target.label, own), own, key=lambda each: hypot(*each)
                )
    path = None
    if plan.path is not None:
        (stated, longest_s), readout_s = plan.path, camera.row_time_s * camera.height_px
        half_s = longest_s / 2 + (readout_s if camera.shutter == "global-reset" else readout_s / 2)
        path = stated.of(camera, camera.field.size, longest_s, plan.seed)
        path.window(-half_s, half_s)
    for at in plan.conditions():
        exposure = replace(at.exposure(camera, vehicle=plan.ego), trajectory=path)
        if "exposure_s" in at.automatic:
            exposure = replace(exposure, exposure_s=plan.longest_s)
        for label, own_px_s in fastest.items():
            plan.objects.check_crossing(label, own_px_s, exposure)
        if exposure.drives:
            height, width = camera.field.size
            edges = torch.tensor([(x, y) for x in (0.5, width / 2, width - 0.5) for y in (0.5, height - 0.5)])
            limited_motion("ego_speed_m_s: flow times exposure", exposure.displacements_px(edges))
