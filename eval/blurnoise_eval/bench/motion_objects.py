"""Jobs of the bench of moving things: a sign that moves before a background, at rest or in motion itself."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from blurnoise import Layer, expose_layers, motion_blur
from blurnoise.blur.layered import at_rest
from blurnoise_eval.bench import motion_scenes, motion_truth
from blurnoise_eval.bench.motion_job import EXPOSURE_S, OURS, Call, Case, Extent, Job, Method, Picture
from blurnoise_eval.bench.motion_peers import FRAMES, displaced, mean_of_frames

_ANGLE_DEG = 17.0
_WHOLE_PX = 1e5  # of a step: the exposure is one part, which is the matte formula
_ROOM_PX = 8
Vector = tuple[float, float]


@dataclass(frozen=True)
class Objects(Case):
    """A sign before a background (1, C, H, W), and what they move during the exposure, px."""

    background: Tensor
    layer: Layer
    moved_px: Vector
    background_px: Vector

    @property
    def background_px_s(self) -> Vector:
        """Velocity of the background."""
        x, y = self.background_px
        return x / EXPOSURE_S, y / EXPOSURE_S


def _case(extent: Extent, *, moving: bool) -> Objects:
    light, alpha = motion_scenes.sign(extent.sign_px)
    background = motion_scenes.leaves(extent.height_px, extent.width_px)
    angle = math.radians(_ANGLE_DEG)
    moved = extent.moved_px * math.cos(angle), extent.moved_px * math.sin(angle)
    behind = (-extent.moved_px / 2, extent.moved_px / 8) if moving else (0.0, 0.0)
    side = len(alpha)
    top, left = (extent.height_px - side) // 2, (extent.width_px - side) // 2
    passed = math.ceil(extent.moved_px / 2) + _ROOM_PX
    judged = slice(top - passed, top + side + passed), slice(left - passed, left + side + passed)
    wide = 2 * passed + motion_truth.reach(np.array([extent.moved_px]))  # with all that moves into it
    around = [slice(max(0, each.start - wide), each.stop + wide) for each in judged]
    canvas = np.zeros((4, *background.shape[1:]))
    canvas[:3, top : top + side, left : left + side] = light
    canvas[3, top : top + side, left : left + side] = alpha
    canvas, near = canvas[:, *around], background[:, *around]
    truth = motion_truth.layered(near, canvas[:3], canvas[3], moved, behind, extent.moments)
    inner = [slice(j.start - a.start, j.stop - a.start) for j, a in zip(judged, around, strict=True)]
    layer = Layer(
        torch.from_numpy(light).float(),
        torch.from_numpy(alpha).float(),
        tuple(along / EXPOSURE_S for along in moved),
        (left, top),
    )
    sheet = torch.from_numpy(background).float()[None]
    return Objects(at_rest(sheet, [layer]), truth[:, *inner], *judged, sheet, layer, moved, behind)


def _ours(step_px: float) -> Method:
    name = {2.0: OURS, _WHOLE_PX: "ours, matte formula"}.get(step_px, f"ours, parts of {step_px:g} px")
    about = "blurnoise.expose_layers, " + ("one part" if step_px == _WHOLE_PX else f"parts of {step_px:g} px")

    def of(case: Objects) -> Call:
        def call() -> Tensor:
            return expose_layers(
                case.background,
                [case.layer],
                exposure_s=EXPOSURE_S,
                velocity_px_s=case.background_px_s,
                step_px=step_px,
            )

        return call

    mark = {2.0: "", _WHOLE_PX: "formula"}.get(step_px, f"{step_px:g} px")
    return Method(name, OURS, about, of, mark)


def _blur_all(case: Objects) -> Call:
    return lambda: motion_blur(case.picture, case.moved_px)


def _naive(case: Objects) -> Call:
    left, top = case.layer.place_px
    matte = torch.zeros_like(case.picture[:, :1])
    height, width = case.layer.alpha.shape
    matte[0, 0, top : top + height, left : left + width] = case.layer.alpha

    def call() -> Tensor:
        share = motion_blur(matte, case.moved_px).clamp(0, 1)
        behind = motion_blur(case.picture, case.background_px)
        return share * motion_blur(case.picture, case.moved_px) + (1 - share) * behind

    return call


def _frames(count: int, *, moving: bool) -> Method:
    def of(case: Objects) -> Call:
        background = np.ascontiguousarray(case.background[0].permute(1, 2, 0).numpy())
        left, top = case.layer.place_px
        height, width = case.layer.alpha.shape
        own = (
            torch.cat([case.layer.light * case.layer.alpha, case.layer.alpha[None]]).permute(1, 2, 0).numpy()
        )
        sheet = np.zeros((*background.shape[:2], 4), np.float32)
        sheet[top : top + height, left : left + width] = own
        near = np.ascontiguousarray(sheet[case.rows, case.columns])
        at_rest_near = np.ascontiguousarray(background[case.rows, case.columns])

        def at(time: float) -> Picture:
            before = displaced(near, *(time * along for along in case.moved_px))
            if not moving:
                return np.asarray(before[..., :3] + (1 - before[..., 3:]) * at_rest_near)
            seen: Picture = displaced(background, *(time * along for along in case.background_px))
            seen[case.rows, case.columns] *= 1 - before[..., 3:]
            seen[case.rows, case.columns] += before[..., :3]
            return seen

        def call() -> Picture:
            if moving:
                return mean_of_frames(count, at)
            out = background.copy()
            out[case.rows, case.columns] = mean_of_frames(count, at)
            return out

        return call

    where = "pictures" if moving else "windows around the sign"
    return Method(f"{count} frames", FRAMES, f"mean of {count} {where}, cv2.warpAffine", of, str(count))


_WRONG = (
    Method(
        "naive blend",
        "naive blend",
        "blurred and unblurred picture, blended by the blurred matte: leaves the sign in its place, sharp",
        _naive,
    ),
    Method(
        "all blurred",
        "all blurred",
        "blurnoise.motion_blur of the whole picture, by the sign's motion",
        _blur_all,
    ),
)


def jobs() -> tuple[Job, ...]:
    """Before a background at rest, where the matte formula is exact, and before one that moves."""
    return (
        Job(
            "object",
            "a sign before a background at rest",
            lambda extent: _case(extent, moving=False),
            (_ours(2.0), *_WRONG, *(_frames(count, moving=False) for count in (8, 16, 32))),
        ),
        Job(
            "object and background",
            "a sign and its background move",
            lambda extent: _case(extent, moving=True),
            (
                *(_ours(step) for step in (2.0, 1.0, 4.0, _WHOLE_PX)),
                *_WRONG,
                *(_frames(count, moving=True) for count in (8, 16, 32)),
            ),
        ),
    )
