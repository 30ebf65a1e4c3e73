"""Layered exposures: objects, each in a motion of its own, before a background that moves otherwise or not at all.

Domain: linear light, white is 1; px, x right, y down; motion straight and centred, so that at mid-exposure everything
is where the picture at rest has it, unless the camera shakes or reads row by row (:class:`Moved`). Layers come back
to front: the last is in front.

One object of light F and matte alpha before a background B makes, the exposure being T,

    I = h_F * (alpha F) + 1/T integral of (1 - alpha(p - d_F(t))) B(p - d_B(t)) dt.

The matte formula h_F * (alpha F) + (1 - h_F * alpha) (h_B * B) is that wherever matte or background does not vary in
time, as where either of them is still (Giusti & Caglioti 2007, inria-00264748). Where both move, and where objects
overlap that move differently, the exposure is cut into ``K`` parts, by default one for each ``STEP_PX`` that the
fastest moves, within each of which it is taken for exact. The error of the formula is then that of the covariance
within a part. Never blend a blurred picture by a blurred matte: that leaves the object sharp in its own place.

All of it happens in a window around what the object passes; the rest of the picture knows the background alone. Where
a matte meets the picture's border it goes on beyond it as the border does; elsewhere nothing is beyond it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import torch
from torch import Tensor

from blurnoise import blur, fourier
from blurnoise._core.borders import BORDERS, Border
from blurnoise._core.checks import (
    Numbers,
    image_batch,
    in_range,
    one_of,
)
from blurnoise._core.limits import limited_motion, limited_per_image
from blurnoise._core.windows import Window, continued_in, cut
from blurnoise.courses import Along, Course, Flow, PathByRow, RowByRow, Straight, finest
from blurnoise.layers import Layer, Layers, of_each, plane_of, trimmed, window_at_rest
from blurnoise.rolling_shutter import Readout, whole_path
from blurnoise.trajectory import Trajectory

STEP_PX = 2.0
"""What the fastest moves within one part of an exposure, at most."""
_LONGEST_PX = 4096.0  # of a motion that is cut into parts: each of them costs a transform of the whole window


def expose_layers(
    background: Tensor,
    layers: Layers,
    *,
    exposure_s: Numbers,
    velocity_px_s: Tensor | Iterable[float] = (0.0, 0.0),
    border: Border = "reflect",
    step_px: float = STEP_PX,
) -> Tensor:
    """The mean light (B, C, H, W) of an exposure of backgrounds (B, C, H, W), float32 or float64, and their layers.

    exposure_s: a number or (B,). velocity_px_s: of the background, (2,) or (B, 2). Differentiable in every light,
    matte, velocity and exposure. Raises ``TypeError`` or ``ValueError`` naming the argument.
    """
    image_batch("background", background)
    one_of("border", border, BORDERS)
    in_range("step_px", step_px, 0.05, 1e5)
    per_picture = of_each(layers, background)
    exposure = limited_per_image("exposure_s", exposure_s, len(background), background)
    moved = blur.motions("velocity_px_s", velocity_px_s, background) * exposure[:, None]
    limited_motion("displacement_px: velocity times exposure", moved)
    pictures = zip(torch.split(background, 1), per_picture, exposure, moved, strict=True)
    seen = [exposed(*each, border=border, step_px=step_px) for each in pictures]
    return seen[0] if len(seen) == 1 else torch.cat(seen)


def at_rest(background: Tensor, layers: Sequence[Layer]) -> Tensor:
    """A picture (1, C, H, W) with its layers before it, nothing moving."""
    return exposed(background, layers, background.new_zeros(()), background.new_zeros(2))


class Moved(NamedTuple):
    """What a camera does to all motions: its trajectory, or the s from row to row; a background's flow (2, H, W).

    readout: of rows that see another part of the trajectory each, or begin together.
    """

    trajectory: Trajectory | None = None
    row_s: float = 0.0
    flow_px: Tensor | None = None
    readout: Readout | None = None

    def course(self, displacement_px: Tensor, exposure_s: Tensor, size: tuple[int, int]) -> Course:
        """Of what moves by (2,) during an exposure (), in a picture (H, W)."""
        if self.readout is not None:
            x, y = displacement_px.detach().tolist()
            lasting_s = float(exposure_s) or math.inf
            path = whole_path(self.trajectory, (x / lasting_s, y / lasting_s), self.readout)
            return PathByRow(displacement_px, path, self.readout)
        if self.trajectory is not None:
            return Along(displacement_px, self.trajectory, float(exposure_s))
        if self.row_s:
            return RowByRow(displacement_px, exposure_s, self.row_s, (size[0] - 1) / 2)
        return Straight(displacement_px)

    def ground(self, displacement_px: Tensor, exposure_s: Tensor, size: tuple[int, int]) -> Course:
        """Of the background."""
        if self.flow_px is not None:
            return Flow(self.flow_px, displacement_px)
        return self.course(displacement_px, exposure_s, size)


AT_REST = Moved()


def exposed(
    background: Tensor,
    layers: Sequence[Layer],
    exposure_s: Tensor,
    moved_px: Tensor,
    border: Border = "reflect",
    step_px: float = STEP_PX,
    *,
    camera: Moved = AT_REST,
) -> Tensor:
    """:func:`expose_layers` of one picture (1, C, H, W), exposure () and displacement (2,) of the background.

    camera: what its own motion, or its readout, makes of all motions.
    """
    size = (background.shape[-2], background.shape[-1])
    everything = Window(0, 0, *size)
    ground_course = camera.ground(moved_px, exposure_s, size)
    laid = []
    for layer in map(trimmed, layers):
        displacement = layer.displacement_px(exposure_s).to(background)
        limited_motion("displacement_px: a layer's velocity times exposure", displacement)
        course = camera.course(displacement, exposure_s, size)
        passed = course.passed(window_at_rest(layer)).clipped(size)
        window = everything if border == "circular" else passed
        if window.height > 0 and window.width > 0:
            laid.append(_Laid((layer,), course, window))
    ground = background
    while laid and laid[0].course.as_one_with(ground_course):  # what moves with the background is part of it
        first = laid.pop(0)
        rest = first.window if border == "circular" else window_at_rest(first.layers[0]).clipped(size)
        if rest.height <= 0 or rest.width <= 0:
            continue
        ground = background.clone() if ground is background else ground
        plane = first.plane(rest, size, border, background)
        ground[..., *rest.within] = plane[:, :-1] + (1 - plane[:, -1:]) * ground[..., *rest.within].clone()
    blurred = ground_course.blurred(ground, everything, border)
    if not laid:
        return blurred
    asked = blurred.requires_grad or exposure_s.requires_grad or any(layer.requires_grad for layer in layers)
    out = blurred.clone() if blurred is background or (torch.is_grad_enabled() and asked) else blurred
    for window, members in _groups(laid):
        group = _joined(members)
        apart = len(group) > 1 or not (ground_course.still or group[0].course.still)
        if apart:
            seen = _in_parts(group, window, ground, blurred, ground_course, border, step_px)
        else:
            colour, share = _blurred(group[0], window, size, border, background)
            seen = colour + (1 - share) * blurred[..., *window.within]
        out[..., *window.within] = seen
    return out


class _Laid(NamedTuple):
    """Layers that move alike, back to front, how they move, and the pixels of the picture that they may cover."""

    layers: tuple[Layer, ...]
    course: Course
    window: Window

    def plane(self, work: Window, size: tuple[int, int], border: Border, like: Tensor) -> Tensor:
        """Light times matte, and the matte, (1, C + 1, h, w) in ``work``, of all as one."""
        plane = plane_of(self.layers[0], work, size, border, like)
        for layer in self.layers[1:]:
            before = plane_of(layer, work, size, border, like)
            plane = before + (1 - before[:, -1:]) * plane
        return plane


def _groups(laid: Sequence[_Laid]) -> list[tuple[Window, list[_Laid]]]:
    """Layers whose windows meet, each group with the window of all, back to front."""
    groups: list[tuple[Window, list[int]]] = []
    for place, each in enumerate(laid):
        window, members = each.window, [place]
        while met := [group for group in groups if group[0].meets(window)]:
            groups = [group for group in groups if group not in met]
            for other, places in met:
                window, members = window.joined(other), [*members, *places]
        groups.append((window, members))
    return [(window, [laid[place] for place in sorted(members)]) for window, members in groups]


def _joined(group: Sequence[_Laid]) -> list[_Laid]:
    """Layers back to front, neighbours that move alike as one."""
    found: list[_Laid] = []
    for each in group:
        if found and found[-1].course.as_one_with(each.course):
            last = found.pop()
            each = _Laid((*last.layers, *each.layers), last.course, last.window.joined(each.window))
        found.append(each)
    return found


def _blurred(
    laid: _Laid, window: Window, size: tuple[int, int], border: Border, like: Tensor
) -> tuple[Tensor, Tensor]:
    """Its light times its matte, (1, C, h, w), and its share of the exposure, (1, 1, h, w), in the window."""
    work = _work(window, [laid.course])
    plane = laid.plane(work, size, border, like)
    seen = cut(laid.course.blurred(plane, work, "circular"), work, window)
    return seen[:, :-1], seen[:, -1:].clamp(0, 1)


def _in_parts(
    group: Sequence[_Laid],
    window: Window,
    ground: Tensor,
    blurred: Tensor,
    ground_course: Course,
    border: Border,
    step_px: float,
) -> Tensor:
    """The window (1, C, h, w) as the mean of parts of the exposure, in each of which every matte covers what is
    behind it as the part's mean does."""
    size = (ground.shape[-2], ground.shape[-1])
    courses = [ground_course, *(each.course for each in group)]
    longest = max(course.length_px(window) for course in courses)
    if longest > _LONGEST_PX:
        raise ValueError(
            f"displacement_px: {longest:.4g} px; a layer before others in motion takes at most {_LONGEST_PX:g}"
        )
    edges = finest(courses, window, step_px)
    count = len(edges) - 1
    work = _work(window, courses)
    colour, share = _blurred(group[-1], window, size, border, ground)
    scene = ground_course.shown(continued_in(ground, work, border), count, work, window)
    planes = [each.plane(work, size, border, ground) for each in group]
    moving = [
        each.course.shown(plane, count, work, window)
        for plane, each in zip([*planes[:-1], planes[-1][:, -1:]], group, strict=True)
    ]
    total, bare, clear = torch.zeros_like(colour), torch.zeros_like(colour), torch.zeros_like(colour[:, :1])
    for first, last in pairwise(edges.tolist()):
        time, weight = (first + last) / 2, last - first
        seen = own = scene(time)
        through = (1 - moving[-1](time)).clamp(0, 1)
        uncovered = through
        for each in moving[:-1]:
            before = each(time)
            left = (1 - before[:, -1:]).clamp(0, 1)
            seen, uncovered = before[:, :-1] + left * seen, uncovered * left
        total = total.addcmul_(through, seen, value=weight)
        bare, clear = bare.add_(own, alpha=weight), clear.add_(uncovered, alpha=weight)
    # parts are for what varies together; what does not is exact, and the background that outside the window
    uncovered = 1 - share if len(group) == 1 else clear
    return colour + total - clear * bare + uncovered * blurred[..., *window.within]


def _work(window: Window, courses: Sequence[Course]) -> Window:
    """The window with all that moves through it, and what is left over to make lengths that transforms like."""
    down, across = (max(reach) for reach in zip(*(course.reach(window) for course in courses), strict=True))
    grown = window.grown(down, across)
    height = fourier.fast_length(grown.height) if down else grown.height
    width = fourier.fast_length(grown.width) if across else grown.width
    if height * width > fourier.LARGEST_PLANE:
        raise ValueError(
            f"displacement_px: {max(across, down)} px to either side; a layer needs a plane of {height}x{width} "
            f"pixels, at most {fourier.LARGEST_PLANE} are allowed"
        )
    return grown._replace(height=height, width=width)
