"""Nodes: the experiments of a run, each once, and the closed-form figures of the camera at each.

Domain: H, lux seconds on the scene; L, motion during the exposure, px; gain, dB. Conditions of equal H, L and gain
are one experiment, and one node, on a camera whose dark charge says nothing beside its other noise; else the exposure
tells them apart too. Motion below ``STILL_PX`` is measured as it is and drawn as none. Where the camera set its gain
itself, a node's is the mean over the pictures, to a tenth of a dB; so is the exposure.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise.optics.camera import Camera
from blurnoise.optics.radiometry import dark_electrons, photoelectrons
from blurnoise_eval.answers.plane import STILL_PX
from blurnoise_eval.grid.axes import CORE, LIGHT, SETTING
from blurnoise_eval.grid.conditions import Conditions
from blurnoise_eval.quality.measure import BRIGHT, DARK
from blurnoise_eval.sweep.three_sensors import behind_one_filter

Array = NDArray[np.float64]
_MEAN = 0.3
"""Reflectance whose shot noise stands for that of a scene."""
_DARK_SHARE = 0.02
"""Of the variance in the dark: from here on dark charge makes an exposure of its own."""
_DIGITS = 6  # that tell H and L apart


@dataclass(frozen=True)
class Node:
    """One experiment: conditions that stand for it, their gain a number, and the camera there.

    snr_log2: of a step from ``DARK`` to ``BRIGHT``, log2 of the difference by the noise of a pixel. white_share:
    light of a white surface, as a share of what saturates.
    """

    conditions: Conditions
    light_lux_s: float
    blur_px: float
    snr_log2: float
    white_share: float

    @property
    def u(self) -> float:
        """log2 H."""
        return math.log2(self.light_lux_s)

    @property
    def w(self) -> float:
        """log2 L, that of ``STILL_PX`` where it is less."""
        return math.log2(max(self.blur_px, STILL_PX))


@dataclass(frozen=True, eq=False)
class Plane:
    """A run's nodes and its conditions on them.

    rows: of the store, one per condition, those without light left out. node_of: (len(rows),) the node of each.
    """

    nodes: tuple[Node, ...]
    rows: tuple[Mapping[str, Any], ...]
    node_of: NDArray[np.int64]

    @cached_property
    def u(self) -> Array:
        """log2 H of each node, (N,)."""
        return np.array([node.u for node in self.nodes], float)

    @cached_property
    def w(self) -> Array:
        """log2 L of each node, (N,)."""
        return np.array([node.w for node in self.nodes], float)

    @cached_property
    def lines(self) -> list[tuple[Array, NDArray[np.int64]]]:
        """Exposures, s, increasing, and their nodes, of each light, velocity and further setting."""
        found: dict[tuple[float, ...], list[tuple[float, int]]] = {}
        names = (*SETTING, "velocity_x_px_s", "velocity_y_px_s")
        for row, node in zip(self.rows, self.node_of.tolist(), strict=True):
            found.setdefault(tuple(row[name] for name in names), []).append((row["exposure_s"], node))
        return [
            (np.array([s for s, _ in line]), np.array([node for _, node in line], np.int64))
            for line in (sorted(each) for each in found.values())
        ]


def plane_of(rows: Iterable[Mapping[str, Any]], camera: Camera, stated: Sequence[str]) -> Plane:
    """The nodes of the conditions that the store's rows name (``queries.exposed_conditions``).

    stated: the further axes on which the run's plan has values; the camera's own stands on the others.
    """
    lit = [row for row in rows if row["exposure_s"] * row[LIGHT.name] > 0]
    camera = behind_one_filter(camera)
    told = {*CORE, *stated} - {"gain_db"}
    every = [
        Conditions(**{name: row[name] for name in told}, gain_db=round(row["applied_gain_db"] or 0.0, 1))
        for row in lit
    ]
    by_exposure = _dark_charge_counts(camera, every)
    places: dict[tuple[float | None, ...], int] = {}
    node_of = np.array([places.setdefault(_key(at, by_exposure), len(places)) for at in every], np.int64)
    firsts: dict[int, Conditions] = {}
    for node, at in zip(node_of.tolist(), every, strict=True):
        firsts.setdefault(node, at)
    return Plane(tuple(_node(firsts[place], camera) for place in range(len(places))), tuple(lit), node_of)


def _key(at: Conditions, by_exposure: bool) -> tuple[float | None, ...]:
    x, y = at.displacement_px
    if (x, y) < (-x, -y):  # there and back are one blur
        x, y = -x, -y
    further = (at[name] for name in SETTING if name != LIGHT.name)
    exposure = at.exposure_s if by_exposure else None
    numbers = (at.exposure_s * at.illuminance_lux, x, y)
    return (*(float(f"{each:.{_DIGITS}g}") + 0.0 for each in numbers), *further, exposure)


def _dark_charge_counts(camera: Camera, every: Iterable[Conditions]) -> bool:
    in_the_dark = camera.dark_variance_dn2() / camera.system_gain_dn_per_e**2
    charges = (dark_electrons(camera, at.exposure_s, at.stated.get("temperature_c", 25.0)) for at in every)
    return max(charges, default=0.0) > _DARK_SHARE * in_the_dark


def _node(at: Conditions, camera: Camera) -> Node:
    exposure = at.exposure(camera)
    taker, digital_db = exposure.amplified
    white_e = photoelectrons(taker, at.illuminance_lux, at.exposure_s)
    dark_e = dark_electrons(taker, at.exposure_s, exposure.temperature_c)
    noise_e2 = _MEAN * white_e + taker.dark_variance_dn2(dark_e) / taker.system_gain_dn_per_e**2
    saturation_e = taker.saturation_e / max(10 ** (digital_db / 20), 1.0)
    return Node(
        at,
        at.exposure_s * at.illuminance_lux,
        at.blur_px,
        math.log2((BRIGHT - DARK) * white_e / math.sqrt(noise_e2)),
        white_e / saturation_e,
    )
