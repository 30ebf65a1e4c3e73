"""The plan: what it leaves out stays within its tolerance, and it says so."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from blurnoise import Camera, photoelectrons, simulate
from blurnoise.scene.plan import plan

BUSY = Camera(
    name="busy",
    pixel_pitch_um=4.0,
    f_number=2.8,
    transmission=0.9,
    quantum_efficiency=0.5,
    full_well_e=9000.0,
    system_gain_dn_per_e=0.4,
    read_noise_e=2.5,
    dark_current_e_s=30.0,
    prnu=0.01,
    dsnu_e=3.0,
    black_level_dn=60.0,
    defocus_radius_px=1.2,
)
ORDER = [
    "distortion",
    "objects",
    "lateral colour",
    "defocus",
    "diffraction",
    "measured MTF",
    "motion",
    "motion variation",
    "rolling shutter",
    "vignetting",
    "spectral integration",
    "PRNU",
    "dark current",
    "shot noise",
    "read noise",
    "DSNU",
    "quantisation",
]
CAMERAS = st.builds(
    lambda gain, read, dark, prnu, dsnu, radius: replace(
        BUSY,
        system_gain_dn_per_e=gain,
        read_noise_e=read,
        dark_current_e_s=dark,
        prnu=prnu,
        dsnu_e=dsnu,
        defocus_radius_px=radius,
    ),
    st.sampled_from([0.005, 0.05, 0.4, 3.0]),
    st.sampled_from([0.0, 0.3, 2.5, 12.0]),
    st.sampled_from([0.0, 0.1, 10.0, 1000.0]),
    st.sampled_from([0.0, 1e-5, 0.01]),
    st.sampled_from([0.0, 0.05, 4.0]),
    st.sampled_from([0.0, 0.01, 1.5]),
)


def test_the_stages_stand_in_the_order_of_the_physics() -> None:
    chosen = plan(BUSY, exposure_s=0.02, illuminance_lux=100.0, displacement_px=(12.0, 0.0))
    assert [stage.name for stage in chosen.stages if stage.name in ORDER] == ORDER
    by_name = {stage.name: stage for stage in chosen.stages}
    white_e = 100 * 0.02 * 4.0**2 * 0.9 / (4 * 2.8**2) * 0.5 * 10724  # D55 photons per lux s um^2, 400-700 nm
    assert by_name["shot noise"].contribution_dn == pytest.approx(0.4 * math.sqrt(white_e), rel=2e-3)
    assert by_name["read noise"].contribution_dn == pytest.approx(1.0)
    assert by_name["DSNU"].contribution_dn == pytest.approx(1.2)
    assert by_name["PRNU"].contribution_dn == pytest.approx(0.4 * 0.01 * white_e, rel=2e-3)
    assert by_name["motion"].kept
    assert "12 px" in by_name["motion"].how
    assert by_name["spectral integration"].how == "none here"


def test_what_a_dark_or_still_scene_does_not_need() -> None:
    still = plan(replace(BUSY, defocus_radius_px=0.01), exposure_s=0.001, illuminance_lux=10.0)
    kept = {stage.name for stage in still.stages if stage.kept}
    assert kept.isdisjoint({"motion", "defocus", "dark current"})
    assert {"shot noise", "read noise", "DSNU", "quantisation"} <= kept
    assert still.camera.dark_current_e_s == 0
    assert "motion" in still.without
    night = plan(replace(BUSY, dsnu_e=0.0), exposure_s=0.0, illuminance_lux=0.0, displacement_px=(50.0, 0.0))
    assert "motion" in night.without
    assert night.noisy  # read noise


@pytest.mark.parametrize("angle_deg", [0.0, 45.0])
@pytest.mark.parametrize("radius_px", [0.0, 0.03])
def test_a_checkerboard_is_within_the_tolerance(angle_deg: float, radius_px: float) -> None:
    """All its contrast lies at the corner of the band, where blur takes most."""
    board = (torch.arange(32)[:, None].add(torch.arange(34)) % 2).double()[None, None]
    camera = replace(BUSY, defocus_radius_px=radius_px)
    for length_px in (0.003, 0.01, 0.02, 0.04, 0.06):
        along = math.radians(angle_deg)
        common = {
            "exposure_s": 0.01,
            "illuminance_lux": 50.0,
            "velocity_px_s": (100 * length_px * math.cos(along), 100 * length_px * math.sin(along)),
            "encoding": "linear",
            "border": "circular",
            "noise": False,
            "quantised": False,
        }
        full = simulate(board, camera, fidelity="full", **common)  # type: ignore[arg-type]
        auto = simulate(board, camera, tolerance_dn=0.5, **common)  # type: ignore[arg-type]
        assert float((full - auto).square().mean().sqrt()) <= 0.5


def test_without_dither_what_contributes_nothing_is_left_out() -> None:
    """0.002 DN of read noise before 8 bits: it stays, for rounding, and what is not there goes."""
    camera = replace(EIGHT_BIT, read_noise_e=2.0)
    chosen = plan(camera, exposure_s=0.01, illuminance_lux=100.0)
    kept = {stage.name for stage in chosen.stages if stage.kept}
    assert kept == {"spectral integration", "shot noise", "read noise", "quantisation"} - {
        stage.name for stage in chosen.stages if stage.contribution_dn == 0
    }
    assert "motion" in chosen.without


def test_without_dither_what_turns_few_pixels_is_left_out() -> None:
    """0.0028 DN of dark charge turn 0.28 % of an 8-bit picture's values by one: sqrt(0.0028) = 0.053 DN RMS."""
    camera = replace(EIGHT_BIT, read_noise_e=0.0, dark_current_e_s=152.0)
    conditions = {"exposure_s": 0.01, "temperature_c": 25.0}
    chosen = plan(camera, illuminance_lux=100.0, **conditions)
    dark = next(stage for stage in chosen.stages if stage.name == "dark current")
    assert dark.contribution_dn == pytest.approx(2.8e-3, rel=0.02)
    assert not dark.kept
    assert math.sqrt(dark.contribution_dn) < chosen.left_out_dn <= 0.1
    ramp = torch.linspace(0, 1, 10_000, dtype=torch.float64).reshape(1, 1, 100, 100)
    with_dark, without = (
        simulate(
            ramp, each, illuminance_lux=300.0, noise=False, encoding="linear", fidelity="full", **conditions
        )
        for each in (camera, chosen.camera)
    )
    assert 0 < float((with_dark - without).square().mean().sqrt()) <= math.sqrt(dark.contribution_dn)
    between = plan(replace(camera, black_level_dn=9.5), illuminance_lux=100.0, **conditions)
    assert next(stage for stage in between.stages if stage.name == "dark current").kept


