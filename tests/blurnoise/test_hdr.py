"""HDR: SNR at the switches, means and noise of the blend, ghosts in closed form, and the limits."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from blurnoise import Camera, ExposedScene, Exposure, simulate
from blurnoise.light.flicker import Pwm
from blurnoise.optics.camera import Capture, staggered
from blurnoise.optics.colour import srgb_from_linear
from blurnoise.optics.radiometry import electrons_per_lux_s
from blurnoise.scene import hdr
from blurnoise.scene.hdr import Flicker, captured, developed, fuse

IMX250 = Camera.preset("imx250")
FINE = replace(IMX250, bit_depth=16, system_gain_dn_per_e=(65535 - 6) / 10715)  # no rounding to speak of
WELL_E = 10715.0


def dual_gain(gain_db: float) -> tuple[Capture, Capture]:
    """One exposure read at a gain and at 0 dB: nothing moves between the two."""
    return Capture(gain_db=gain_db), Capture(start_s=0.0)


def lux_for(camera: Camera, white_e: float = WELL_E, exposure_s: float = 0.01) -> float:
    """Light under which white makes so many electrons in the first exposure."""
    return white_e / electrons_per_lux_s(camera) / exposure_s


def fused(
    light: torch.Tensor,
    camera: Camera,
    captures: tuple[Capture, ...],
    **taken: object,
) -> torch.Tensor:
    """Electrons of the first capture."""
    return fuse(captured(ExposedScene(light), camera, captures, **taken), camera, captures)


def flat(electrons: float, captures: tuple[Capture, ...], seed: int = 1, **options: object) -> torch.Tensor:
    """Fused electrons of an even scene, 120 000 pixels."""
    light = torch.full((1, 1, 300, 400), electrons / WELL_E)
    options = {"exposure_s": 0.01, "illuminance_lux": lux_for(FINE), "generator": [seed], **options}
    return fused(light, FINE, captures, **options)


@pytest.mark.parametrize(
    ("ratio", "below_db", "above_db", "range_db"),
    [
        (4, 40.30, 34.27, 83.1),
        (16, 40.30, 28.22, 95.1),
        (64, 40.30, 22.09, 107.2),
        (256, 40.30, 15.64, 119.2),
    ],
)
def test_snr_falls_at_the_switch_and_range_grows(
    ratio: float, below_db: float, above_db: float, range_db: float
) -> None:
    assert hdr.snr_db(FINE, (Capture(),), WELL_E) == pytest.approx(below_db, abs=0.005)
    assert hdr.snr_db(FINE, staggered(ratio), WELL_E) == pytest.approx(above_db, abs=0.006)
    assert hdr.dynamic_range_db(FINE, (Capture(),)) == pytest.approx(71.1, abs=0.05)
    assert hdr.dynamic_range_db(FINE, staggered(ratio)) == pytest.approx(range_db, abs=0.05)


def test_a_third_capture_takes_over_where_the_second_ends() -> None:
    three = staggered(16, 256)
    for electrons, alone in ((5_000.0, 1), (80_000.0, 16), (600_000.0, 256)):
        expected = electrons / alone / math.sqrt(electrons / alone + 2.45**2)
        assert hdr.snr_db(FINE, three, electrons) == pytest.approx(20 * math.log10(expected), abs=0.01)


@pytest.mark.parametrize(("electrons", "std_e"), [(9300.0, 184.9), (10_000.0, 357.7), (20_000.0, 565.0)])
def test_the_blend_is_unbiased_and_its_noise_is_known(electrons: float, std_e: float) -> None:
    seen = flat(electrons, staggered(16)).double()
    n = seen.numel()
    assert float(seen.mean()) == pytest.approx(electrons, rel=1e-3)
    # 5 deviations of a sample's; the anchors come from draws of their own, to their last digit
    assert float(seen.std()) == pytest.approx(std_e, rel=5 / math.sqrt(2 * n) + 0.002)


def test_noise_with_the_weights_of_the_mean() -> None:
    assert hdr.noise_e(FINE, staggered(16), 9300.0) == pytest.approx(183.4, abs=0.05)
    assert hdr.noise_e(FINE, staggered(16), 20_000.0) == pytest.approx(
        math.sqrt(16 * 20_000 + 256 * 2.45**2), rel=1e-4
    )


@pytest.mark.parametrize(
    "captures", [dual_gain(12.0), (Capture(gain_db=12.0), Capture(gain_db=6.0, start_s=0.0))]
)
@pytest.mark.parametrize("share", [0.5, 0.875, 0.92])
def test_two_gains_on_one_exposure_share_their_noise_in_the_blend(
    captures: tuple[Capture, Capture], share: float
) -> None:
    """5 deviations of a sample's of 120 000 pixels, and 0.6 % for weights that follow the noisy value."""
    electrons = share * hdr.saturations_e(FINE, captures)[0]
    seen = float(flat(electrons, captures).double().std())
    assert hdr.noise_e(FINE, captures, electrons) == pytest.approx(
        seen, rel=5 / math.sqrt(2 * 120_000) + 0.006
    )


