"""A picture's frames under the conditions of a sweep's cells.

Domain: pictures in as (H, W, 3) RGB, 8 or 16 bit; out as the camera's 8-bit picture.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import groupby
from typing import NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core.checks import limited_motion
from blurnoise.camera import Camera
from blurnoise.camera.captures import longest_first_s, windows
from blurnoise.camera.radiometry import dark_electrons, electrons_per_lux_s
from blurnoise.camera.spectra import Curve
from blurnoise.light.motion import readout_of
from blurnoise.picture import fusion
from blurnoise.picture.develop import develop_8bit, tones_8bit
from blurnoise.picture.fusion import captures_of, readers
from blurnoise.scene.exposure import Exposure
from blurnoise.scene.scene import Scene
from blurnoise.scene.take import Frames, TakeOptions, take_each
from blurnoise_eval.datasets import (
    Image,
    Picture,
    PictureSet,
    UnreadablePicture,
    check_cut,
    check_labelled,
    cut_out,
    eight_bit,
    target_mask,
)
from blurnoise_eval.datasets.cut_outs import CutOut, CutScene
from blurnoise_eval.plan.axes import HEADLAMP
from blurnoise_eval.plan.conditions import Cell
from blurnoise_eval.plan.plan import SweepPlan, usual_plan
from blurnoise_eval.run.headlit_scenes import HeadlitScenes, headlit_layers
from blurnoise_eval.scoring.boxes import MoveBoxes
from blurnoise_eval.scoring.movers import box_mover, box_sweeper


class Frame(NamedTuple):
    """A cell's picture, (H, W, 3) uint8 RGB, how it was taken, where that moves boxes and what they sweep.

    saturated: the share of its pixels of which a colour is at a limit of well, converter or picture. snr_db: of
    a pixel with the picture's mean light. brightness: its mean value, 0-1. None of the original picture. By the place
    of a target: invented, see :meth:`CutScene.invented`, and own_px, its blur if it moves at a speed of its own.
    missed_pulse: whether no row of the pulsed lamp receives light in any capture; None without lamp.
    """

    cell: Cell
    image: NDArray[np.uint8]
    simulate_ms: float
    exposure: Exposure | None = None
    move_boxes: MoveBoxes | None = None
    sweep_boxes: MoveBoxes | None = None
    saturated: float | None = None
    snr_db: float | None = None
    brightness: float | None = None
    invented: Mapping[int, float] = {}
    own_px: Mapping[int, float] = {}
    missed_pulse: bool | None = None


class PictureScene:
    """A picture as light, shared by all its conditions. ``image8``: the picture itself with 8 bits.

    plan: how it is exposed under all of them. picture: with the targets that the plan's objects move, and which may
    be its lamps. Raises ``UnreadablePicture`` where the part that the plan's grey anchor names has no light.
    """

    def __init__(self, image: Image, plan: SweepPlan | None = None, picture: Picture | None = None) -> None:
        self.plan = plan = usual_plan() if plan is None else plan
        self.image8, self._image = eight_bit(image), image
        self._picture, self.objects = picture, plan.objects
        self._cut: CutOut | None = None
        self.headlit = HeadlitScenes(plan, picture)
        self._lit: dict[Hashable, Scene] = {}
        self._cut_scenes: dict[Hashable, CutScene] = {}
        self._lock = threading.Lock()
        try:
            self.light = Scene.of_picture(image, plan.grey_anchor, plan.picture_tone or "srgb")
        except ValueError as error:
            if plan.grey_anchor is None:
                raise
            raise UnreadablePicture(str(error)) from None
        lamps, self._reflected, mask = plan.lamps, self.light.light, None
        if lamps is not None and lamps.on_targets and picture is not None:
            mask = torch.from_numpy(target_mask(picture, self.image8.shape[:2]))
            if lamps.factor != 1:
                self.light = replace(self.light, light=self.light.light * (1 + mask * (lamps.factor - 1)))
        self.lamp_mask = mask if lamps is not None and lamps.pwm_mask else None
        """Where the pulsed lamp is, (H, W); None: it lights everything."""
        if self.lamp_mask is not None:
            self.light = replace(self.light, lamp_mask=self.lamp_mask)

    def frames(self, exposures: Sequence[Exposure]) -> Iterator[Frames]:
        """The picture under each exposure. At rest it is as it is, whatever may move."""
        options = TakeOptions(("8 bit",), white=self.plan.hdr_white)
        # Adjacent exposures of one scene are taken together, so that take_each can share what they have in common.
        for (is_cut, _), group in groupby(exposures, key=lambda at: (self._is_cut(at), _lit_by(at))):
            alike = list(group)
            if is_cut:
                scene = self._cut_scene(alike[0])[0].scene
                yield from take_each(scene, alike if scene.layers else map(_without_targets, alike), options)
            else:
                yield from take_each(self.lit(alike[0]), map(_as_a_whole, alike), options)

    def lit(self, taken: Exposure) -> Scene:
        """The picture as a whole, with the light of the headlamps that the exposure has."""
        key = _lit_by(taken)
        if key is None:
            return self.light
        with self._lock:
            if key not in self._lit:
                found = self.headlit.of(self.light.light, taken.camera, taken.headlamp)
                self._lit[key] = replace(self.light, headlamp_lux={taken.headlamp: found.plane()})
            return self._lit[key]

    def headlit_text(self, camera: Camera) -> str | None:
        """What the run notes of its targets in headlamps; None where the plan has none."""
        return self.headlit.facts(self.light.light, camera).text if self.plan.beams else None

    def invented(self, taken: Exposure) -> dict[int, float]:
        """By the place of a target, what is seen that had to be invented."""
        if not self._is_cut(taken):
            return {}
        scene, targets = self._cut_scene(taken)
        return dict(zip(targets, scene.invented(taken), strict=True))

    def own_px(self, taken: Exposure) -> dict[int, float]:
        """Blur, px, of the targets whose class has its own speed, by their place in the picture's list."""
        found, objects = dict[int, float](), self.objects
        for place, target in enumerate((self._picture and self._picture.targets) or ()):
            if taken.moves != "all" and target.label in objects.speeds:
                velocity = taken.of_targets(objects.speed_of(target.label)).velocity_px_s
                found[place] = math.hypot(*velocity) * taken.exposure_s
        return found

    def missed_pulse(self, taken: Exposure) -> bool | None:
        """Whether no row of the pulsed lamp receives light in any capture, at rest; None without lamp."""
        lit = np.ones(len(self.image8), bool) if self.lamp_mask is None else self.lamp_mask.numpy().any(1)
        if taken.lamp is None or not lit.any():
            return None
        size = self.image8.shape[:2]
        for start_s, taken_s in windows(captures_of(taken.camera), taken.exposure_s):
            rows = readout_of(taken.camera, taken_s, size)
            begin, end = map(torch.from_numpy, rows.windows_s)
            if taken.lamp.factor(end - begin, begin - begin.min() + start_s).numpy()[lit].any():
                return False
        return True

    def _is_cut(self, taken: Exposure) -> bool:
        """Whether the picture has to be cut for it."""
        return taken.moves != "all" and any(taken.velocity_px_s)

    def _cut_scene(self, taken: Exposure) -> tuple[CutScene, tuple[int, ...]]:
        """The layers, cut out by the first thread that needs them, and the places of their targets."""
        with self._lock:
            found, key = self._cut_out(), _lit_by(taken)
            if key not in self._cut_scenes:
                cut, planes = found.cut, dict[str, Tensor]()
                if key is not None:
                    lit = self.headlit.of(self.light.light, taken.camera, taken.headlamp)
                    planes = {taken.headlamp: lit.plane(but=found.targets)}
                    layers = headlit_layers(cut.layers, found.targets, lit, taken.headlamp)
                    cut = cut._replace(layers=tuple(layers))
                self._cut_scenes[key] = CutScene(cut, found.speeds, self.lamp_mask, planes)
            return self._cut_scenes[key], found.targets

    def _cut_out(self) -> CutOut:
        """The targets, cut out once; with the lock held."""
        if self._cut is None:
            if self._picture is None:
                raise ValueError("moves: targets and background need a picture that has targets")
            light, scale = self.light.light, 1.0
            if self.plan.grey_anchor is not None:
                plain = Scene.of_picture(self._image, encoding=self.plan.picture_tone or "srgb")
                # The anchor scales all light by one number, so the ratio of the sums is that number.
                scale = float(self._reflected.sum() / plain.light.sum())
            emitters = 1.0 if self.plan.lamps is None else self.plan.lamps.factor
            self._cut = cut_out(self._picture, light, self.objects, scale, emitters)
        return self._cut