def test_a_larger_tolerance_keeps_less() -> None:
    settings_ = {"exposure_s": 0.01, "illuminance_lux": 50.0, "displacement_px": (3.0, 1.0)}
    kept = [
        {stage.name for stage in plan(BUSY, **settings_, tolerance_dn=tolerance).stages if stage.kept}  # type: ignore[arg-type]
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
    replace(BUSY, read_noise_e=0.0, prnu=0.0, dsnu_e=0.0, defocus_radius_px=0.01), 0.03125, 30.0, 0.0234, 0.05
)
@example(
    replace(BUSY, system_gain_dn_per_e=0.005, dark_current_e_s=0.0, prnu=0.0, dsnu_e=0.0),
    0.125,
    30.0,
    0.0,
    0.5,
)
def test_what_is_left_out_is_within_the_tolerance(
    camera: Camera, exposure_s: float, lux: float, length: float, tolerance: float
) -> None:
    """The mean frame of auto is within the tolerance, RMS, of the full one, and so is its noise."""
    image = (torch.rand(1, 1, 48, 48, generator=torch.Generator().manual_seed(1)) > 0.5).double()
    common = {
        "exposure_s": exposure_s,
        "illuminance_lux": lux,
        "velocity_px_s": (length / exposure_s if exposure_s > 1e-3 else 0.0, 0.0),
        "encoding": "linear",
        "border": "circular",
        "tolerance_dn": tolerance,
        "quantised": False,
    }
    full = simulate(image, camera, fidelity="full", noise=False, **common)  # type: ignore[arg-type]
    auto = simulate(image, camera, noise=False, **common)  # type: ignore[arg-type]
    assert float((full - auto).square().mean().sqrt()) <= 1.1 * tolerance + 1e-6
    chosen = plan(
        camera,
        exposure_s=exposure_s,
        illuminance_lux=lux,
        displacement_px=(common["velocity_px_s"][0] * exposure_s, 0.0),  # type: ignore[index]
        tolerance_dn=tolerance,
    )
    assert chosen.left_out_dn <= tolerance
    left_out = [stage.contribution_dn for stage in chosen.stages if not stage.kept]
    rounding = math.sqrt(max(0.0, chosen.left_out_dn**2 - math.hypot(*left_out) ** 2))
    spread = {"PRNU", "dark current", "shot noise", "read noise", "DSNU"}
    lost = math.hypot(
        *(each.contribution_dn for each in chosen.stages if not each.kept and each.name in spread)
    )
    assert min(abs(rounding - each) for each in (0.0, 0.5, math.sqrt(min(lost, 0.25)))) < 1e-3
    if rounding < 1e-3:  # nothing that spreads was left out, or read noise stays
        dithered = chosen.camera.read_noise_e * chosen.camera.system_gain_dn_per_e >= 0.5
        assert dithered or lost <= max(1e-6, 4095 / 2**24)


