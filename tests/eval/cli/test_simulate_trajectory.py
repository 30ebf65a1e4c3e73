"""``blurnoise simulate``: trajectories and line times."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from blurnoise_eval.datasets import write_picture
from commands import Output, pixels, told

from blurnoise import Camera, Trajectory, simulate
from blurnoise.motion.trajectory import from_text, path_duration_s, shake


def native(path: Path) -> np.ndarray:
    return np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED))


@pytest.mark.parametrize("line_time_us", [0, 20])
def test_a_vibration(tmp_path: Path, capsys: Output, line_time_us: int) -> None:
    """The numbers that Python gives, and how far it goes."""
    source, picture = tmp_path / "scene.png", pixels((31, 44), np.uint8)
    write_picture(source, picture)
    out = ("-o", tmp_path / "dn.png", "--bit-depth", "native", "--seed", 5, "--line-time-us", line_time_us)
    facts = told(capsys, "simulate", source, *out, "--trajectory", "sine:3,80,90")
    camera = Camera.preset("imx250")
    if line_time_us:
        camera = replace(camera, row_time_s=2e-5, shutter="rolling")
        assert facts["readout_ms"] == pytest.approx(1e3 * 2e-5 * 31 / max(31 / 2056, 44 / 2464))
        stages = told(capsys, "simulate", source, *out, "--trajectory", "sine:3,80,90", "--explain")["stages"]
        (how,) = (stage["how"] for stage in stages if stage["name"] == "rolling shutter")
        assert how.startswith(f"{facts['readout_ms']:.3g} ms from first row to last")
    else:
        assert "readout_ms" not in facts
    span_s = 0.01 + 2 * camera.row_time_s * 2056
    path = Trajectory.sinusoid(3.0, 80.0, span_s, direction_deg=90.0)
    dn = simulate(
        torch.from_numpy(picture / np.float32(255))[None, None],
        camera,
        exposure_s=0.01,
        illuminance_lux=100.0,
        trajectory=path,
        generator=[5],
    )
    np.testing.assert_array_equal(native(tmp_path / "dn.png"), dn[0, 0].numpy())


def test_a_log_and_a_shake(tmp_path: Path, capsys: Output) -> None:
    """Each as Python takes it: a gyroscope's rates by the camera's focal length, a shake by the seed."""
    source, log = tmp_path / "scene.png", tmp_path / "rates.csv"
    picture = pixels((31, 44), np.uint8)
    write_picture(source, picture)
    log.write_text("time_s,wx_deg_s,wy_deg_s\n7.00,0,400\n7.02,0,400\n", encoding="utf-8")
    camera = Camera.preset("imx250")
    focal = camera.field.focal_px[0] * 44 / 2464
    light = torch.from_numpy(picture / np.float32(255))[None, None]
    paths = {
        str(log): from_text(log.read_text(), str(log), focal_px=focal),
        "shake:9": shake(5, 9.0, 0.01, duration_s=path_duration_s(camera, 0.01)),
    }
    for text, path in paths.items():
        out = ("-o", tmp_path / "dn.png", "--bit-depth", "native", "--seed", 5)
        told(capsys, "simulate", source, *out, "--trajectory", text)
        dn = simulate(light, camera, exposure_s=0.01, illuminance_lux=100.0, trajectory=path, generator=[5])
        np.testing.assert_array_equal(native(tmp_path / "dn.png"), dn[0, 0].numpy())
