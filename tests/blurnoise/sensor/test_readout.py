"""The sensor's law: moments, photon transfer, exact distribution, limits."""

import math
from dataclasses import fields

import numpy as np
import pytest
import torch
from scipy.stats import norm, poisson

from blurnoise import Camera
from blurnoise.camera import PRESETS
from blurnoise.camera.camera_files import RECORDS
from blurnoise.camera.radiometry import dark_electrons, photoelectrons
from blurnoise.sensor import readout as sensor

BASE = Camera.preset("imx250").with_figures(
    name="test",
    quantum_efficiency=0.6,
    full_well_e=10000.0,
    system_gain_dn_per_e=0.4,
    read_noise_e=3.0,
    black_level_dn=40.0,
)
GIVEN = {"exposure_s": 0.01, "temperature_c": 20.0}


def frame(mean_e, camera=BASE, size=400, seed=1, **changes):
    flat = torch.full((1, 1, size, size), mean_e)
    return sensor.read_out(flat, camera, **GIVEN | {"generator": [seed]} | changes)


def exact_law(mean_e, camera):
    """Probability of every digital number: Poisson counts, normal read noise, rounding, limits."""
    counts = np.arange(int(mean_e + 12 * math.sqrt(mean_e) + 40))
    edges = (
        np.arange(camera.sensor.full_scale_dn) + 0.5 - camera.sensor.black_level_dn
    ) / camera.sensor.system_gain_dn_per_e
    below = norm.cdf((edges[:, None] - counts) / camera.sensor.read_noise_e) @ poisson.pmf(counts, mean_e)
    return np.diff(np.concatenate([[0], below, [1]]))


def departs(dn, law):
    """Chi-square of the k numbers expected 25 times or more: is it beyond k + 5 sqrt(2 k) + 10?

    The 10 leave room for the merged draw's distance of 0.0012 at most for 2.45 e-.
    """
    observed = np.bincount(dn.long().flatten().numpy(), minlength=len(law))
    expected = law * observed.sum()
    big = expected >= 25
    cells = int(big.sum())
    return ((observed - expected)[big] ** 2 / expected[big]).sum() > cells + 5 * math.sqrt(2 * cells) + 10


@pytest.mark.parametrize("read_noise_e", [0.5, 2.45])
@pytest.mark.parametrize("mean_e", [0.3, 3.0, 10.0, 100.0, 1000.0])
def test_frames_follow_the_exact_law(mean_e, read_noise_e):
    camera = BASE.with_figures(read_noise_e=read_noise_e, system_gain_dn_per_e=1.0)
    assert not departs(frame(mean_e, camera, seed=3), exact_law(mean_e, camera))


def test_dark_current_doubles():
    camera = BASE.with_figures(dark_current_e_s=100.0, dark_reference_c=20.0, dark_doubling_c=8.0)
    assert float(dark_electrons(camera, torch.tensor([2.0]), torch.tensor([36.0]))) == pytest.approx(800)


@pytest.mark.parametrize("fidelity", ["auto", "full", "with derivatives"])
@pytest.mark.parametrize("read_noise_e", [0.6, 10.0])
@pytest.mark.parametrize("full_well_e", [5000.0, 5790.0])
@pytest.mark.parametrize("fill", [0.97, 1.0, 1.02, 30.0])
def test_at_the_full_well_charge_clips_and_read_noise_stays(fill, full_well_e, read_noise_e, fidelity):
    """Against NumPy's own chain: counts, the well, read noise, gain, rounding, converter of 5793 e-, by every route.

    n = 160000 each: means within 5 sigma sqrt(2/n), variances within 5 sqrt(2 (kurtosis + 2) / n) of themselves,
    kurtosis excess below 4 where a well cuts; 2 % for the normal in place of counts.
    """
    camera = BASE.with_figures(full_well_e=full_well_e, read_noise_e=read_noise_e, system_gain_dn_per_e=0.7)
    random = np.random.default_rng(4)
    charge = np.minimum(random.poisson(fill * full_well_e, 160_000), full_well_e)
    expected = np.rint(0.7 * (charge + random.normal(0, read_noise_e, 160_000)) + 40).clip(0, 4095)
    derivatives = fidelity == "with derivatives"
    flat = torch.full((1, 1, 400, 400), fill * full_well_e, requires_grad=derivatives)
    dn = sensor.read_out(flat, camera, **GIVEN, generator=[6], fidelity="auto" if derivatives else fidelity)
    dn, n = dn.detach().numpy().astype(float), 160_000
    assert dn.mean() == pytest.approx(expected.mean(), abs=5 * expected.std() * math.sqrt(2 / n))
    assert dn.var() == pytest.approx(expected.var(), rel=5 * math.sqrt(2 * 6 / n) + 0.02)


def test_the_lower_of_well_and_converter_clips():
    well = BASE.with_figures(full_well_e=5000.0)
    assert frame(1e9, well, noise=False).unique().tolist() == [2040.0]
    assert well.sensor.saturation_e == 5000
    converter = BASE.with_figures(full_well_e=1e6)
    assert frame(1e9, converter).unique().tolist() == [4095.0]
    assert converter.sensor.saturation_e == pytest.approx((4095 - 40) / 0.4)
    for camera in PRESETS.values():  # whose wells are what their converters hold
        assert math.isinf(camera.sensor.well_limit_e)
        assert camera.sensor.saturated_dn == camera.sensor.full_scale_dn
        assert frame(1e9, camera, 50).unique().tolist() == [camera.sensor.full_scale_dn]


def test_negative_means_count_as_zero():
    assert torch.equal(frame(-5.0), frame(0.0))
    assert frame(-5.0, BASE.with_figures(read_noise_e=0.0)).unique().tolist() == [40.0]


def test_presets_are_whole_and_sourced():
    kinds = ("quoted", "derived", "chosen", "assumed", "effective", "no public", "the tool", "without")
    settings = {
        "name",
        "sources",
        "white_balance",
        "demosaic",
        "tone",
        "jpeg_quality",
        "jpeg_subsampling",
    }
    for name, camera in PRESETS.items():
        assert Camera.preset(name) is camera
        figures = set(camera.to_dict()) - settings
        usual = {
            entry.name
            for part, record in RECORDS.items()
            for entry in fields(record)
            if getattr(getattr(camera, part), entry.name) == entry.default
        }
        assert figures - usual <= set(camera.sources) <= figures | {"tone"}, name
        for entry, source in camera.sources.items():
            assert source.startswith(kinds), (name, entry, source)


def test_lin2024_counts_a_quantum_as_one_digital_number():
    """Planck-lit 5774.616 of them at 50 lux and 30 ms."""
    camera = Camera.preset("lin2024")
    dn = photoelectrons(camera, 50.0, 0.030) * camera.sensor.system_gain_dn_per_e
    assert dn == pytest.approx(5774.616, rel=1e-4)


def test_rounding_of_little_noise_is_not_white():
    """Read noise of 0.1 DN beside a code's centre gives one code; EMVA's 1/12 would be wrong here."""
    assert float(frame(0.0, BASE.with_figures(system_gain_dn_per_e=0.02, read_noise_e=5.0)).var()) < 0.001


def test_a_camera_that_is_no_preset_is_named():
    with pytest.raises(ValueError, match="imx250"):
        Camera.preset("hasselblad")