def _lit_by(taken: Exposure) -> Hashable:
    """What the light of headlamps depends on; None without."""
    return None if taken.headlamp == "off" else (taken.camera.field, taken.headlamp)


def _as_a_whole(exposure: Exposure) -> Exposure:
    return exposure if exposure.moves == "all" else replace(exposure, moves="all")


def _without_targets(exposure: Exposure) -> Exposure:
    """The exposure of a picture without targets, which is background everywhere."""
    still = exposure.moves == "targets"
    return replace(exposure, moves="all", velocity_px_s=(0.0, 0.0) if still else exposure.velocity_px_s)


def frames(scene: PictureScene, cells: Sequence[Cell], camera: Camera) -> Iterator[Frame]:
    """The picture of each cell; a cell without conditions is the picture as it is, and comes first.

    Where a cell leaves the gain to the camera, the plan's auto-exposure sets it by the scene's mean light. A shake is
    that of the cell's seed.
    """
    plan = scene.plan
    # First, as a model's answer to the original picture says what counts as its targets.
    yield from (Frame(cell, scene.image8, 0.0) for cell in cells if cell.conditions is None)
    exposed = [(cell, cell.conditions) for cell in cells if cell.conditions is not None]
    height, width = scene.image8.shape[:2]
    exposures = []
    for cell, at in exposed:
        exposure = at.exposure(
            camera, cell.seed, vehicle=plan.vehicle, spectrum=plan.own_spectrum, infrared=plan.infrared
        )
        if at.automatic:
            exposure_s = math.nan if "exposure_s" in at.automatic else exposure.exposure_s
            exposure = replace(exposure, exposure_s=exposure_s, gain_db=plan.auto_exposure).metered(
                scene.lit(exposure).mean_light(exposure)
            )
        if plan.path is not None:
            # Over the longest exposure of the plan: all exposures of a cell's seed are parts of one shake.
            along = plan.path[0].of(camera, (height, width), plan.path[1], cell.seed)
            exposure = replace(exposure, trajectory=along)
        if plan.lamps is not None:
            exposure = replace(exposure, lamp=plan.lamps.pulses(cell.repeat, cell.seed))
        exposures.append(exposure)
    before: tuple[object, ...] | None = None
    for (cell, _), exposure, frame in zip(exposed, exposures, scene.frames(exposures), strict=True):
        if before != (before := _motion(exposure)):  # else only the light differs
            boxes = box_mover(exposure, scene.objects), box_sweeper(exposure, scene.objects)
        (image,) = frame.images()
        yield Frame(
            cell,
            image,
            frame.simulate_ms,
            exposure,
            *boxes,
            saturated=_saturated(image, brightest(exposure, plan.hdr_white)),
            snr_db=snr_db(exposure, scene.lit(exposure).mean_light(exposure)),
            brightness=cv2.mean(image.reshape(-1))[0] / 255,
            invented=scene.invented(exposure),
            own_px=scene.own_px(exposure),
            missed_pulse=scene.missed_pulse(exposure),
        )


