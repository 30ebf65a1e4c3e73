"""``blurnoise simulate``: its file holds the numbers that Python gives, and what the command says of them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from blurnoise_eval.datasets import decode_any, write_picture
from commands import main, pixels, told
from exposed_frames import raw_frames

from blurnoise import Camera, Trajectory, develop, photoelectrons, simulate
from blurnoise.camera.captures import staggered
from blurnoise.camera.colour import srgb_from_linear
from blurnoise.light.lamp import Pwm
from blurnoise.motion.ego import EgoMotion, Vehicle, View
from blurnoise.motion.trajectory import from_text, path_duration_s, shake
from blurnoise.picture.develop import develop_8bit

IMX250 = Camera.preset("imx250")
ROLLING = IMX250.with_figures(row_time_s=2e-5, shutter="rolling")
SIZE = (31, 44)
RATES = "time_s,wx_deg_s,wy_deg_s\n7.00,0,400\n7.02,0,400\n"
ROAD = "--ego-kmh 72 --height-m 1.2 --pitch-deg 3 --heading-deg 5 --hfov-deg 50 --lens rectilinear"
LIGHT = (8 * np.random.default_rng(5).random((12, 17, 3)) ** 4).astype(np.float32)


def driven():
    """The flow of ``ROAD``: 72 km/h over level ground."""
    view, mount = View(SIZE[1], SIZE[0], 50.0, "rectilinear"), Vehicle(1.2, 3.0, 5.0)
    places = view.pixels()
    moving = EgoMotion(mount.driving(20.0).velocity_m_s, (0.0, 0.0, 0.0))
    return torch.from_numpy(view.flow_px_s(places, mount.road_m(view.rays(places)), moving))


def gyroscope():
    return from_text(RATES, "rates.csv", focal_px=IMX250.field.focal_px[0] * 44 / 2464)


SCENES: dict[str, tuple[tuple[int, ...], type, str, Camera, Callable[[], dict[str, Any]]]] = {
    "moved, 16 bits": (SIZE, np.uint16, "--dx 500 --dy -90", IMX250, lambda: {"velocity_px_s": (500.0, -90.0)}),
    "in colour": ((*SIZE, 3), np.uint8, "--dx 500 --camera lin2024", Camera.preset("lin2024"),
                  lambda: {"velocity_px_s": (500.0, 0.0)}),
    "behind filters": ((*SIZE, 3), np.uint8, "--camera imx250c", Camera.preset("imx250c"), dict),
    "filters, grey": (SIZE, np.uint8, "--camera imx250c", Camera.preset("imx250c"), dict),
    "one plane": ((*SIZE, 3), np.uint8, "--camera mono.yaml", IMX250.with_figures(cfa="mono"), dict),
    "a vibration": (SIZE, np.uint8, "--trajectory sine:3,80,90", IMX250,
                    lambda: {"trajectory": Trajectory.sinusoid(3.0, 80.0, 0.01, direction_deg=90.0)}),
    "line by line": (SIZE, np.uint8, "--trajectory sine:3,80,90 --line-time-us 20", ROLLING,
                     lambda: {"trajectory": Trajectory.sinusoid(3.0, 80.0, 0.01 + 4e-5 * 2056, direction_deg=90.0)}),
    "a gyroscope's log": (SIZE, np.uint8, "--trajectory rates.csv", IMX250, lambda: {"trajectory": gyroscope()}),
    "a shake": (SIZE, np.uint8, "--trajectory shake:9", IMX250,
                lambda: {"trajectory": shake(5, 9.0, 0.01, duration_s=path_duration_s(IMX250, 0.01))}),
    "driven": (SIZE, np.uint16, ROAD, IMX250, lambda: {"velocity_px_s": driven()}),
}  # fmt: skip


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """With a log, a camera, light brighter than white, a white picture, a mask, and a street with a rectangle."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rates.csv").write_text(RATES, encoding="utf-8")
    (tmp_path / "mono.yaml").write_text("base: imx250\ncfa: mono\n")
    (tmp_path / "light.tiff").write_bytes(cv2.imencode(".tiff", LIGHT[..., ::-1])[1].tobytes())
    write_picture(tmp_path / "white.png", np.full((12, 17), 65535, np.uint16))
    mask, street = np.zeros((12, 17), np.uint8), np.full((80, 120), 90, np.uint8)
    mask[3:6, 4:9], street[30:46, 50:70] = 255, 230
    write_picture(tmp_path / "mask.png", mask)
    write_picture(tmp_path / "street.png", street)
    write_picture(tmp_path / "car.png", (street == 230).astype(np.uint8) * 255)
    return tmp_path


