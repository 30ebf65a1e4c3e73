"""A picture's own tone curve at the command: taken out, noted in the run, and the same when it goes on."""

import numpy as np
import pytest
from blurnoise_eval.datasets import decode, write_picture
from blurnoise_eval.store.store import Store
from commands import main, told

from blurnoise import Camera

Output = pytest.CaptureFixture[str]
POINTS = ((0.0, 0.0), (0.1, 0.5), (0.5, 0.9), (1.0, 1.0))
TEXT = ",".join(f"{light}:{value}" for light, value in POINTS)


@pytest.fixture
def scene(tmp_path):
    """Light of 16 bits; beside it, in files, the same coded by ``POINTS``, and a camera with that tone."""
    light = np.random.default_rng(3).uniform(0.0, 1.0, (48, 64)).astype(np.float64)
    coded = np.interp(light, *zip(*POINTS, strict=True))
    write_picture(tmp_path / "light.png", np.rint(65535 * light).astype(np.uint16))
    write_picture(tmp_path / "coded.png", np.rint(65535 * coded).astype(np.uint16))
    Camera.from_dict({"base": "imx250m", "tone": [list(pair) for pair in POINTS]}).save(
        tmp_path / "mine.yaml"
    )
    return light


def test_simulate_takes_it_out(tmp_path, scene, capsys, monkeypatch):
    """By points, or those of a camera file: the frame of the light itself, but for what 16 bits round (1e-4)."""
    monkeypatch.chdir(tmp_path)
    usual = ("--camera", "imx250m", "--exposure-ms", 20, "--lux", 20, "--bit-depth", "native", "--seed", 5)
    told(capsys, "simulate", "light.png", "-o", "truth.png", "--picture-tone", "linear", *usual)
    truth = decode(tmp_path / "truth.png").astype(float)
    black, per_white = 240.0, 3855 / 10715 * 20 * 0.02 * 8782.0
    assert truth.mean() == pytest.approx(black + per_white * scene.mean(), rel=0.02)
    for place, tone in enumerate((TEXT, "mine.yaml")):
        told(capsys, "simulate", "coded.png", "-o", f"{place}.png", "--picture-tone", tone, *usual)
        assert np.abs(decode(tmp_path / f"{place}.png") - truth).max() <= 3
    told(capsys, "simulate", "coded.png", "-o", "srgb.png", "--picture-tone", "srgb", *usual)
    assert np.abs(decode(tmp_path / "srgb.png") - truth).mean() > 30


def test_by_default_a_photograph_keeps_its_values_where_it_keeps_its_exposure(tmp_path, capsys, monkeypatch):
    """Read and written by a typical camera's curve: within 2 of 255, but for what 12 bits round. So do sRGB's."""
    monkeypatch.chdir(tmp_path)
    ramp = np.repeat(np.arange(8, 248, 4, dtype=np.uint8)[None], 40, 0)
    write_picture(tmp_path / "ramp.png", ramp)
    (tmp_path / "quiet.yaml").write_text("base: imx250m\nread_noise_e: 0.1\nfull_well_e: 1000000\n"
                                         "system_gain_dn_per_e: 0.00385\nread_noise_post_share: 0\n")  # fmt: skip
    # a white pixel fills the well
    lux = (
        100
        * 1e6
        / told(capsys, "simulate", "ramp.png", "-o", "x.png", "--camera", "quiet.yaml")["white_electrons"]
    )
    means, said = {}, {}
    for tone in ("", "srgb"):
        words = ["--camera", "quiet.yaml", "--lux", lux, *(["--picture-tone", tone] if tone else [])]
        assert main(["simulate", "ramp.png", "-o", "out.png", *words]) == 0
        said[tone] = " ".join(capsys.readouterr().err.split())
        means[tone] = decode(tmp_path / "out.png").reshape(40, 60, -1).mean((0, 2))
        assert np.abs(means[tone] - ramp[0]).max() < 2
    assert "tone: photographs are read by a typical camera's curve and written again (3.8 stops" in said[""]
    assert "tone:" not in said["srgb"]


def test_a_camera_with_a_tone_of_its_own_keeps_it(tmp_path, scene, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", "coded.png", "-o", "out.png", "--camera", "mine.yaml"]) == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "typical camera's curve and written by the camera's own" in said
    assert main(["simulate", "coded.png", "-o", "typical.png", "--camera", "imx250m"]) == 0
    assert np.abs(decode(tmp_path / "typical.png").astype(float) - decode(tmp_path / "out.png")).mean() > 3


@pytest.mark.parametrize(
    ("tone", "why"),
    [
        ("gamma", "--picture-tone = 'gamma': must be srgb, linear, filmic, typical, a camera file"),
        ("0:0,1", "--picture-tone = [['0', '0'], ['1']]: must be"),
        ("0:0,0.5:1", "--picture-tone = "),
        ("empty.yaml", "this file has no 'tone:'"),
    ],
)
def test_what_is_no_tone_is_a_line(tmp_path, scene, capsys, monkeypatch, tone, why):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty.yaml").write_text("base: imx250\n")
    assert main(["simulate", "coded.png", "-o", "out.png", "--picture-tone", tone]) == 2
    assert why in capsys.readouterr().err


@pytest.mark.slow
def test_a_run_has_one_and_goes_on_with_no_other(tmp_path, scene, capsys, monkeypatch):
    """The brightness of a sweep's picture is that of the light, and the run's plan has the points."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pictures").mkdir()
    (tmp_path / "coded.png").rename(tmp_path / "pictures" / "coded.png")
    words = ["sweep", "--images", "pictures", "--exposure-ms", 20, "--lux", 20, "--camera", "imx250m", "-o", "run",
             "--no-refine"]  # fmt: skip
    assert main([*words, "--picture-tone", TEXT]) == 0
    with Store(tmp_path / "run") as store:
        assert store.about("identity")["plan"]["picture_tone"] == [list(pair) for pair in POINTS]
    assert main([*words, "--picture-tone", TEXT]) == 0
    capsys.readouterr()
    assert main(words) == 2
    assert "plan.picture_tone" in capsys.readouterr().err
    assert main(["sweep", "--picture-tone", "filmic", "--limit", 1, "-o", "signs"]) == 2
    assert "picture_tone: needs pictures of your own" in capsys.readouterr().err
    assert not (tmp_path / "signs").exists()