def _saturated(picture: NDArray[np.uint8], limit: int) -> float:
    """The share of pixels of (H, W, 3) in which a colour is at the limit or above."""
    if picture.max(initial=0) < limit:  # of most pictures, and quick to see
        return 0.0
    below = cv2.countNonZero(cv2.inRange(picture, (0, 0, 0), (limit - 1,) * 3))
    return float(1.0 - below / (picture.shape[0] * picture.shape[1]))


def brightest(exposure: Exposure, hdr_white: float = 1.0) -> int:
    """The 8-bit value from which on a pixel counts as saturated, see :attr:`blurnoise.Camera.saturated_dn`.

    Of several captures it is that of a pixel which is at a limit in all of them.
    """
    camera, digital_db = exposure.amplified
    reader, *more = readers(camera)
    if not more:
        return _brightest(reader, digital_db)
    return _brightest_fused(camera, _white_e(exposure) * hdr_white, exposure.illuminant)


@lru_cache(maxsize=64)
def _brightest(camera: Camera, digital_db: float) -> int:
    return int(tones_8bit(camera, digital_db)[int(camera.sensor.saturated_dn)])


@lru_cache(maxsize=256)
def _brightest_fused(camera: Camera, white_e: float, illuminant: str | Curve) -> int:
    planes = 3 if camera.sensor.cfa == "none" else 1
    # A picture in which every pixel is at its limit says what becomes of it: fusion is no table of values.
    limits_dn = [float(int(reader.sensor.saturated_dn)) for reader in readers(camera)]
    dn = torch.stack([torch.full((1, planes, 4, 4), limit_dn) for limit_dn in limits_dn])
    return int(develop_8bit(dn, camera, illuminant=illuminant, white_e=torch.tensor([white_e])).min())


