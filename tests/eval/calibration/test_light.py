"""Lux tied to electrons: a grey card under a lux meter, tuning files of libcamera, and the note where nothing is."""

from pathlib import Path

import made_frames
import numpy as np
import pytest
from blurnoise_eval.calibration.libcamera import camera_of_libcamera
from blurnoise_eval.calibration.light import lux_text, tied
from blurnoise_eval.calibration.to_camera import changed
from blurnoise_eval.datasets import write_picture
from commands import main, told

from blurnoise import Camera, photoelectrons
from blurnoise.camera import PRESETS

CAMERA = made_frames.CAMERA
MODULES = Path(__file__).parents[4] / "shared/real/libcamera"
NAMES = ("imx219", "imx296", "imx477", "imx500", "imx708", "ov5647")


@pytest.mark.parametrize("column", [False, True])
def test_simulate_gives_the_measured_mean_of_a_grey_card(tmp_path, capsys, column):
    """Made at 60 % of saturation in 100 ms, said to be 100 lux on 18 %: a card in such light has that mean again."""
    planes = made_frames.exposed(CAMERA, 3, size=(96, 121), levels=6, top=0.6)
    folder = made_frames.save(tmp_path / "frames", planes)
    words = ["cameras", "fit", folder, "-o", tmp_path / "mine.yaml", "--bit-depth", 12, "--base", "imx250m"]
    if column:
        rows = [f"{path.name},{path.name.split('_')[0]},{float(path.name.split('_')[1].removesuffix('ms')) / 1e3},100"
                for path in sorted(folder.glob("*.npy"))]  # fmt: skip
        (folder / "frames.csv").write_text("\n".join(["file,kind,exposure_s,illuminance_lux", *rows]))
    assert main(words + ([] if column else ["--grey-card", "100,0.18"])) == 0
    camera = Camera.load(tmp_path / "mine.yaml")
    source = camera.sources["transmission"]
    assert source.startswith("measured: 6 levels of a grey card, reflectance 0.18")
    assert ("(assumed)" in source) == column
    mean_dn = float(np.mean(planes["flat", made_frames.LONGEST_S]))
    write_picture(tmp_path / "card.png", np.full((64, 80), round(0.18 * 65535), np.uint16))
    capsys.readouterr()
    at = ("--picture-tone", "linear", "--lux", 100, "--exposure-ms", 100, "--bit-depth", "native")
    files = (tmp_path / "card.png", "-o", tmp_path / "seen.png", "--camera", tmp_path / "mine.yaml")
    facts = told(capsys, "simulate", *files, *at)
    assert facts["mean_dn"] - 20 == pytest.approx(mean_dn - 20, rel=0.01)


def test_of_a_known_lens_quantum_efficiency_follows():
    """Twice the electrons by twice the efficiency; more than 1 names what cannot be the camera's."""
    lens = Camera.from_dict({"base": "imx250", "transmission": 0.9, "quantum_efficiency": 0.3})
    once = made_electrons(lens)
    assert tied(lens, 2 * once, "measured: a card").keys() == {"quantum_efficiency"}
    assert tied(lens, 2 * once, "measured: a card")["quantum_efficiency"][0] == pytest.approx(0.6)
    with pytest.raises(ValueError, match=r"need 4 times the quantum efficiency, above 1; f_number = 1.4"):
        tied(lens, 4 * once, "measured: a card")
    unknown = Camera.preset("imx250")
    assert tied(unknown, made_electrons(unknown) / 4, "x")["transmission"][0] == pytest.approx(0.25, rel=1e-4)


def made_electrons(camera):
    """By the pixel's area, the lens and 1 lux of D55 (Lin et al.): of imx250, 6906 electrons, as its own test
    has it; of a flat efficiency 24421.8 / (50 lux 30 ms) times it (the preset lin2024's comment)."""
    curve = camera.sensor.quantum_efficiency
    return 6906.0 if not isinstance(curve, float) else 24421.8 / 1.5 * curve * camera.lens.transmission


def test_a_measured_t_number_stands_for_f_number_and_transmission():
    """Lux no longer depend on their assumed values; a fit to electrons puts transmission in its place."""
    camera = PRESETS["imx250"]
    assert "f_number 1.4, transmission 1" in str(lux_text(camera))
    measured = camera.with_figures(t_number=1.6)
    assert "f_number" not in str(lux_text(measured))
    assert "quantum_efficiency" in str(lux_text(measured))
    target = made_electrons(camera) / 4
    fitted = changed(measured, tied(measured, target, "x"))
    assert photoelectrons(fitted, 1.0, 1.0) == pytest.approx(target, rel=1e-4)