EIGHT_BIT = Camera(
    name="8 bits of a deep well",
    pixel_pitch_um=4.0,
    f_number=2.8,
    transmission=0.9,
    quantum_efficiency=0.5,
    full_well_e=250_000.0,
    system_gain_dn_per_e=1e-3,
    read_noise_e=10.0,
    bit_depth=8,
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
def test_the_variance_after_rounding_holds_at_every_fraction_of_the_mean(
    read_dn: float, dsnu_dn: float, prnu: float, tolerance: float
) -> None:
    """Means of 9 to 10 DN in steps of 0.01: the exact law of the rounded normal, and auto within the tolerance.

    Five standard errors of 10 000 pixels, from the law's fourth moment and the pattern's share of the mean, which a
    set of pixels has in common; beside them 1.2 tolerance^2, since rounding turns a variance by up to 13 %.
    """
    camera = replace(EIGHT_BIT, read_noise_e=1e3 * read_dn, dsnu_e=1e3 * dsnu_dn, prnu=prnu)
    means = np.arange(9.0, 10.0, 0.01)
    per_lux = photoelectrons(camera, 1.0, 0.01) * camera.system_gain_dn_per_e
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


@pytest.mark.parametrize("read_noise_e", [0.3, 3.0])
@pytest.mark.parametrize("lux", [0.5, 60.0])
def test_noise_of_auto_and_full_agree(lux: float, read_noise_e: float) -> None:
    """Standard deviations over pixels agree to the tolerance and the estimate's own error, 5 s / sqrt(2 n)."""
    camera = replace(BUSY, read_noise_e=read_noise_e, defocus_radius_px=0.0)
    image = torch.full((1, 1, 200, 250), 0.6, dtype=torch.float64)
    spreads = [
        float(
            simulate(
                image,
                camera,
                exposure_s=0.01,
                illuminance_lux=lux,
                encoding="linear",
                generator=[4],
                fidelity=fidelity,  # type: ignore[arg-type]
            ).std()
        )
        for fidelity in ("auto", "full")
    ]
    assert spreads[0] == pytest.approx(spreads[1], abs=0.1 + 5 * spreads[1] / math.sqrt(2 * image.numel()))


def test_items_of_different_regimes_share_a_batch() -> None:
    """Dark, bright, saturated, still and moving: each is what it would be alone."""
    images = torch.rand(4, 3, 40, 50, generator=torch.Generator().manual_seed(3))
    exposure = torch.tensor([0.0, 1e-3, 0.03, 100.0])
    lux = torch.tensor([50.0, 1e-9, 80.0, 1e5])
    velocity = torch.tensor([[0.0, 0.0], [5.0, 0.0], [400.0, 300.0], [0.01, 0.0]])
    together = simulate(
        images, BUSY, exposure_s=exposure, illuminance_lux=lux, velocity_px_s=velocity, generator=[1, 2, 3, 4]
    )
    for index in range(4):
        alone = simulate(
            images[index : index + 1],
            BUSY,
            exposure_s=float(exposure[index]),
            illuminance_lux=float(lux[index]),
            velocity_px_s=velocity[index],
            generator=[index + 1],
        )
        assert torch.equal(alone, together[index : index + 1])
    full = together[3].double()  # wells, with read noise of 2.5 e- and 3 e- of fixed pattern
    assert float(full.mean()) == pytest.approx(BUSY.clip_dn, abs=0.2)
    assert float(full.std()) == pytest.approx(math.hypot(1.0, 1.2, 12**-0.5), rel=0.05)


@pytest.mark.parametrize(
    ("name", "value"), [("tolerance_dn", 0.0), ("exposure_s", -1.0), ("illuminance_lux", math.nan)]
)
def test_bad_conditions_are_named(name: str, value: float) -> None:
    conditions = {"exposure_s": 0.01, "illuminance_lux": 10.0, name: value}
    with pytest.raises(ValueError, match=name):
        plan(BUSY, **conditions)  # type: ignore[arg-type]
