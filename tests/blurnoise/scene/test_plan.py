"""The plan: what it leaves out stays within its tolerance, and it says so."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import torch
from exposed_frames import BUSY, budget
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from blurnoise import Camera, photoelectrons, simulate
from blurnoise.camera.lens import Lens
from blurnoise.camera.sensor import Sensor

ORDER = """distortion, objects, lateral colour, defocus, diffraction, measured MTF, motion, motion variation,
rolling shutter, vignetting, spectral integration, PRNU, dark current, shot noise, read noise, DSNU, quantisation"""
CAMERAS = st.fixed_dictionaries(
    {
        "system_gain_dn_per_e": st.sampled_from([0.005, 0.05, 0.4, 3.0]),
        "read_noise_e": st.sampled_from([0.0, 0.3, 2.5, 12.0]),
        "dark_current_e_s": st.sampled_from([0.0, 0.1, 10.0, 1000.0]),
        "prnu": st.sampled_from([0.0, 1e-5, 0.01]),
        "dsnu_e": st.sampled_from([0.0, 0.05, 4.0]),
        "defocus_radius_px": st.sampled_from([0.0, 0.01, 1.5]),
    }
).map(lambda figures: BUSY.with_figures(**figures))


def test_the_stages_stand_in_the_order_of_the_physics():
    chosen = budget(BUSY, exposure_s=0.02, illuminance_lux=100.0, displacement_px=(12.0, 0.0))
    order = ORDER.replace("\n", " ").split(", ")
    assert [stage.name for stage in chosen.stages if stage.name in order] == order
    by_name = {stage.name: stage for stage in chosen.stages}
    white_e = 100 * 0.02 * 4.0**2 * 0.9 / (4 * 2.8**2) * 0.5 * 10724  # D55 photons per lux s um^2, 400-700 nm
    assert by_name["shot noise"].contribution_dn == pytest.approx(0.4 * math.sqrt(white_e), rel=2e-3)
    assert by_name["read noise"].contribution_dn == pytest.approx(1.0)
    assert by_name["DSNU"].contribution_dn == pytest.approx(1.2)
    assert by_name["PRNU"].contribution_dn == pytest.approx(0.4 * 0.01 * white_e, rel=2e-3)
    assert by_name["motion"].kept
    assert "12 px" in by_name["motion"].how
    assert by_name["spectral integration"].how == "none here"


def test_a_larger_tolerance_keeps_less():
    settings_ = {"exposure_s": 0.01, "illuminance_lux": 50.0, "displacement_px": (3.0, 1.0)}
    kept = [
        {stage.name for stage in budget(BUSY, **settings_, tolerance_dn=tolerance).stages if stage.kept}  # type: ignore[arg-type]
        for tolerance in (0.01, 1.3, 30.0, 1e4)
    ]
    for more, less in pairwise(kept):
        assert less < more
    assert kept[-1] == {"quantisation"}


@settings(max_examples=60, deadline=None)
@given(
    CAMERAS,
    st.floats(0, 0.2),
    st.sampled_from([0.0, 0.1, 30.0, 5000.0]),
    st.floats(0, 40),
    st.sampled_from([0.05, 0.5, 4.0]),
)
@example(
    BUSY.with_figures(read_noise_e=0.0, prnu=0.0, dsnu_e=0.0, defocus_radius_px=0.01),
    0.03125,
    30.0,
    0.0234,
    0.05,
)
@example(
    BUSY.with_figures(system_gain_dn_per_e=0.005, dark_current_e_s=0.0, prnu=0.0, dsnu_e=0.0),
    0.125,
    30.0,
    0.0,
    0.5,
)
def test_what_is_left_out_is_within_the_tolerance(camera, exposure_s, lux, length, tolerance):
    """The mean frame of auto is within the tolerance, RMS, of the full one, and so is its noise."""
    image = (torch.rand(1, 1, 48, 48, generator=torch.Generator().manual_seed(1)) > 0.5).double()
    x_px_s = length / exposure_s if exposure_s > 1e-3 else 0.0
    at: dict[str, Any] = {"exposure_s": exposure_s, "illuminance_lux": lux, "tolerance_dn": tolerance}
    common = {
        **at,
        "velocity_px_s": (x_px_s, 0.0),
        "encoding": "linear",
        "border": "circular",
        "quantised": False,
    }
    full = simulate(image, camera, fidelity="full", noise=False, **common)
    auto = simulate(image, camera, noise=False, **common)
    assert float((full - auto).square().mean().sqrt()) <= 1.1 * tolerance + 1e-6
    chosen = budget(camera, **at, displacement_px=(x_px_s * exposure_s, 0.0))
    assert chosen.left_out_dn <= tolerance
    left_out = [stage.contribution_dn for stage in chosen.stages if not stage.kept]
    rounding = math.sqrt(max(0.0, chosen.left_out_dn**2 - math.hypot(*left_out) ** 2))
    spread = {"PRNU", "dark current", "shot noise", "read noise", "DSNU"}
    lost = math.hypot(
        *(each.contribution_dn for each in chosen.stages if not each.kept and each.name in spread)
    )
    assert min(abs(rounding - each) for each in (0.0, 0.5, math.sqrt(min(lost, 0.25)))) < 1e-3
    if rounding < 1e-3:  # nothing that spreads was left out, or read noise stays
        dithered = chosen.camera.sensor.read_noise_e * chosen.camera.sensor.system_gain_dn_per_e >= 0.5
        assert dithered or lost <= max(1e-6, 4095 / 2**24)


EIGHT_BIT = Camera(
    "8 bits of a deep well",
    Lens(f_number=2.8, transmission=0.9),
    Sensor(
        pixel_pitch_um=4.0,
        quantum_efficiency=0.5,
        full_well_e=250_000.0,
        system_gain_dn_per_e=1e-3,
        read_noise_e=10.0,
        bit_depth=8,
    ),
)


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(
    st.sampled_from([0.0, 0.002, 0.05, 0.3, 0.5, 0.8]),
    st.sampled_from([0.0, 0.03, 0.07]),
    st.sampled_from([1e-4, 0.003, 0.02]),
    st.sampled_from([0.02, 0.1, 0.3]),
)
@example(0.01, 0.0, 0.0, 0.1)  # 9.49 DN with 0.098 DN of shot noise
@example(0.8, 0.07, 0.003, 0.1)  # read noise that dithers, beside which DSNU may go
def test_the_variance_after_rounding_holds_at_every_fraction_of_the_mean(read_dn, dsnu_dn, prnu, tolerance):
    """Means of 9 to 10 DN in steps of 0.01: the exact law of the rounded normal, and auto within the tolerance.

    Five standard errors of 10 000 pixels, from the law's fourth moment and the pattern's share of the mean, which a
    set of pixels has in common; beside them 1.2 tolerance^2, since rounding turns a variance by up to 13 %.
    """
    camera = EIGHT_BIT.with_figures(read_noise_e=1e3 * read_dn, dsnu_e=1e3 * dsnu_dn, prnu=prnu)
    means = np.arange(9.0, 10.0, 0.01)
    per_lux = photoelectrons(camera, 1.0, 0.01) * camera.sensor.system_gain_dn_per_e
    dn = simulate(
        torch.ones(len(means), 1, 100, 100, dtype=torch.float64),
        camera,
        exposure_s=0.01,
        illuminance_lux=torch.tensor(means / per_lux),
        generator=list(range(len(means))),
        tolerance_dn=tolerance,
    ).numpy()
    spread = np.sqrt(1e-3 * means + read_dn**2 + dsnu_dn**2 + (prnu * means) ** 2)[:, None]
    codes = np.arange(0, 25)
    edges = norm.cdf((codes[:-1] + 0.5 - means[:, None]) / spread)
    chances = np.diff(edges, axis=1)
    centre = (chances * codes[1:-1]).sum(1)
    away = codes[1:-1] - centre[:, None]
    variance, fourth = (chances * away**2).sum(1), (chances * away**4).sum(1)
    n = dn[0].size
    error = 5 * np.sqrt((fourth - variance**2).clip(0) / n) + 10 * spread[:, 0] / math.sqrt(n) + 30 / n
    found = dn.var((1, 2, 3))
    assert (np.abs(found - variance) <= error + 1.2 * tolerance**2).all()
