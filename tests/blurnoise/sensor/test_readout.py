"""The sensor's law: moments, photon transfer, exact distribution, limits."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
import torch
from made_frames import from_photons
from scipy.stats import norm, poisson

from blurnoise import Camera
from blurnoise.optics.camera import PRESETS
from blurnoise.optics.radiometry import dark_electrons, photoelectrons
from blurnoise.picture.develop import develop, develop_8bit
from blurnoise.sensor import readout as sensor
from blurnoise.sensor.stage import MERGE_READ_NOISE_E
from blurnoise.sensor.stages import noisy_electrons

BASE = Camera(
    name="test",
    pixel_pitch_um=3.0,
    f_number=2.0,
    transmission=0.9,
    quantum_efficiency=0.6,
    full_well_e=10000.0,
    system_gain_dn_per_e=0.4,
    read_noise_e=3.0,
    black_level_dn=40.0,
    bit_depth=12,
)


def frame(
    mean_e: float, camera: Camera = BASE, size: int = 400, seed: int = 1, **changes: object
) -> torch.Tensor:
    flat = torch.full((1, 1, size, size), mean_e)
    arguments = {"exposure_s": 0.01, "temperature_c": 20.0, "generator": [seed], **changes}
    return sensor.read_out(flat, camera, **arguments)


def exact_law(mean_e: float, camera: Camera) -> np.ndarray:
    """Probability of every digital number: Poisson counts, normal read noise, rounding, limits."""
    counts = np.arange(int(mean_e + 12 * math.sqrt(mean_e) + 40))
    edges = (np.arange(camera.full_scale_dn) + 0.5 - camera.black_level_dn) / camera.system_gain_dn_per_e
    below = norm.cdf((edges[:, None] - counts) / camera.read_noise_e) @ poisson.pmf(counts, mean_e)
    return np.diff(np.concatenate([[0], below, [1]]))


def drawn_law(mean_e: float, camera: Camera) -> np.ndarray:
    """Probability of every digital number under the merged draw, by integration over its normal."""
    z = torch.linspace(-8, 8, 400001, dtype=torch.float64)
    weight = torch.exp(-z * z / 2)
    electrons = noisy_electrons(torch.full_like(z, mean_e), camera.read_noise_e, z)
    dn = (
        (electrons * camera.system_gain_dn_per_e + camera.black_level_dn)
        .round()
        .clamp(0, camera.full_scale_dn)
    )
    return np.bincount(dn.long().numpy(), (weight / weight.sum()).numpy(), camera.full_scale_dn + 1)


@pytest.mark.parametrize("read_noise_e", [MERGE_READ_NOISE_E, 1.5, 2.45, 6.0])
@pytest.mark.parametrize(
    "gain", [1.0, *(pytest.param(gain, marks=pytest.mark.slow) for gain in (0.1, 0.4, 4.0))]
)
def test_merged_draw_is_close_to_the_exact_law(read_noise_e: float, gain: float) -> None:
    """Total variation distance below 1e-2 everywhere and below 1e-3 from 100 electrons on."""
    camera = replace(BASE, read_noise_e=read_noise_e, system_gain_dn_per_e=gain)
    for mean_e in (0.01, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 800.0):
        distance = 0.5 * np.abs(exact_law(mean_e, camera) - drawn_law(mean_e, camera)).sum()
        assert distance < (1e-3 if mean_e >= 100 else 1e-2), mean_e


@pytest.mark.parametrize("read_noise_e", [0.5, 2.45])
@pytest.mark.parametrize("mean_e", [0.3, 3.0, 10.0, 100.0, 1000.0])
def test_frames_follow_the_exact_law(mean_e: float, read_noise_e: float) -> None:
    """Chi-square of 160000 pixels over the k cells expected to hold at least 25: below k + 5 sqrt(2k) + 10.

    The 10 leave room for the merged draw's distance of 0.0012 at most for 2.45 e-.
    """
    camera = replace(BASE, read_noise_e=read_noise_e, system_gain_dn_per_e=1.0)
    statistic, cells = chi_square(frame(mean_e, camera, seed=3), exact_law(mean_e, camera))
    assert statistic < cells + 5 * math.sqrt(2 * cells) + 10


def chi_square(dn: torch.Tensor, law: np.ndarray) -> tuple[float, int]:
    observed = np.bincount(dn.long().flatten().numpy(), minlength=len(law))
    expected = law * observed.sum()
    big = expected >= 25
    return float(((observed - expected)[big] ** 2 / expected[big]).sum()), int(big.sum())


def test_a_plain_normal_would_be_noticed() -> None:
    """The same test rejects a draw without the skewness of Poisson."""
    camera = replace(BASE, read_noise_e=1.0, system_gain_dn_per_e=1.0)
    z = torch.randn(160000, generator=torch.Generator().manual_seed(5), dtype=torch.float64)
    plain = (3.0 + math.sqrt(4.0) * z + 40).round().clamp(0, 4095)
    statistic, cells = chi_square(plain, exact_law(3.0, camera))
    assert statistic > cells + 5 * math.sqrt(2 * cells) + 10


def test_merged_draw_has_the_exact_moments() -> None:
    """Integrated over the normal law: mean, variance and third moment of Poisson + normal noise; with a bend f of the
    variance f mean and f^(3/2) mean of Poisson's."""
    z = torch.linspace(-9, 9, 200001, dtype=torch.float64)
    weight = torch.exp(-z * z / 2)
    weight /= weight.sum()
    for mean_e, read, f in ((0.2, 1.0, 1.0), (5.0, 2.45, 1.0), (300.0, 2.45, 1.0), (300.0, 2.45, 0.4)):
        bend = None if f == 1 else torch.full_like(z, f)
        x = noisy_electrons(torch.full_like(z, mean_e), read, z, bend)
        centred = x - mean_e
        assert float((weight * x).sum()) == pytest.approx(mean_e, abs=1e-9)
        assert float((weight * centred**2).sum()) == pytest.approx(f * mean_e + read**2, rel=1e-9)
        assert float((weight * centred**3).sum()) == pytest.approx(f**1.5 * mean_e, rel=0.08)


