"""Names of exported files say the condition; further axes only where they are not the camera's own."""

from __future__ import annotations

from typing import Any

import pytest
from blurnoise_eval.sweep.coco_export import condition_name
from plans import IMX250, OWN

AT = {"exposure_s": 0.02, "illuminance_lux": 3.0, "velocity_x_px_s": 333.3, "velocity_y_px_s": 0.0, **OWN}


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({}, "20ms-3lux-333.3_0px_s"),
        ({"exposure_s": 0.0123456789, "velocity_y_px_s": -77.1}, "12.3457ms-3lux-333.3_-77.1px_s"),
        ({"temperature_c": -20.0, "f_number": 5.6}, "20ms-3lux-333.3_0px_s--20C-f5.6"),
        ({"defocus_radius_px": 1.5, "gain_db": 6.0}, "20ms-3lux-333.3_0px_s-defocus1.5px-6dB"),
    ],
)
def test_names(changes: dict[str, Any], name: str) -> None:
    assert condition_name({**AT, **changes}, IMX250) == name