@pytest.mark.parametrize("electrons", [500.0, 40_000.0])
def test_dark_current_is_noise_of_every_capture(electrons: float) -> None:
    """6000 e- of it in the first exposure, 375 in the second; without them the first would have 22 e-, not 81."""
    warm = replace(FINE, dark_current_e_s=6e5, dark_reference_c=25.0, dark_doubling_c=8.0)
    light = torch.full((1, 1, 300, 400), electrons / WELL_E)
    seen = fused(
        light, warm, staggered(16), exposure_s=0.01, illuminance_lux=lux_for(warm), generator=[1]
    ).double()
    expected = hdr.noise_e(warm, staggered(16), electrons, dark_e=6000.0)
    assert float(seen.std()) == pytest.approx(expected, rel=5 / math.sqrt(2 * seen.numel()))


@pytest.mark.parametrize("ratios", [(4,), (16,), (16, 256)])
def test_static_and_noise_free_it_is_linear_to_the_last_saturation(ratios: tuple[float, ...]) -> None:
    most = ratios[-1]
    light = torch.linspace(0, most, 501, dtype=torch.float64)[None, None, None]
    options = {"exposure_s": 0.01, "illuminance_lux": lux_for(IMX250), "noise": False, "quantised": False}
    seen = fused(light, IMX250, staggered(*ratios), generator=[0], **options)
    torch.testing.assert_close(seen, light * WELL_E, rtol=1e-6, atol=1e-3)
    beyond = fused(2 * light[..., -1:], IMX250, staggered(*ratios), generator=[0], **options)
    assert float(beyond) == pytest.approx(WELL_E * most, rel=1e-3)


def test_split_pixels_and_gains_are_linear_too() -> None:
    captures = (Capture(gain_db=12.0), Capture(start_s=0.0), Capture(sensitivity=0.05, start_s=0.0))
    light = torch.linspace(0, 19, 301, dtype=torch.float64)[None, None, None]
    seen = fused(
        light,
        IMX250,
        captures,
        exposure_s=0.01,
        illuminance_lux=lux_for(IMX250),
        generator=[0],
        noise=False,
        quantised=False,
    )
    torch.testing.assert_close(seen, light * WELL_E, rtol=1e-6, atol=1e-3)


def test_one_capture_is_the_plain_frame_to_the_bit() -> None:
    light = torch.rand(2, 3, 17, 23, generator=torch.Generator().manual_seed(1))
    given = {
        "exposure_s": 0.01,
        "illuminance_lux": 60.0,
        "velocity_px_s": (400.0, -90.0),
        "generator": [4, 9],
    }
    plain = simulate(light, IMX250, encoding="linear", **given)
    (alone,) = captured(light, IMX250, (Capture(),), **given)
    first, _ = captured(ExposedScene(light), IMX250, staggered(16), **given)
    steady, _ = captured(ExposedScene(light), IMX250, staggered(16), flicker=Flicker(Pwm(90.0, 1.0)), **given)
    assert torch.equal(plain, alone)
    assert torch.equal(plain, first)
    assert torch.equal(plain, steady)
    expected = (plain - IMX250.black_level_dn) / IMX250.system_gain_dn_per_e
    torch.testing.assert_close(fuse([alone], IMX250, (Capture(),)), expected)


def test_two_equal_captures_differ_in_their_noise_alone() -> None:
    light = torch.full((1, 1, 200, 300), 0.4)
    given = {"exposure_s": 0.01, "illuminance_lux": lux_for(IMX250), "generator": [4]}
    first, second = captured(ExposedScene(light), IMX250, staggered(1), **given)
    noise = torch.stack([first, second]).flatten(1)
    assert abs(float(torch.corrcoef(noise)[0, 1])) < 5 / math.sqrt(light.numel())
    mean_first, mean_second = captured(ExposedScene(light), IMX250, staggered(1), noise=False, **given)
    assert torch.equal(mean_first, mean_second)