def stored(name="out.png"):
    """The picture of a file, (channels, height, width)."""
    picture = cv2.imread(name, cv2.IMREAD_UNCHANGED)
    return picture[None] if picture.ndim == 2 else picture[..., ::-1].transpose(2, 0, 1)


def taken(capsys, picture, words):
    """What is said, and the picture; of imx250 in one plane, unless the words name a camera."""
    camera = "" if "--camera" in words else "--camera mono.yaml"
    tone = "" if "--picture-tone" in words else "--picture-tone srgb"
    return told(
        capsys, "simulate", picture, "-o", "out.png", *words.split(), *camera.split(), *tone.split()
    ), stored()


@pytest.mark.parametrize("name", SCENES)
def test_the_file_holds_the_numbers_that_python_gives(name, capsys):
    """Natively, and developed: grey of one plane, in the photograph's channels."""
    shape, dtype, words, camera, more = SCENES[name]
    picture = pixels(shape, dtype)
    write_picture(Path("scene.png"), picture)
    facts, native = taken(
        capsys, "scene.png", f"{words} --bit-depth native --seed 5 --exposure-ms 10 --lux 70"
    )
    light = torch.from_numpy(np.atleast_3d(picture).transpose(2, 0, 1) / np.float32(np.iinfo(dtype).max))
    dn = simulate(
        light[None].contiguous(), camera, exposure_s=0.01, illuminance_lux=70.0, generator=[5], **more()
    )
    assert native.dtype == np.uint16
    np.testing.assert_array_equal(native, dn[0].numpy())
    _, view = taken(capsys, "scene.png", f"{words} --seed 5 --exposure-ms 10 --lux 70")
    developed_dn = develop_8bit(dn, camera)[0].numpy()
    assert (view.dtype, len(view)) == (np.uint8, 3 if len(shape) == 3 or camera.sensor.cfa == "RGGB" else 1)
    np.testing.assert_array_equal(view, np.broadcast_to(developed_dn, view.shape))
    assert facts["mean_dn"] == pytest.approx(float(dn.mean()))
    assert facts["white_electrons"] == pytest.approx(photoelectrons(camera, 70, 0.01))
    if name.startswith("moved"):
        assert facts["blur_px"] == pytest.approx(np.hypot(500, 90) * 0.01)
    if name == "driven":
        lengths = torch.linalg.vector_norm(driven(), dim=0) * 0.01
        assert facts["blur_px"] == pytest.approx(float(lengths.median()))
        assert facts["longest_blur_px"] == pytest.approx(float(lengths.max()))
    if name == "line by line":
        assert facts["readout_ms"] == pytest.approx(1e3 * 2e-5 * 31 / max(31 / 2056, 44 / 2464))


@pytest.mark.parametrize("anchor", ["", "mean", "p50", "1,2,9,8"])
def test_what_light_on_a_photograph_means(capsys, anchor):
    """Two photographs of one scene, 2 EV apart: with an anchor the same frame, without a quarter of it."""
    light = 0.05 + 0.9 * np.random.default_rng(3).random((20, 30)) ** 2
    words = f"--lux 20 {anchor and f'--grey-anchor {anchor}'}"
    means = []
    for stops in (0, 2):
        coded = srgb_from_linear(torch.from_numpy(light / 2**stops)).mul(65535).round().numpy()
        write_picture(Path("scene.png"), coded.astype(np.uint16))
        facts, _ = taken(capsys, "scene.png", words)
        means.append(facts["mean_dn"] - IMX250.sensor.black_level_dn)
    assert means[0] / means[1] == pytest.approx(1 if anchor else 4, rel=0.01)
    assert (
        ("brightness is used" not in facts["reflectance"]) == ("above_white_percent" in facts) == bool(anchor)
    )
    assert main(["simulate", "scene.png", "-o", "out.png", "--explain", *words.split()]) == 0
    assert ("brightness is used as reflectance" in capsys.readouterr().out) == (not anchor)


