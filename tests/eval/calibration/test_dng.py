"""What a DNG states, as a camera; files made by code."""

import made_frames
import numpy as np
import pytest
from blurnoise_eval.calibration.dng import camera_of_dng
from blurnoise_eval.calibration.formats import format_of, read_plane

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
    assert camera.sensor.system_gain_dn_per_e == pytest.approx(GAIN)
    assert camera.sensor.read_noise_e == pytest.approx(READ_E)
    signal = 0.3 * SPAN
    variance = camera.sensor.dark_variance_dn2() + camera.sensor.system_gain_dn_per_e * signal
    assert variance == pytest.approx((S * 0.3 + O) * SPAN**2)
    assert (camera.sensor.black_level_dn, camera.sensor.clip_dn, camera.sensor.bit_depth) == (
        BLACK,
        WHITE,
        12,
    )
    assert (camera.sensor.width_px, camera.sensor.height_px) == (64, 48)
    assert camera.lens.f_number == pytest.approx(1.8)
    assert camera.name == "Made Up 1 at ISO 200"
    assert "NoiseProfile of photo.dng at ISO 200" in camera.sources["read_noise_e"]
    assert camera.sources["pixel_pitch_um"] == "assumed, as of the preset imx250"


def test_other_tags(tmp_path):
    """The green plane of three, noise below rounding, four black levels, none."""
    camera = camera_of_dng(dng(tmp_path, t51041=(12, (2 * S, O, S, O, 3 * S, O))))
    assert camera.sensor.system_gain_dn_per_e == pytest.approx(GAIN)
    assert "plane 2 of 3" in camera.sources["system_gain_dn_per_e"]
    assert camera_of_dng(dng(tmp_path, t51041=(12, (S, 0.0)))).sensor.read_noise_e == 0
    assert camera_of_dng(dng(tmp_path, t50714=(4, (60, 64, 64, 68)))).sensor.black_level_dn == 64
    bare = camera_of_dng(dng(tmp_path, t50714=None, t50717=None, t34855=None))
    assert (bare.sensor.black_level_dn, bare.sensor.bit_depth, bare.name) == (0, 16, "Made Up 1")
    assert bare.sources["black_level_dn"].startswith("assumed")


def test_the_black_level_is_the_mean_of_its_three_tags(tmp_path):
    """48 rows, 64 columns; of one row 48 more is 1 on average."""
    rows, columns = (48.0, *(0.0,) * 47), (2.0,) * 64
    camera = camera_of_dng(
        dng(tmp_path, t50714=(5, (50, 60, 60, 70)), t50715=(10, columns), t50716=(10, rows))
    )
    assert camera.sensor.black_level_dn == pytest.approx(60 + 2 + 1)
    assert camera.sensor.system_gain_dn_per_e == pytest.approx(S * (WHITE - 63))
    assert "BlackLevel + BlackLevelDeltaH + BlackLevelDeltaV" in camera.sources["black_level_dn"]


def test_active_area(tmp_path):
    camera = camera_of_dng(dng(tmp_path, t50829=(4, (1, 2, 47, 60))))
    assert (camera.sensor.width_px, camera.sensor.height_px) == (58, 46)


def test_the_rounding_of_a_linearization_table_is_no_read_noise(tmp_path):
    """Numbers by 4 around black: O has 16/12 DN^2 of them, which were 5.84 e- for 5.0."""
    table = (*range(0, 256, 4), *range(256, 4096, 32), 4095)
    rounded = ((GAIN * READ_E) ** 2 + 16 / 12) / SPAN**2
    camera = camera_of_dng(dng(tmp_path, t50712=(3, table), t51041=(12, (S, rounded))))
    assert camera.sensor.read_noise_e == pytest.approx(READ_E)
    said = f"less the rounding of 4²/12 DN²; a LinearizationTable spreads {len(table)} stored numbers to 4095"
    assert said in camera.sources["read_noise_e"]


AREAS = {(1, 1, 47, 63): "BGGR", (1, 0, 47, 64): "GBRG", (0, 1, 48, 63): "GRBG", (2, 2, 46, 62): "RGGB"}


@pytest.mark.parametrize(("area", "letters"), AREAS.items())
def test_letters_of_frames_are_those_of_what_is_read(tmp_path, area, letters):
    """LibRaw leaves out a row or column more where the area begins at an odd one; letters are the area's."""
    pytest.importorskip("rawpy", reason="needs rawpy: pip install 'blurnoise[raw]'")
    plane = np.arange(48 * 64, dtype=np.uint16).reshape(48, 64)
    tags = {50829: (4, area), 50712: (3, tuple(range(48 * 64)))}
    made_frames.write_dng(tmp_path / "a.dng", plane, tags)
    read, header = read_plane(tmp_path / "a.dng"), format_of(tmp_path / "a.dng").header(tmp_path / "a.dng")
    row, column = divmod(int(read[0, 0]), 64)
    pattern = "RGGB"[2 * ((row - area[0]) % 2) + (column - area[1]) % 2]
    assert (header.cfa, header.cfa[0]) == (letters, pattern)
    assert header.notes == [
        "a LinearizationTable spreads 3072 stored numbers to 3071: noise near black is of those steps"
    ]


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
