"""Nodes: which conditions are one experiment, and which are not."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.maps.nodes import nodes_at
from made_maps import plane, row
from plans import IMX250


def nodes(*rows: dict[str, Any], stated: tuple[str, ...] = (), **figures: float) -> int:
    return len(nodes_at(rows, replace(IMX250, **figures), stated))  # type: ignore[arg-type]


def test_equal_light_and_motion_are_one_experiment() -> None:
    found = nodes_at([row(0.01, 50.0, 300.0), row(0.02, 25.0, 150.0), row(0.02, 25.0)], IMX250, ())
    assert found.node_of.tolist() == [0, 0, 1]
    assert found.places[:, 0] == pytest.approx([-1, -1])
    assert found.places[:, 1] == pytest.approx([np.log2(3), -1])  # at rest: half a pixel


def test_there_and_back_are_one_but_across_is_another() -> None:
    assert nodes(row(0.01, 50.0, 300.0), row(0.01, 50.0, -300.0), row(0.01, 50.0, -300.0, -0.0)) == 1
    assert nodes(row(0.01, 50.0, 300.0), row(0.01, 50.0, 0.0, 300.0)) == 2
    assert nodes(row(0.01, 50.0, 300.0, 40.0), row(0.01, 50.0, 300.0, -40.0)) == 2


def test_gain_tells_apart_what_the_camera_sets_too() -> None:
    assert nodes(row(0.01, 50.0), row(0.02, 25.0, applied_gain_db=12.0)) == 2
    assert nodes(row(0.01, 50.0, applied_gain_db=11.98), row(0.02, 25.0, applied_gain_db=12.01)) == 1
    node = nodes_at([row(0.01, 50.0, applied_gain_db=12.0)], IMX250, ())
    assert node.figures["gain_db"] == 12
    plain = nodes_at([row(0.01, 50.0)], IMX250, ())
    assert node.figures["white_share"] == pytest.approx(plain.figures["white_share"] * 10**0.6)
    digital = replace(IMX250, analogue_gain_max_db=0.0)
    after = nodes_at([row(0.01, 50.0, applied_gain_db=12.0)], digital, ())
    assert after.figures["white_share"] == pytest.approx(plain.figures["white_share"] * 10**0.6)
    assert after.figures["snr_log2"] == pytest.approx(
        plain.figures["snr_log2"]
    )  # it adds neither light nor noise


def test_dark_charge_that_counts_tells_exposures_apart() -> None:
    pair = row(0.01, 50.0), row(0.05, 10.0)
    assert nodes(*pair) == 1
    assert nodes(*pair, dark_current_e_s=1000.0) == 2


def test_the_lens_is_the_cameras_unless_the_plan_states_another() -> None:
    """A stated f-number brings diffraction; the column has one in any case."""
    own = nodes_at([row(0.01, 50.0)], IMX250, ())
    assert own.conditions[0]["f_number"] is None
    assert nodes(row(0.01, 50.0, f_number=1.4), row(0.01, 50.0, f_number=4.0), stated=("f_number",)) == 2


def test_without_light_there_is_no_node() -> None:
    assert nodes(row(0.01, 0.0)) == 0


def test_lines_are_exposures_of_one_light_and_velocity() -> None:
    found = plane(exposures_s=(0.01, 0.002), lights_lux=(5.0, 50.0), speeds=(0.0, 300.0)).lines
    assert len(found) == 4
    for exposures_s, _ in found:
        assert exposures_s.tolist() == [0.002, 0.01]