@pytest.mark.parametrize(
    ("words", "light"),
    [
        ("--light street", "street: 1 lux, led-4000, low beam"),
        ("--light street --headlamp off", "street: 1 lux, led-4000"),
        ("--light street --headlamp off --illuminant lamp.csv", "street: 1 lux, own"),
        (
            "--light street --headlamp high --illuminant sodium --object 50,30,20,16 --distance-m 30",
            "street: 1 lux, sodium, high beam",
        ),
    ],
)
def test_a_named_light_is_told_as_it_shines(capsys, words, light):
    Path("lamp.csv").write_text("400,1\n700,2\n")
    facts, _ = taken(capsys, "street.png", f"{words} --camera imx250c")
    assert facts["light"] == light


def test_a_lamp_in_infrared(capsys):
    """50.34 photons per um^2, ms, uW/cm^2 and um behind f/1.4, half of them electrons; starlight is nothing."""
    Path("nir.yaml").write_text(
        "{base: imx250m, quantum_efficiency: {wavelengths_nm: [400, 1000], values: [0.5, 0.5]}}"
    )
    words = "--camera nir.yaml --exposure-ms 4 --lux 1e-5 --infrared 940:0.05"
    facts, _ = taken(capsys, "street.png", words)
    electrons = 0.5 * 50.34 * 3.45**2 * 4 * 0.94 * 5 / (4 * 1.4**2)
    assert facts["white_electrons"] == pytest.approx(electrons, rel=2e-3)


def test_it_explains_what_it_models(capsys):
    words = ["simulate", "street.png", "-o", "out.png", "--dx", "900", "--explain"]
    assert main(words) == 0
    shown = capsys.readouterr().out
    assert all(word in shown for word in ("motion", "9 px", "shot noise", "read noise", "left out"))

    def stages(more):
        return {each["name"]: each for each in taken(capsys, "street.png", f"{more} --explain")[0]["stages"]}

    found = stages("--dx 900")
    assert found["motion"]["kept"]
    assert not found["PRNU"]["kept"]
    assert "sub-exposures along each pixel's path" in stages(ROAD)["motion variation"]["how"]
    assert "parts of 2 px" in stages("--object car.png --object-dx 1000 --dx 400 --hdr 8")["objects"]["how"]


def test_the_picture_itself_is_not_written_over(capsys):
    before = Path("street.png").read_bytes()
    assert main(["simulate", "street.png", "-o", "street.png"]) == 2
    assert "is an input of this command" in capsys.readouterr().err
    assert Path("street.png").read_bytes() == before


def test_values_of_fewer_bits_are_doubted(folder, capsys):
    write_picture("dim.png", pixels(SIZE, np.uint16) >> 4)
    assert main(["simulate", "dim.png", "-o", "out.png"]) == 0
    assert "of 65535 in the pictures of 16 bits: 12 bits?" in " ".join(capsys.readouterr().err.split())


def test_captures_of_light_brighter_than_white(capsys):
    words = "--camera imx250 --picture-tone linear --exposure-ms 10 --lux 80 --dx 500 --seed 5"
    given: dict[str, Any] = {
        "exposure_s": 0.01,
        "illuminance_lux": 80.0,
        "velocity_px_s": (500.0, 0.0),
        "generator": [5],
    }
    light = torch.from_numpy(LIGHT).permute(2, 0, 1)[None].contiguous()
    frames = raw_frames(light, IMX250, staggered(16, 64), **given)
    facts, _ = taken(capsys, "light.tiff", f"{words} --hdr 16,64 --bit-depth native")
    for name, frame in zip(("out.png", "out_2.png", "out_3.png"), frames, strict=True):
        np.testing.assert_array_equal(stored(name), frame[0].numpy())
    assert facts["captures"] == 3
    assert facts["fused_saturation_electrons"] == pytest.approx(64 * 10715)
    assert facts["above_white_percent"] == pytest.approx(100 * float((LIGHT.max(-1) > 1).mean()))
    _, seen = taken(capsys, "light.tiff", f"{words} --hdr 16,64 --hdr-white 8")
    several = IMX250.with_figures(captures=staggered(16, 64))
    expected = develop(torch.stack(frames), several, white_e=8 * photoelectrons(IMX250, 80.0, 0.01))
    np.testing.assert_array_equal(seen, (255 * expected[0]).round().numpy())
    Path("hdr.yaml").write_text("base: imx250\ncaptures: [{}, {exposure_ratio: 16}]\n")
    of_file, by_file = taken(capsys, "light.tiff", words.replace("imx250", "hdr.yaml"))
    of_option, by_option = taken(capsys, "light.tiff", f"{words} --hdr 16")
    np.testing.assert_array_equal(by_file, by_option)
    assert {**of_file, "camera": "imx250"} == of_option


