"""A light effect and a sensor stage that no camera has, each one object: what a table's new entry has to be."""

import math
from dataclasses import dataclass

import numpy as np
import torch

from blurnoise._core import rng
from blurnoise.light.effect import LightEffect
from blurnoise.sensor.stage import SensorStage


@dataclass(frozen=True)
class Veil(LightEffect):
    """Stray light: a share of white over the whole picture."""

    name = "veil"
    share: float = 0.1

    def bound(self, at):
        return self.share

    def apply(self, light, at, border):
        return light + self.share


@dataclass(frozen=True)
class Shift(LightEffect):
    """The picture displaced by whole pixels (x, y), and its boxes with it."""

    name = "shift"
    by_px: tuple[int, int] = (20, 10)

    def bound(self, at):
        return 0.5

    def apply(self, light, at, border):
        return torch.roll(light, (self.by_px[1], self.by_px[0]), (-2, -1))

    def move_boxes(self, boxes_xyxy, at):
        return boxes_xyxy + boxes_xyxy.new_tensor([*self.by_px, *self.by_px])

    def origins(self, points, at):
        return points - np.reshape(self.by_px, (2, *[1] * (points.ndim - 1)))


class Pedestal(SensorStage):
    """So many electrons in every pixel."""

    name = "pedestal"

    def __init__(self, electrons=500.0):
        self.electrons = electrons

    def apply(self, signal, at):
        return signal + self.electrons

    def bound_dn(self, at):
        return (
            self.electrons * at.camera.sensor.system_gain_dn_per_e if math.isfinite(self.electrons) else 0.0
        )


class ColumnNoise(SensorStage):
    """A draw for each column and frame, e-."""

    name = "column noise"
    draws = True

    def __init__(self, electrons):
        self.electrons = electrons

    def apply(self, signal, at):
        return signal + self.electrons * rng.standard_normal(at.seeds, signal[..., :1, :], self.name)

    def bound_dn(self, at):
        return self.electrons * at.camera.sensor.system_gain_dn_per_e