def test_a_tuning_file_is_a_camera(tmp_path, capsys):
    """A flat picture of its reflectance, 0.22, in its light, has its mean again; grey has its red and blue."""
    module = made_frames.write_tuning(tmp_path / "module.json")
    words = ["cameras", "fit", "--libcamera", module, "-o", tmp_path / "pi.yaml"]
    assert main([*words, "--bit-depth", 10]) == 0
    camera = Camera.load(tmp_path / "pi.yaml")
    assert camera.sensor.system_gain_dn_per_e == pytest.approx(0.25)
    assert camera.sensor.black_level_dn == 64.0
    assert np.allclose(camera.isp.ccm, ((1.8, -0.5, -0.3), (-0.4, 1.7, -0.3), (-0.1, -0.6, 1.7)))
    assert np.allclose(camera.isp.tone, ((0.0, 0.0), (0.5, 0.75), (1.0, 1.0)), atol=1e-4)
    assert camera.sensor.full_well_e == pytest.approx((1023 - 64) / 0.25)
    write_picture(tmp_path / "chart.png", np.full((64, 80), round(0.22 * 65535), np.uint16))
    (tmp_path / "lit.yaml").write_text("illuminant: planck:5000\n")
    capsys.readouterr()
    at = ("--picture-tone", "linear", "--lux", 1000, "--exposure-ms", 10, "--scene", tmp_path / "lit.yaml")
    files = (tmp_path / "chart.png", "-o", tmp_path / "seen.png", "--camera", tmp_path / "pi.yaml")
    facts = told(capsys, "simulate", *files, *at)
    assert facts["white_electrons_G"] * 0.22 == pytest.approx(200, rel=1e-3)
    assert facts["white_electrons_R"] / facts["white_electrons_G"] == pytest.approx(0.6, rel=1e-3)
    assert facts["white_electrons_B"] / facts["white_electrons_G"] == pytest.approx(0.6, rel=1e-3)


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"rpi.noise": None}, "has no 'rpi.noise'"),
        ({"rpi.noise": {"reference_slope": 0, "reference_constant": 0}}, "reference_slope = 0: must be > 0"),
        ({"rpi.lux": None}, "has no 'rpi.lux'"),
    ],
)
def test_what_is_no_tuning_file_is_named(tmp_path, changes, why):
    with pytest.raises(ValueError, match=rf"module\.json: .*{why}"):
        camera_of_libcamera(made_frames.write_tuning(tmp_path / "module.json", **changes), base="imx250c")
    (tmp_path / "other.json").write_text("[1]")
    with pytest.raises(ValueError, match="must be a tuning file"):
        camera_of_libcamera(tmp_path / "other.json", base="imx250c")


@pytest.mark.skipif(not MODULES.is_dir(), reason="needs the shared tuning files")
@pytest.mark.parametrize("name", NAMES)
def test_presets_are_what_their_tuning_files_say(name):
    camera, preset = camera_of_libcamera(MODULES / f"{name}.json", base=name), PRESETS[name]
    for figure in ("system_gain_dn_per_e", "full_well_e", "black_level_dn", "transmission"):
        assert preset.figure(figure) == pytest.approx(camera.figure(figure), rel=1e-3)
    assert np.abs(np.array(preset.isp.ccm) - np.array(camera.isp.ccm)).max() < 1e-4
    light = np.linspace(0, 1, 101)
    of_file, of_preset = (np.interp(light, *np.array(each.isp.tone).T) for each in (camera, preset))
    assert np.abs(of_file - of_preset).max() < 0.005


def test_modules_agree_with_each_other_and_with_who_measured_one():
    """strollswithmydog.com: an IMX477 has K = 0.47 DN/e-, 8180 e-; green peaks of three modules are within 10 %."""
    assert PRESETS["imx477"].sensor.system_gain_dn_per_e == pytest.approx(0.47, rel=0.03)
    assert PRESETS["imx477"].sensor.full_well_e == pytest.approx(8180, rel=0.03)
    peaks = [
        max(PRESETS[name].sensor.quantum_efficiency.of("G").values) for name in ("ov5647", "imx219", "imx500")
    ]
    assert max(peaks) / min(peaks) < 1.1
