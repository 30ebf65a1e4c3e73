"""Temporal noise that pixels share: offsets of whole rows, columns and frames, and factors of whole rows.

Domain: electrons (B, C, H, W). Each draws N(0, 1) from a stream of its own, of size 1 along what shares a value.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from blurnoise._core import rng
from blurnoise.camera import Camera
from blurnoise.light.resolved import Resolved
from blurnoise.sensor.stage import ReadoutFields, SensorStage, signal_bound_e, within_range_dn


class RowGain(SensorStage):
    """Row gain noise: a factor of each row and frame, with a correlation that falls exponentially from row to row.

    Of n rows the mean is subtracted, so that a frame is as bright as asked for.

    >>> banded = Camera.preset("imx250").with_figures(row_gain_noise=0.01, row_gain_rows=50.0)
    >>> ROW_GAIN.drawn(torch.zeros(1, 3, 480, 640), [1], banded).shape  # a value for each row
    torch.Size([1, 1, 480, 1])
    """

    name = "row gain noise"
    draws = True
    figures = ("row_gain_noise",)
    modelled = "a factor per row and frame"

    def drawn(self, light: Tensor, seeds: Sequence[int], camera: Camera) -> Tensor:
        """Correlated values of variance 1, minus their mean, for frames of this size (B, 1, H, 1)."""
        values = rng.standard_normal(seeds, light[:, :1, :, :1], self.name)
        rows = camera.sensor.row_gain_rows
        share, step = math.exp(-1 / rows) if rows else 0.0, 1
        if share:  # autoregression of first order, w[i] = share w[i - 1] + z[i], from its stationary state on
            values[:, :, 1:] *= math.sqrt(1 - share * share)
            while step < values.shape[2]:  # each step doubles the number of rows that are summed
                values[:, :, step:] += share**step * values[:, :, :-step].clone()
                step *= 2
        return values - values.mean(2, keepdim=True)

    def apply(self, signal: Tensor, at: ReadoutFields) -> Tensor:
        values = at.shared.get(self.name)
        if values is None:
            return signal
        return (signal * (1 + at.camera.sensor.row_gain_noise * values)).clamp(min=0.0)

    def bound_dn(self, at: Resolved[float]) -> float:
        return within_range_dn(at.camera, at.camera.sensor.row_gain_noise * signal_bound_e(at))


class SharedNoise(SensorStage):
    """Normal noise that pixels share: those of a row, of a column or of all planes of a frame.

    figure: its deviation, e- or DN rms. first: of light, one of the pixels that share a value. alternates: whether
    odd columns have it with the opposite sign.

    >>> rows = SHARED_NOISES[0]
    >>> rows.drawn(torch.zeros(1, 1, 480, 640), [1], Camera.preset("imx250")).shape  # a value for each row
    torch.Size([1, 1, 480, 1])
    """

    draws = True

    def __init__(self, name: str, figure: str, by: str, *first: slice, alternates: bool = False) -> None:
        self.name, self.figures, self.modelled = name, (figure,), f"a normal value per {by}"
        self._first, self._alternates = first, alternates

    def drawn(self, light: Tensor, seeds: Sequence[int], camera: Camera) -> Tensor:
        """N(0, 1) for frames of this size (B, C, H, W), of size 1 along what shares a value."""
        values = rng.standard_normal(seeds, light[:, *self._first], self.name)
        if self._alternates:
            values = values * (1 - 2 * (torch.arange(light.shape[3], device=light.device) % 2))
        return values

    def size_e(self, camera: Camera) -> float:
        """Its deviation, e- rms."""
        (figure,) = self.figures
        unit = camera.sensor.system_gain_dn_per_e if figure.endswith("_dn") else 1.0
        return float(camera.figure(figure)) / unit

    def apply(self, signal: Tensor, at: ReadoutFields) -> Tensor:
        values = at.shared.get(self.name)
        return signal if values is None else signal + self.size_e(at.camera) * values

    def bound_dn(self, at: Resolved[float]) -> float:
        return within_range_dn(at.camera, self.size_e(at.camera))


ROW_GAIN = RowGain()
_EVERY, _FIRST = slice(None), slice(1)
SHARED_NOISES = (
    SharedNoise("row noise", "row_noise_e", "row and frame", _EVERY, _EVERY, _FIRST),
    SharedNoise("column noise", "column_noise_e", "column and frame", _EVERY, _FIRST, _EVERY),
    SharedNoise(
        "noise of even and odd columns",
        "parity_noise_e",
        "row and frame",
        _EVERY,
        _EVERY,
        _FIRST,
        alternates=True,
    ),
    SharedNoise("black level drift", "black_level_drift_dn", "frame", _FIRST, _FIRST, _FIRST),
)
