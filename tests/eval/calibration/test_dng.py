"""What a DNG states, as a camera; files made by code."""

import made_frames
import numpy as np
import pytest
from blurnoise_eval.calibration.to_camera import camera_of_dng

PLANE = np.full((48, 64), 500, np.uint16)
GAIN, READ_E, BLACK, WHITE = 0.4, 3.0, 64, 4095
SPAN = WHITE - BLACK
S = GAIN / SPAN
O = (GAIN * READ_E / SPAN) ** 2 + 1 / 12 / SPAN**2  # noqa: E741  # as the specification calls it
TAGS = {
    50714: (4, BLACK), 50717: (4, WHITE), 51041: (12, (S, O)), 50708: (2, "Made Up 1"), 34855: (3, 200),
    33434: (5, 0.01), 33437: (5, 1.8),
}  # fmt: skip


def dng(folder, **changed):
    tags = {**TAGS, **{int(name[1:]): value for name, value in changed.items()}}
    path = folder / "photo.dng"
    made_frames.write_dng(path, PLANE, {number: value for number, value in tags.items() if value is not None})
    return path


def test_the_noise_profile_is_a_camera(tmp_path):
    """At x = 0.3 the camera's K signal + dark variance is (S x + O) of white less black."""
    camera = camera_of_dng(dng(tmp_path))
    assert camera.system_gain_dn_per_e == pytest.approx(GAIN)
    assert camera.read_noise_e == pytest.approx(READ_E)
    signal = 0.3 * SPAN
    variance = camera.dark_variance_dn2() + camera.system_gain_dn_per_e * signal
    assert variance == pytest.approx((S * 0.3 + O) * SPAN**2)
    assert (camera.black_level_dn, camera.clip_dn, camera.bit_depth) == (BLACK, WHITE, 12)
    assert (camera.width_px, camera.height_px) == (64, 48)
    assert camera.f_number == pytest.approx(1.8)
    assert camera.name == "Made Up 1 at ISO 200"
    assert "NoiseProfile of photo.dng at ISO 200" in camera.sources["read_noise_e"]
    assert camera.sources["pixel_pitch_um"] == "assumed, as of the preset imx250"


def test_other_tags(tmp_path):
    """The green plane of three, noise below rounding, four black levels, none."""
    camera = camera_of_dng(dng(tmp_path, t51041=(12, (2 * S, O, S, O, 3 * S, O))))
    assert camera.system_gain_dn_per_e == pytest.approx(GAIN)
    assert "plane 2 of 3" in camera.sources["system_gain_dn_per_e"]
    assert camera_of_dng(dng(tmp_path, t51041=(12, (S, 0.0)))).read_noise_e == 0
    assert camera_of_dng(dng(tmp_path, t50714=(4, (60, 64, 64, 68)))).black_level_dn == 64
    bare = camera_of_dng(dng(tmp_path, t50714=None, t50717=None, t34855=None))
    assert (bare.black_level_dn, bare.bit_depth, bare.name) == (0, 16, "Made Up 1")
    assert bare.sources["black_level_dn"].startswith("assumed")


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"t51041": None}, "has no NoiseProfile"),
        ({"t51041": (12, (S, O, S))}, "must be pairs of S > 0"),
        ({"t50714": (4, 5000)}, "must be 0 <= black < white"),
    ],
)
def test_files_that_make_no_camera(tmp_path, changed, why):
    with pytest.raises(ValueError, match=rf"photo\.dng: .*{why}"):
        camera_of_dng(dng(tmp_path, **changed))
    for data in (b"", b"\xff\xd8\xff", b"II*\0\x08\0\0\0\xff\xff", b"II*\0\x08\0\0\0"):
        (tmp_path / "x.dng").write_bytes(data)
        with pytest.raises(ValueError, match=r"x\.dng: is no"):
            camera_of_dng(tmp_path / "x.dng")