def _white_e(exposure: Exposure) -> float:
    """Electrons of white in the first capture."""
    lux_s = exposure.illuminance_lux * exposure.exposure_s
    per_lux_s = electrons_per_lux_s(exposure.camera, exposure.illuminant)
    return lux_s * per_lux_s * captures_of(exposure.camera)[0].sensitivity


def _motion(taken: Exposure) -> tuple[object, ...]:
    """All that the places of boxes depend on."""
    moved = taken.velocity_px_s, taken.trajectory, taken.moves, taken.ego_speed_m_s, taken.vehicle
    return taken.camera, taken.exposure_s, *moved


def snr_db(exposure: Exposure, light: float) -> float | None:
    """Temporal signal to noise, dB, of a pixel with so much light, below saturation: EMVA 1288, noise of signal, dark
    charge, read-out and rounding; of several captures as merged. None without light."""
    camera = exposure.amplified.camera
    signal_e = light * _white_e(exposure)
    dark_e = dark_electrons(camera, exposure.exposure_s, exposure.temperature_c)
    if signal_e <= 0:
        return None
    if camera.sensor.captures:
        return fusion.snr_db(camera, signal_e, dark_e=dark_e)
    bend_e2 = (camera.sensor.variance_factor(signal_e + dark_e) - 1) * (signal_e + dark_e)
    noise_e = math.sqrt(
        signal_e + bend_e2 + camera.sensor.dark_variance_dn2(dark_e) / camera.sensor.system_gain_dn_per_e**2
    )
    return 20 * math.log10(signal_e / noise_e)


def check_plan(plan: SweepPlan, camera: Camera, pictures: PictureSet) -> None:
    """Raise ``ValueError`` for what of the plan does not go with the camera, or with the pictures.

    That is: targets that move alone without knowing where they are, a trajectory that is too short or needs a focal
    length, figures that the camera's lens does not take, and motion beyond the limits.
    """
    size, path = camera.field.size, None
    if plan.lamps is not None and plan.lamps.on_targets:
        check_labelled(pictures, "emitters, pwm_mask: targets", "without labels pulses light the whole scene")
    if any(plan.values(HEADLAMP.name)) and not pictures.labelled:  # those of a named light then light nothing
        raise ValueError("headlamp: needs labels, by which targets are known; or distance_m with --object")
    if plan.cuts:
        check_cut(pictures, plan.objects)
    if plan.path is not None:
        (stated, longest_s), readout_s = plan.path, camera.sensor.row_time_s * camera.sensor.height_px
        # The last row of the last capture is exposed latest; the path must hold it, and the same time before.
        half_s = sum(windows(captures_of(camera), longest_s)[-1]) - longest_s / 2
        half_s += readout_s if camera.sensor.shutter == "global-reset" else readout_s / 2
        path = stated.of(camera, size, longest_s, plan.seed)
        path.window(-half_s, half_s)
    for at in plan.conditions():
        exposure = at.exposure(
            camera, vehicle=plan.vehicle, spectrum=plan.own_spectrum, infrared=plan.infrared
        )
        exposure = replace(exposure, trajectory=path)
        if "exposure_s" in at.automatic:
            exposure = replace(exposure, exposure_s=longest_first_s(camera.sensor.captures, plan.longest_s))
        if camera.sensor.captures:
            windows(camera.sensor.captures, exposure.exposure_s)
        if exposure.drives:
            height, width = size
            # The flow of a camera that drives is greatest at the picture's rim; six points bound it.
            edges = torch.tensor([(x, y) for x in (0.5, width / 2, width - 0.5) for y in (0.5, height - 0.5)])
            limited_motion("ego_speed_m_s: flow times exposure", exposure.displacements_px(edges))
