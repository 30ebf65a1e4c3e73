"""``blurnoise simulate --ego``: a camera that drives, of 8- and 16-bit pictures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from blurnoise_eval.datasets import write_picture
from commands import Output, pixels, told

from blurnoise import Camera, simulate
from blurnoise.motion.ego import EgoMotion, Vehicle, View, range_of_depth_m

SIZE = (45, 60)
CAMERA = Camera.preset("imx250")
ROAD = ("--height-m", 1.2, "--pitch-deg", 3, "--heading-deg", 5, "--hfov-deg", 50, "--lens", "rectilinear")
DRIVES = ("--ego-kmh", 72, "--yaw-deg-s", 20, "--pitch-deg-s", 4)
NATIVE = ("--bit-depth", "native", "--seed", 5)


def native(path: Path) -> np.ndarray:
    return np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED))


def flow(plane_m: float | None = None) -> np.ndarray:
    """At 72 km/h, 20 degrees/s to the right and 4 up."""
    view, mount = View(60, 45, 50.0, "rectilinear"), Vehicle(1.2, 3.0, 5.0)
    yaw, pitch = 20.0 * mount.down, np.array([4.0, 0.0, 0.0])
    x, y, z = (yaw + pitch).tolist()
    moving = EgoMotion(mount.driving(20.0).velocity_m_s, (x, y, z))
    rays = view.rays(view.pixels())
    ranges = mount.road_m(rays)
    if plane_m is not None:
        ranges = np.minimum(ranges, range_of_depth_m(rays, plane_m))
    return view.flow_px_s(view.pixels(), ranges, moving)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("plane_m", [None, 6.0])
def test_the_numbers_that_python_gives(
    tmp_path: Path, capsys: Output, kind: type[np.unsignedinteger], plane_m: float | None
) -> None:
    source, picture = tmp_path / "scene.png", pixels(SIZE, kind)
    write_picture(source, picture)
    plane = () if plane_m is None else ("--plane-m", plane_m)
    facts = told(capsys, "simulate", source, "-o", tmp_path / "dn.png", *NATIVE, *DRIVES, *ROAD, *plane)
    moved = torch.from_numpy(flow(plane_m))
    dn = simulate(
        torch.from_numpy(picture.astype(np.float32) / np.float32(np.iinfo(kind).max))[None, None],
        CAMERA,
        exposure_s=0.01,
        illuminance_lux=100.0,
        velocity_px_s=moved,
        generator=[5],
    )
    np.testing.assert_array_equal(native(tmp_path / "dn.png"), dn[0, 0].numpy())
    lengths = torch.linalg.vector_norm(moved, dim=0) * 0.01
    assert facts["blur_px"] == pytest.approx(float(lengths.median()))
    assert facts["longest_blur_px"] == pytest.approx(float(lengths.max()))


def test_the_view_is_the_cameras_unless_stated() -> None:
    """A picture of another shape than the sensor's shows the largest part of it: the same px per degree."""
    whole, tall = (103, 123), (103, 61)
    turning = Vehicle(yaw_deg_s=10.0)
    for lens in ("f-theta", "rectilinear"):
        seen, part = (replace(turning, lens=lens).flow_px_s(CAMERA, size, 0.0) for size in (whole, tall))
        torch.testing.assert_close(part, seen[..., 31:92], rtol=2e-3, atol=1e-6)
    stated = replace(turning, hfov_deg=30.0).flow_px_s(CAMERA, whole, 0.0)
    assert float(stated[0].abs().max()) == pytest.approx(10 * 123 / 30, rel=0.02)
    assert float(
        turning.flow_px_s(replace(CAMERA, hfov_deg=30.0), whole, 0.0)[0].abs().max()
    ) == pytest.approx(float(stated[0].abs().max()), rel=0.01)


def test_explain_has_the_variation_and_rows_objects_and_captures_go_with_it(
    tmp_path: Path, capsys: Output
) -> None:
    source = tmp_path / "scene.png"
    write_picture(source, pixels(SIZE, np.uint8))
    given = ("simulate", source, "-o", tmp_path / "out.png", "--ego-kmh", 72, *ROAD)
    stages = {each["name"]: each for each in told(capsys, *given, "--explain")["stages"]}
    assert stages["motion variation"]["kept"]
    assert "sub-exposures along each pixel's path" in stages["motion variation"]["how"]
    plain = native(tmp_path / "out.png").astype(int)
    told(capsys, *given, "--line-time-us", 20)
    assert np.abs(native(tmp_path / "out.png") - plain).max() > 30
    facts = told(capsys, *given, "--object", "20,10,15,12", "--object-dx", 900)
    assert facts["object_blur_px"] == pytest.approx(9.0)
    assert facts["invented_percent"] > 5
    assert told(capsys, *given, "--hdr", 4)["captures"] == 2