def test_dark_current_doubles() -> None:
    camera = replace(BASE, dark_current_e_s=100.0, dark_reference_c=20.0, dark_doubling_c=8.0)
    exposure, warm = torch.tensor([2.0]), torch.tensor([36.0])
    assert float(dark_electrons(camera, exposure, warm)) == pytest.approx(100 * 2 * 4)
    dn = frame(0.0, camera, exposure_s=2.0, temperature_c=36.0).double()
    assert float(dn.mean()) == pytest.approx(40 + 0.4 * 800, rel=1e-3)
    assert float(dn.var()) == pytest.approx(0.16 * (800 + 9) + 1 / 12, rel=0.02)


def test_a_full_well_clips_before_read_noise_and_a_full_converter_after_it() -> None:
    full_well_first = replace(BASE, full_well_e=5000.0)
    assert full_well_first.well_limit_e == 5000
    assert frame(1e9, full_well_first, noise=False).unique().tolist() == [2040.0]
    converter_first = replace(BASE, full_well_e=1e6)
    assert frame(1e9, converter_first).unique().tolist() == [4095.0]
    assert full_well_first.saturation_e == 5000
    assert converter_first.saturation_e == pytest.approx((4095 - 40) / 0.4)


@pytest.mark.parametrize("fidelity", ["auto", "full", "with derivatives"])
@pytest.mark.parametrize("read_noise_e", [0.6, 10.0])
@pytest.mark.parametrize("fill", [0.97, 0.99, 1.0, 1.02, 30.0])
def test_at_the_full_well_charge_clips_and_read_noise_stays(
    fill: float, read_noise_e: float, fidelity: str
) -> None:
    """Against NumPy's own chain: counts, the well, read noise, gain, rounding, by every route.

    n = 160000 each: means within 5 sigma sqrt(2/n), variances within 5 sqrt(2 (kurtosis + 2) / n) of themselves,
    kurtosis excess below 4 where a well cuts; 2 % for the normal in place of counts.
    """
    camera = replace(BASE, full_well_e=5000.0, read_noise_e=read_noise_e, system_gain_dn_per_e=0.7)
    random = np.random.default_rng(4)
    charge = np.minimum(random.poisson(fill * 5000.0, 160_000), 5000)
    expected = np.rint(0.7 * (charge + random.normal(0, read_noise_e, 160_000)) + 40).clip(0, 4095)
    flat = torch.full((1, 1, 400, 400), fill * 5000.0, requires_grad=fidelity == "with derivatives")
    given = {"exposure_s": 0.01, "temperature_c": 20.0, "generator": [6]}
    how: Any = "auto" if fidelity == "with derivatives" else fidelity
    dn = sensor.read_out(flat, camera, **given, fidelity=how).detach().numpy().astype(float)
    n, spread = dn.size, expected.std()
    assert dn.mean() == pytest.approx(expected.mean(), abs=5 * spread * math.sqrt(2 / n))
    assert dn.var() == pytest.approx(expected.var(), rel=5 * math.sqrt(2 * 6 / n) + 0.02)
    if fill > 2 and read_noise_e == 10.0:
        assert dn.std() == pytest.approx(math.hypot(0.7 * read_noise_e, 12**-0.5), rel=0.02)
        assert (dn >= camera.saturated_dn).mean() > 0.99


def test_a_well_that_fills_the_converter_is_its_limit() -> None:
    """Presets' wells are what their converters hold: saturation is full scale, without noise."""
    for camera in PRESETS.values():
        assert math.isinf(camera.well_limit_e)
        assert camera.saturated_dn == camera.full_scale_dn
        assert frame(1e9, camera, 50).unique().tolist() == [camera.full_scale_dn]