def test_lamps_pulse_or_shine_brighter_where_the_mask_is(capsys):
    words = "--exposure-ms 1 --lux 20 --bit-depth native"
    plain = taken(capsys, "white.png", words)[1][0].astype(float) - IMX250.sensor.black_level_dn
    facts, dn = taken(capsys, "white.png", f"{words} --pwm-mask mask.png --pwm 90,0.1,0.5")
    assert facts["pwm_dark_percent"] == pytest.approx(81)
    assert dn[0, 3:6, 4:9].mean() < dn[0, :3].mean() - 10
    drawn, _ = taken(capsys, "white.png", f"{words} --pwm 90,0.1 --seed 5")
    assert drawn["pwm_phase"] == Pwm(90.0, 0.1).with_phase_of(5).phase
    facts, dn = taken(capsys, "white.png", f"{words} --emitters mask.png:9")
    seen = dn[0].astype(float) - IMX250.sensor.black_level_dn
    assert seen[3:6, 4:9].mean() / plain.mean() == pytest.approx(9, rel=0.05)
    assert seen[8:].mean() / plain[8:].mean() == pytest.approx(1, rel=0.05)
    assert facts["above_white_percent"] == pytest.approx(100 * 15 / (12 * 17))


def test_linear_light_of_files():
    np.testing.assert_array_equal(decode_any(Path("light.tiff")), LIGHT)
    Path("light.hdr").write_bytes(cv2.imencode(".hdr", LIGHT[..., ::-1])[1].tobytes())
    np.testing.assert_allclose(decode_any(Path("light.hdr")), LIGHT, atol=8 / 128)  # one exponent, 8 bits


OBJECT = "--exposure-ms 10 --lux 250 --seed 3 --object"


def test_the_object_moves_and_the_rest_stays(capsys):
    """By a rectangle or a mask; with a plate behind it nothing is invented; the camera may track it."""
    still = taken(capsys, "street.png", OBJECT.removesuffix("--object"))[1][0].astype(float)
    facts, moved = taken(capsys, "street.png", f"{OBJECT} 50,30,20,16 --object-dx 2000")
    assert facts["object_blur_px"] == pytest.approx(20)
    assert facts["invented_percent"] == pytest.approx(25, abs=0.5)  # L / 4w
    assert facts["blur_px"] == 0
    np.testing.assert_array_equal(taken(capsys, "street.png", f"{OBJECT} car.png --object-dx 2000")[1], moved)
    seen = moved[0].astype(float)
    assert seen[38, 42] - still[38, 42] > 15
    assert still[38, 52] - seen[38, 52] > 15
    np.testing.assert_allclose(seen[:20], still[:20], atol=1)
    assert np.abs(seen[38] - seen[38][::-1]).mean() < 6  # it is centred
    write_picture(Path("plate.png"), np.full((80, 120), 30, np.uint8))
    facts, plate = taken(capsys, "street.png", f"{OBJECT} car.png --object-dx 2000 --plate plate.png")
    assert facts["invented_percent"] == 0
    assert plate[0, :20].mean() < seen[:20].mean() - 30
    facts, tracked = taken(capsys, "street.png", f"{OBJECT} car.png --dx -3000")
    assert (facts["blur_px"], facts["object_blur_px"]) == (pytest.approx(30), 0)
    inside = np.s_[32:44, 52:68]
    np.testing.assert_allclose(tracked[0][inside].mean(), still[inside].mean(), atol=1)
