"""Analytic moments against frames, step by step, and the frames' limits."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import stage_moments
import torch
from made_frames import from_photons
from stage_moments import Moments

from blurnoise import Camera
from blurnoise._core import rng
from blurnoise.light.conditions import Conditions
from blurnoise.sensor import stages
from blurnoise.sensor.stage import Frames, SensorStage

BASE = Camera(
    name="bench",
    pixel_pitch_um=4.0,
    f_number=2.0,
    transmission=1.0,
    quantum_efficiency=0.5,
    full_well_e=9000.0,
    system_gain_dn_per_e=0.4,
    read_noise_e=4.0,
    dark_current_e_s=300.0,
    black_level_dn=60.0,
    bit_depth=12,
)
PIXELS = 200_000


def frames(camera: Camera, mean_photons: float, **options: object) -> torch.Tensor:
    photons = torch.full((1, 1, 1, PIXELS), mean_photons, dtype=torch.float64)
    return from_photons(photons, camera, exposure_s=0.1, temperature_c=36.0, generator=[5], **options)  # type: ignore[arg-type]


def expected(camera: Camera, mean_photons: float) -> Moments:
    photo = torch.tensor(mean_photons * 0.5, dtype=torch.float64)
    return stage_moments.frame(
        photo, camera, exposure_s=torch.tensor(0.1), temperature_c=torch.tensor(36.0, dtype=torch.float64)
    )


def after_limits(camera: Camera, mean_photons: float) -> Moments:
    """What full well and converter leave."""
    point = {"exposure_s": torch.tensor(0.1), "temperature_c": torch.tensor(36.0, dtype=torch.float64)}
    photo = torch.tensor(mean_photons * 0.5, dtype=torch.float64)
    return stage_moments.steps(photo, camera, **point)["limits"]


def check(dn: torch.Tensor, law: Moments) -> None:
    """Mean within 5 s / sqrt(n), variance within 5 s^2 sqrt((kurtosis - 1) / n), measured kurtosis."""
    n, mean, spread = dn.numel(), float(dn.mean()), float(law.variance.sqrt())
    kurtosis = float(((dn - mean) ** 4).mean() / dn.var() ** 2)
    assert mean == pytest.approx(float(law.mean), abs=5 * spread / math.sqrt(n) + 1e-9)
    tolerance = 5 * spread**2 * math.sqrt(max(kurtosis - 1, 1) / n)
    assert float(dn.var()) == pytest.approx(float(law.variance), abs=tolerance + 0.005)


@pytest.mark.parametrize("fidelity", ["auto", "full"])
@pytest.mark.parametrize("mean_photons", [0.0, 3.0, 60.0, 1000.0, 9000.0])
@pytest.mark.parametrize("read_noise_e", [4.0, 2.0])
def test_frame_moments(mean_photons: float, read_noise_e: float, fidelity: str) -> None:
    camera = replace(BASE, read_noise_e=read_noise_e)
    check(frames(camera, mean_photons, fidelity=fidelity), expected(camera, mean_photons))


def test_a_tenth_off_would_be_noticed() -> None:
    dn = frames(BASE, 1000.0)
    for wrong in (replace(BASE, system_gain_dn_per_e=0.44), replace(BASE, dark_current_e_s=330.0)):
        with pytest.raises(AssertionError):
            check(dn, expected(wrong, 1000.0))
    in_dark = frames(BASE, 0.0)
    with pytest.raises(AssertionError):
        check(in_dark, expected(replace(BASE, read_noise_e=4.4, dark_current_e_s=300.0), 0.0))


@pytest.mark.parametrize("converter_dn_below_well", [-400, -3, 0, 3, 40])
@pytest.mark.parametrize("level", [0.97, 0.99, 1.0, 1.01, 5.0])
def test_clipped_moments_of_well_and_converter(level: float, converter_dn_below_well: int) -> None:
    """The well above, below and at the converter's end: frames and their closed form.

    Read noise of 8 DN. Tolerance: five standard errors of 200 000 pixels at the measured kurtosis, and half a
    percent of the variance for the normal in place of counts.
    """
    black_dn = 4095 - 3600 + float(converter_dn_below_well)
    camera = replace(BASE, read_noise_e=20.0, black_level_dn=black_dn, dark_current_e_s=0.0)
    photons = level * 9000.0 / 0.5
    dn = frames(camera, photons)
    law, spread = after_limits(camera, photons), float(dn.std()) + 0.05
    assert float(law.mean) == pytest.approx(float(dn.mean()), abs=5 * spread / math.sqrt(PIXELS) + 0.03)
    kurtosis = float(((dn - dn.mean()) ** 4).mean() / spread**4)
    tolerance = 5 * spread**2 * math.sqrt(kurtosis / PIXELS) + 0.005 * spread**2 + 0.1
    assert float(law.variance) == pytest.approx(float(dn.var()), abs=tolerance)


def test_a_saturated_camera_keeps_the_noise_that_follows_its_well() -> None:
    law = after_limits(BASE, 1e9)
    assert float(law.mean) == pytest.approx(BASE.clip_dn)
    assert float(law.variance) == pytest.approx((0.4 * 4.0) ** 2 + 1 / 12, rel=1e-6)
    full_converter = replace(BASE, full_well_e=1e6)
    law = after_limits(full_converter, 1e9)
    assert float(law.mean) == pytest.approx(4095)
    assert float(law.variance) == pytest.approx(0.0, abs=1e-6)


def test_pattern_moments_over_pixels() -> None:
    camera = replace(BASE, prnu=0.02, dsnu_e=15.0, dark_current_e_s=0.0)
    pattern = camera.fixed_pattern((1, 1, PIXELS), seed=3)
    law = expected(camera, 8000.0)
    both = law._replace(variance=law.variance + law.pattern_variance)
    check(frames(camera, 8000.0, fixed_pattern=pattern), both)


NOISES = {"merged": ("normal",), "counts": ("normal", "read"), "exact": ("read",)}


@pytest.mark.parametrize("law", NOISES)
@pytest.mark.parametrize("mean_photo_e", [3.0, 60.0, 4000.0, 8950.0])
def test_every_stage_does_what_its_moments_say(mean_photo_e: float, law: str) -> None:
    """Each entry of the table, alone: mean and variance over 200 000 pixels before and after it.

    Five standard errors of the mean, and of the variance with the measured kurtosis; shot and read noise are
    one step under the law that merges them.
    """
    camera = replace(BASE, prnu=0.02, dsnu_e=15.0)
    shape, one = (1, 1, 1, PIXELS), torch.ones(1, 1, 1, 1, dtype=torch.float64)
    like = torch.empty(shape, dtype=torch.float64)
    fields = {
        name: rng.standard_normal([seed], like, name)
        for seed, name in enumerate(("normal", "read", "prnu", "dsnu"))
    }
    point = Conditions(camera, one * 0.1, one * 36.0, white_e=one * mean_photo_e)
    at = Frames(
        camera, law, one * mean_photo_e, point.dark_e, [7],  # type: ignore[arg-type]
        gain=1 + camera.prnu * fields["prnu"], offset_e=camera.dsnu_e * fields["dsnu"],
        **{name: fields[name] for name in NOISES[law]},
    )  # fmt: skip
    signal, zero = torch.ones(shape, dtype=torch.float64), torch.zeros_like(one)
    told = Moments(one, zero, zero)
    waiting = False
    for stage in stages.STAGES:
        told, signal = stage_moments.after(stage, told, point), stage.apply(signal, at)
        waiting = law == "merged" and stage in (stages.SHOT_NOISE, stages.FULL_WELL)  # read noise is in there
        cut = (
            mean_photo_e > 8000 and told.cut is not None
        )  # of a pattern as wide as shot noise, not of a normal
        if not waiting and not cut and (stage is not stages.LIMITS or mean_photo_e < 8000):
            check(signal, told._replace(variance=told.variance + told.pattern_variance))


@pytest.mark.parametrize("stage", [stages.SHOT_NOISE, stages.READ_NOISE, stages.DSNU, stages.PRNU])
def test_a_stage_with_a_tenth_more_variance_would_be_noticed(
    stage: SensorStage, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = stage_moments._AFTER[stage.name]

    def more(before: Moments, at: Conditions[torch.Tensor]) -> Moments:
        told = own(before, at)
        return told._replace(variance=1.1 * told.variance, pattern_variance=1.1 * told.pattern_variance)

    monkeypatch.setitem(stage_moments._AFTER, stage.name, more)
    with pytest.raises(AssertionError):
        test_every_stage_does_what_its_moments_say(60.0, "counts")