def test_dark_noise_goes_below_the_black_level() -> None:
    """Electrons are not clipped at 0: a dark frame's mean is the black level, and half lie below it."""
    dn = frame(0.0).double()
    assert float(dn.mean()) == pytest.approx(40, abs=5 * math.sqrt(1.52 / dn.numel()))
    assert float((dn < 40).double().mean()) == pytest.approx(float((dn > 40).double().mean()), abs=0.01)
    assert float(frame(0.0, replace(BASE, black_level_dn=0.0)).min()) == 0


def test_negative_means_count_as_zero() -> None:
    assert torch.equal(frame(-5.0), frame(0.0))
    quiet = replace(BASE, read_noise_e=0.0)
    assert frame(-5.0, quiet).unique().tolist() == [40.0]


def test_each_image_has_its_own_exposure_and_seed() -> None:
    camera = replace(BASE, dark_current_e_s=1000.0)
    flat = torch.zeros(2, 1, 50, 60)
    both = sensor.read_out(flat, camera, exposure_s=[0.0, 1.0], temperature_c=20.0, generator=[1, 2])
    alone = sensor.read_out(flat[:1], camera, exposure_s=1.0, temperature_c=20.0, generator=[2])
    assert torch.equal(both[1:], alone)
    assert float(both[0].mean()) == pytest.approx(40, abs=0.2)


def test_differentiable_route_gives_the_same_frame() -> None:
    flat = torch.rand(1, 2, 30, 40, generator=torch.Generator().manual_seed(2)) * 3000
    arguments = {"exposure_s": 0.01, "temperature_c": 20.0, "generator": [4]}
    plain = sensor.read_out(flat, BASE, **arguments)
    through = sensor.read_out(flat.clone().requires_grad_(), BASE, **arguments)
    assert float((plain - through.detach()).abs().max()) <= 1  # rounding may fall either way
    assert torch.equal(plain, plain.round())


def test_develop_is_black_to_white() -> None:
    dn = torch.tensor([0.0, 40.0, 2067.5, 4095.0]).round()
    linear = develop(dn, BASE, encoding="linear")
    torch.testing.assert_close(linear, ((dn - 40) / 4055).clamp(0, 1))
    coded = develop(dn, BASE)
    assert coded.tolist()[1] == 0
    assert coded.tolist()[3] == pytest.approx(1)
    assert develop_8bit(dn, BASE).tolist() == [0, 0, round(255 * float(coded[2])), 255]
    with pytest.raises(ValueError, match="encoding"):
        develop(dn, BASE, encoding="gamma")  # type: ignore[arg-type]


@pytest.mark.parametrize("bits", [1, 16])
def test_converters_from_one_bit_to_sixteen(bits: int) -> None:
    full_scale = 2**bits - 1
    gain = full_scale / BASE.full_well_e
    camera = replace(BASE, bit_depth=bits, system_gain_dn_per_e=gain, black_level_dn=0.0)
    dn = frame(5000.0, camera)
    assert 0 <= float(dn.min()) <= float(dn.max()) <= full_scale
    assert float(dn.mean()) == pytest.approx(full_scale / 2, rel=0.05)


def test_presets_are_whole_and_sourced() -> None:
    for name, camera in PRESETS.items():
        assert Camera.preset(name) is camera
        kinds = ("quoted", "derived", "chosen", "assumed", "effective", "no public", "the tool", "without")
        stated = set(camera.to_dict()) - {
            *("name", "sources", "defocus_counts_pixel", "white_balance", "demosaic", "tone", "jpeg_quality")
        }  # names and settings, no figures
        usual = {entry.name for entry in fields(Camera) if getattr(camera, entry.name) == entry.default}
        assert stated - usual <= set(camera.sources) <= stated | {"tone"}, name
        for entry, source in camera.sources.items():
            assert source.startswith(kinds), (name, entry, source)


def test_lin2024_counts_a_quantum_as_one_digital_number() -> None:
    """Planck-lit 5774.616 quanta at 50 lux and 30 ms are 5774.6 DN before the 12 bits clip."""
    camera = Camera.preset("lin2024")
    dn = photoelectrons(camera, 50.0, 0.030) * camera.system_gain_dn_per_e
    assert dn == pytest.approx(5774.616, rel=1e-4)
    assert 30 * 4095 / dn == pytest.approx(21.3, abs=0.1)  # ms to saturation at 50 lux


