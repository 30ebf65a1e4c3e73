"""``blurnoise cameras fit``: a folder or a DNG in, a camera that other commands take out."""

import made_frames
import numpy as np
import pytest
from commands import main

from blurnoise import Camera

CAMERA = made_frames.drawn_camera(2).with_figures(
    full_well_e=9000.0, system_gain_dn_per_e=0.4, read_noise_e=4.0, prnu=0.01, dsnu_e=2.0, black_level_dn=20.0,
    bit_depth=12,
)  # fmt: skip
Output = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    planes = made_frames.exposed(CAMERA, 1, size=(96, 121))
    return made_frames.save(tmp_path_factory.mktemp("frames"), planes)


def test_a_camera_with_sources_and_its_plot(folder, tmp_path, capsys):
    path = tmp_path / "mine.yaml"
    words = ["cameras", "fit", folder, "-o", path, "--bit-depth", "12", "--temperature-c", "31"]
    assert main(words) == 0
    shown = capsys.readouterr().out
    assert "Photon transfer of 16 flat and 16 dark frames" in shown
    assert shown.splitlines()[-2:] == [str(path), str(tmp_path / "mine.png")]
    assert (tmp_path / "mine.png").stat().st_size > 10_000
    camera = Camera.load(path)
    assert camera.sensor.system_gain_dn_per_e == pytest.approx(0.4, rel=0.02)
    assert camera.sources["read_noise_e"].startswith(
        "measured: photon transfer of 16 flat and 16 dark frames, 95 % "
    )
    assert camera.sources["full_well_e"].startswith("assumed: the limit of the converter, as no frame clips")
    assert camera.sources["bit_depth"] == "stated with the frames"
    assert (camera.sensor.dark_reference_c, camera.sources["dark_reference_c"]) == (
        31.0,
        "stated with the frames",
    )
    assert camera.sources["f_number"] == "assumed, as of the preset imx250"
    assert set(camera.sources) == set(camera.to_dict()) - {"name", "sources"}
    assert main(["cameras", str(path)]) == 0


def test_a_dng(tmp_path, capsys):
    made_frames.write_dng(
        tmp_path / "photo.dng",
        np.zeros((48, 64), np.uint16),
        {51041: (12, (1e-4, 1e-7)), 50717: (4, 4095), 34855: (3, 400)},
    )
    path = tmp_path / "phone.yaml"
    assert main(["cameras", "fit", "--dng", str(tmp_path / "photo.dng"), "-o", str(path)]) == 0
    assert "ISO 400" in capsys.readouterr().out
    assert Camera.load(path).sensor.system_gain_dn_per_e == pytest.approx(0.4095)


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["-o", "x.yaml"], "folder, --dng, --libcamera: exactly one"),
        (["FOLDER", "--dng", "x.dng", "-o", "x.yaml"], "folder, --dng, --libcamera: exactly one"),
        (["FOLDER", "-o", "x.txt"], "suffix of x.txt"),
        (["FOLDER", "-o", "x.yaml", "--base", "imx"], "base = 'imx'"),
        (["FOLDER", "-o", "x.yaml", "--bit-depth", "17"], "--bit-depth = 17"),
        (["FOLDER", "-o", "x.yaml", "--bit-depth", "11"], "--bit-depth = 11: allows numbers up to 2047"),
        (["--dng", "x.dng", "-o", "x.yaml", "--bit-depth", "12"], "--bit-depth: needs a folder"),
        (["FOLDER", "-o", "x.yaml", "--raw-layout", "mipi10"], "--raw-layout = 'mipi10': must be PACKING,"),
        (["FOLDER", "-o", "x.yaml", "--cfa", "RGB"], "--cfa = 'RGB'"),
        (
            ["FOLDER", "-o", "x.yaml", "--grey-card", "500,2"],
            "--grey-card = '500,2': must be LUX,REFLECTANCE",
        ),
        (["FOLDER", "-o", "x.yaml", "--grey-card", "0.18"], "--grey-card = '0.18': needs lux"),
        (["FOLDER", "-o", "x.yaml", "--grey-card", "500"], "--grey-card = '500': must be"),
        (["missing", "-o", "x.yaml"], "folder = 'missing'"),
        (["--dng", "missing.dng", "-o", "x.yaml"], "missing.dng"),
    ],
)
def test_bad_input_is_told_in_a_line(folder, tmp_path, capsys, monkeypatch, words, why):
    monkeypatch.chdir(tmp_path)
    assert main(["cameras", "fit", *(str(folder) if word == "FOLDER" else word for word in words)]) == 2
    told = capsys.readouterr().err
    assert told.startswith("blurnoise: error: ")
    assert why in told
    assert told.count("\n") == 1
    assert not list(tmp_path.iterdir())