def test_two_gains_on_one_exposure_share_their_electrons_and_have_no_ghost() -> None:
    light = torch.zeros(1, 1, 120, 200)
    light[..., 80:120] = 0.2
    given = {"exposure_s": 0.01, "illuminance_lux": lux_for(FINE), "generator": [4]}
    low, high = captured(
        ExposedScene(light), FINE, dual_gain(12.0), velocity_px_s=(2000.0, 0.0), noise=False, **given
    )
    torch.testing.assert_close((low - 6) / 10**0.6, high - 6, rtol=0, atol=1.0)
    frames = captured(ExposedScene(torch.full_like(light, 0.2)), FINE, dual_gain(12.0), **given)
    assert float(torch.corrcoef(torch.stack(frames).flatten(1))[0, 1]) > 0.99


def test_every_picture_depends_on_its_own_seed() -> None:
    light = torch.rand(2, 1, 9, 11, generator=torch.Generator().manual_seed(1))
    given = {"exposure_s": 0.01, "illuminance_lux": 60.0, "velocity_px_s": (300.0, 0.0)}
    both = fused(light, IMX250, staggered(16), generator=[4, 9], **given)
    assert torch.equal(both[1:], fused(light[1:], IMX250, staggered(16), generator=[9], **given))


class TestGhost:
    """A bar 20 px wide, four times as bright as what saturates capture 1, moves 10 px during it; R = 16.

    Sixteen samples to a pixel, so that edges are where they are.
    """

    FINENESS = 16
    X = (torch.arange(80 * FINENESS) + 0.5) / FINENESS - 40.0

    @pytest.fixture(autouse=True)
    def switches_at_saturation(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(hdr, "BLEND", (0.999, 1.0))

    def seen(self, captures: tuple[Capture, ...]) -> torch.Tensor:
        """Electrons along the row, as shares of saturation."""
        light = torch.where(self.X.abs() < 10, 4.0, 0.0)[None, None, None]
        electrons = fused(
            light,
            IMX250,
            captures,
            exposure_s=0.01,
            illuminance_lux=lux_for(IMX250),
            velocity_px_s=(1000.0 * self.FINENESS, 0.0),
            generator=[0],
            noise=False,
            quantised=False,
        )
        return electrons.flatten() / WELL_E

    def crossings(self, seen: torch.Tensor, level: float) -> list[float]:
        """Where it passes the level, px."""
        return [float(x) for x in self.X[:-1][(seen[:-1] > level) != (seen[1:] > level)]]

    def test_the_dark_notch_and_the_edges(self) -> None:
        """Capture 1 saturates to +-(w/2 + L(1/2 - 1/4)) = +-12.5; the bar of capture 2 begins at 5.31 - 10."""
        seen = self.seen(staggered(16))
        notch = (self.X > -12.4) & (self.X < -5.1)
        assert float(seen[notch].abs().max()) < 0.05
        left, fall, rise, right = self.crossings(seen, 0.5)
        assert (left, right) == pytest.approx((-13.75, 13.75), abs=0.1)
        assert (fall, rise) == pytest.approx((-12.5, -4.92), abs=0.1)

    def test_the_second_capture_lies_5_31_px_further_per_1000_px_s(self) -> None:
        """Read alone: centres (10 + 0.625) / 2 ms apart, and 1 px further for each ms of gap."""
        light = torch.where(self.X.abs() < 10, 0.5, 0.0)[None, None, None]
        for start_s, expected_px in ((None, 5.3125), (0.012, 7.3125)):
            _, second = captured(
                ExposedScene(light),
                IMX250,
                (Capture(), Capture(exposure_ratio=16, start_s=start_s)),
                exposure_s=0.01,
                illuminance_lux=lux_for(IMX250),
                velocity_px_s=(1000.0 * self.FINENESS, 0.0),
                generator=[0],
                noise=False,
                quantised=False,
            )
            weights = (second - IMX250.black_level_dn).flatten()
            assert float((weights * self.X).sum() / weights.sum()) == pytest.approx(expected_px, abs=0.02)

    def test_at_rest_there_is_none(self) -> None:
        seen = self.seen(dual_gain(0.0))
        assert len(self.crossings(seen, 0.5)) == 2


def test_a_pulsed_lamp_may_miss_a_short_capture_and_not_the_long_one() -> None:
    light, lamp = torch.full((1, 1, 6, 8), 0.05), Pwm(90.0, 0.1, phase=0.2)
    long, short = captured(
        ExposedScene(light),
        IMX250,
        staggered(16),
        exposure_s=1 / 90,
        illuminance_lux=lux_for(IMX250),
        generator=[0],
        flicker=Flicker(lamp),
        noise=False,
        quantised=False,
    )
    assert float(short.max()) == pytest.approx(IMX250.black_level_dn)
    expected = 0.05 * WELL_E * (1 / 90) / 0.01 * IMX250.system_gain_dn_per_e + IMX250.black_level_dn
    assert float(long.mean()) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("name", ["imx250", "imx250c"])
@pytest.mark.parametrize("full_well_e", [WELL_E, 5000.0])
def test_developed_white_is_white(name: str, full_well_e: float) -> None:
    """Of a mosaic, too, and where the well ends below the converter's range."""
    camera = replace(Camera.preset(name), full_well_e=full_well_e)
    light = torch.full((1, 3, 8, 10), 8.0)
    light[..., 5:] = 4.0
    lux = lux_for(camera)
    given = {"exposure_s": 0.01, "illuminance_lux": lux, "generator": [1], "noise": False, "quantised": False}
    electrons = fused(light, camera, staggered(16, 64), **given)
    seen = developed(electrons, camera, white_e=8 * WELL_E)
    assert seen.shape == light.shape
    assert float(seen[..., :3].min()) == pytest.approx(1.0, abs=1e-3)
    half = float(srgb_from_linear(torch.tensor(0.5)))
    assert float(seen[..., 8:].mean()) == pytest.approx(half, abs=2e-3)


@pytest.mark.parametrize(
    ("captures", "message"),
    [
        ((), r"captures = \(\): must be a list of at least one"),
        ((Capture(), Capture(16.0, start_s=0.005)), "number 2, 5 to 5.625 ms, overlaps number 1, 0 to 10 ms"),
        ((Capture(start_s=0.001),), "start_s = 0.001 of the first; must be 0"),
        ((Capture(), Capture(0.5)), "captures: number 2 saturates at 5358 e- of the first"),
        ((Capture(gain_db=30.0),), "captures: gain_db = 30.0: must be finite and >= 0 and <= 24"),
    ],
)
def test_bad_captures(captures: tuple[Capture, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message) as error:
        captured(ExposedScene(torch.ones(1, 1, 2, 3)), IMX250, captures, exposure_s=0.01, illuminance_lux=1.0)
    assert "\n" not in str(error.value)


def test_bad_numbers() -> None:
    with pytest.raises(ValueError, match=r"exposure_ratio = 0\.0: must be"):
        Capture(0.0)
    with pytest.raises(ValueError, match="must be one per capture, 2"):
        fuse([torch.ones(1, 1, 2, 3)], IMX250, staggered(16))


def test_a_camera_file_states_captures(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(
        "base: imx250\ncaptures: [{}, {exposure_ratio: 16}, {exposure_ratio: 256.0}]\n"
    )
    camera = Camera.load(tmp_path / "mine.yaml")
    assert camera.captures == staggered(16, 256)
    camera.save(tmp_path / "again.json")
    assert Camera.load(tmp_path / "again.json") == camera
    light = torch.full((1, 1, 3, 4), 0.5)
    given = {"exposure_s": 0.01, "illuminance_lux": 50.0, "generator": [1]}
    with pytest.raises(ValueError, match="camera: 'mine' makes a picture of 3 captures"):
        simulate(light, camera, **given)
    with pytest.raises(ValueError, match="camera: 'mine' makes a picture of 3 captures"):
        Exposure(camera, 0.01, 50.0)
    plain = fused(light, IMX250, staggered(16, 256), **given)
    assert torch.equal(fused(light, camera, camera.captures, **given), plain)
    (tmp_path / "bad.yaml").write_text("base: imx250\ncaptures: [{}, {ratio: 16}]\n")
    with pytest.raises(ValueError, match="captures: figure 'ratio' is unknown"):
        Camera.load(tmp_path / "bad.yaml")