@pytest.mark.parametrize("quanta", [30.0, 500.0, 3000.0])
def test_lin2024_has_the_tools_statistics(quanta: float) -> None:
    """The tool's chain written out: counts of quanta / 5.88, read noise, times 5.88, cut to whole numbers.

    n = 160000: means agree to 5 sigma sqrt(2 / n) and its half digital number, deviations to 1.2 %.
    """
    random = np.random.default_rng(8)
    electrons = random.poisson(quanta / 5.88, 160_000) + random.normal(0, 2.44, 160_000)
    tool = np.trunc(np.maximum(electrons * 5.88, 1))
    camera = Camera.preset("lin2024")
    ours = sensor.read_out(
        torch.full((1, 1, 400, 400), quanta / 5.88),
        camera,
        exposure_s=0.03,
        temperature_c=25.0,
        generator=[8],
    ).numpy()
    spread = 5.88 * math.sqrt(quanta / 5.88 + 2.44**2)
    floor = 1.5 if quanta < 100 else 0.0  # its lower clip at 1, ours at 0
    assert ours.mean() == pytest.approx(tool.mean() + 0.5, abs=5 * spread * math.sqrt(2 / 160_000) + floor)
    assert ours.std() == pytest.approx(tool.std(), rel=0.012 if quanta > 100 else 0.05)
    # Electrons drawn from the quanta themselves would have 2.4 times its signal-to-noise ratio.
    assert quanta / tool.std() < 0.5 * quanta / math.sqrt(quanta + 2.44**2)


def test_unknown_preset_lists_the_names() -> None:
    with pytest.raises(ValueError, match="imx250"):
        Camera.preset("hasselblad")
    with pytest.raises(TypeError, match="bit_depth"):
        replace(BASE, bit_depth=12.5)  # type: ignore[arg-type]


@pytest.mark.parametrize("fidelity", ["auto", "full"])
@pytest.mark.parametrize("photons", [0.0, 1e-9, 1e9])
@pytest.mark.parametrize("read_noise_e", [0.0, 0.3, 3.0])
def test_extremes_of_light(photons: float, read_noise_e: float, fidelity: str) -> None:
    camera = replace(BASE, read_noise_e=read_noise_e)
    dn = from_photons(
        torch.full((1, 1, 50, 50), photons), camera, exposure_s=100.0, generator=[1], fidelity=fidelity
    )
    assert torch.isfinite(dn).all()
    if photons == 1e9:  # a full well, which read noise follows: n = 2500
        assert float(dn.mean()) == pytest.approx(camera.clip_dn, abs=5 * (0.4 * read_noise_e + 0.3) / 50)
        assert float(dn.std()) == pytest.approx(0.4 * read_noise_e, abs=0.35)
    elif read_noise_e == 0:
        assert torch.equal(dn, torch.full_like(dn, 40.0))
    else:
        assert float(dn.mean()) == pytest.approx(40, abs=0.2)


@pytest.mark.parametrize("temperature_c", [-273.15, -40.0, 150.0])
def test_extremes_of_temperature(temperature_c: float) -> None:
    camera = replace(BASE, dark_current_e_s=1.0, read_noise_e=1.5)
    photons = torch.zeros(1, 1, 30, 30)
    dn = from_photons(photons, camera, exposure_s=1.0, temperature_c=temperature_c, generator=[1])
    assert torch.isfinite(dn).all()
    assert float(dn.max()) <= camera.clip_dn + 6 * 0.4 * 1.5
    for beyond in (-274.0, 301.0):
        with pytest.raises(ValueError, match="temperature_c"):
            from_photons(photons, camera, exposure_s=1.0, temperature_c=beyond)


@pytest.mark.parametrize(("gain", "clip_dn"), [(0.01, 140.0), (5.0, 4095.0)])
def test_the_lower_of_well_and_converter_clips(gain: float, clip_dn: float) -> None:
    camera = replace(BASE, system_gain_dn_per_e=gain, read_noise_e=0.0)
    dn = from_photons(torch.full((1, 1, 9, 9), 1e6), camera, exposure_s=0.01, generator=[1])
    assert torch.equal(dn, torch.full_like(dn, clip_dn))


def test_rounding_of_little_noise_is_not_white() -> None:
    """Read noise of 0.1 DN beside a code's centre gives one code; EMVA's 1/12 would be wrong here."""
    camera = replace(BASE, system_gain_dn_per_e=0.02, read_noise_e=5.0)
    dn = from_photons(torch.zeros(1, 1, 200, 200), camera, exposure_s=0.0, generator=[2])
    assert float(dn.var()) < 0.001


def test_bad_arguments_are_named() -> None:
    with pytest.raises(TypeError, match="half precision"):
        from_photons(torch.zeros(1, 1, 2, 2, dtype=torch.float16), BASE, exposure_s=0.01)
    with pytest.raises(ValueError, match="fidelity"):
        from_photons(torch.zeros(1, 1, 2, 2), BASE, exposure_s=0.01, fidelity="best")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="black_level_dn"):
        replace(BASE, black_level_dn=4095.0)
