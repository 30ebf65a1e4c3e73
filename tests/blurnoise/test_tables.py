"""The chain's tables: an entry that nobody else knows of takes part everywhere; the fast route does as they say."""

from dataclasses import replace
from typing import Any

import pytest
import torch
from exposed_frames import budget
from kornia.augmentation import AugmentationSequential
from made_up import ColumnNoise, Pedestal, Shift, Veil

from blurnoise import Camera, Exposure, RandomExposure, Scene, photoelectrons, simulate, take_each
from blurnoise._core import threads
from blurnoise.camera.sensor import DARK_NOISE
from blurnoise.light import effects
from blurnoise.light.effect import LightEffect
from blurnoise.picture.develop import develop_8bit
from blurnoise.sensor import fused, readout, stages
from blurnoise.sensor.readout import read_out

CAMERA = Camera.preset("imx250").with_figures(
    prnu=0.02,
    dsnu_e=3.0,
    dark_current_e_s=400.0,
    defocus_radius_px=1.2,
    diffraction_wavelength_um=0.55,
)
CONDITIONS: dict[str, Any] = {"exposure_s": 0.01, "illuminance_lux": 50.0}


def picture(height=41, width=67):
    return torch.rand(1, 3, height, width, generator=torch.Generator().manual_seed(3))


def mean_frame(**options):
    return simulate(picture(), CAMERA, **{"noise": False, "quantised": False, **CONDITIONS, **options})


@pytest.mark.parametrize("fidelity", ["auto", "full"])
def test_a_new_light_effect_is_one_entry(monkeypatch, fidelity):
    before = mean_frame(fidelity=fidelity)
    monkeypatch.setattr(effects, "EFFECTS", (*effects.EFFECTS, Veil(0.1)))
    white_dn = CAMERA.sensor.system_gain_dn_per_e * 0.1 * photo_e()
    unclipped = before + 1.05 * white_dn < CAMERA.sensor.clip_dn
    pattern = CAMERA.sensor.fixed_pattern(tuple(before.shape[1:]), 0)[0]
    after = mean_frame(fidelity=fidelity)
    torch.testing.assert_close(
        (after - before)[unclipped], (white_dn * pattern[None])[unclipped], rtol=1e-3, atol=2e-3
    )
    told = {each.name: each for each in budget(CAMERA, **CONDITIONS).stages}
    assert told["veil"].contribution_dn == pytest.approx(white_dn)
    assert told["veil"].kept


def photo_e():
    return photoelectrons(CAMERA, CONDITIONS["illuminance_lux"], CONDITIONS["exposure_s"])


@pytest.mark.parametrize("place", [3, 6])
@pytest.mark.parametrize("fidelity", ["auto", "full"])
def test_a_new_sensor_stage_is_one_entry(monkeypatch, fidelity, place):
    """Before shot noise or after it: in the frame and in the plan; the fast route declines."""
    before = mean_frame(fidelity=fidelity, quantised=True)
    monkeypatch.setattr(stages, "STAGES", (*stages.STAGES[:place], Pedestal(500.0), *stages.STAGES[place:]))
    assert not fused.supports(stages.active(CAMERA))
    after = mean_frame(fidelity=fidelity, quantised=True)
    dn = 500 * CAMERA.sensor.system_gain_dn_per_e
    unclipped = before + dn < CAMERA.sensor.clip_dn
    assert float(((after - before)[unclipped] - dn).abs().max()) <= 1
    told = {each.name: each for each in budget(CAMERA, **CONDITIONS).stages}
    assert told["pedestal"].contribution_dn == pytest.approx(dn)


@pytest.mark.parametrize(("place", "full_well_e"), [(1, 20000.0), (3, 5000.0), (6, 5000.0)])
@pytest.mark.parametrize("fidelity", ["auto", "full"])
def test_the_reference_in_pieces_is_that_of_whole_pictures(monkeypatch, fidelity, place, full_well_e):
    """The same bits, wherever a stage stands that wants the whole picture: here one that rolls it."""

    class Rolled(Pedestal):
        def apply(self, signal, at):
            return torch.roll(signal, 7, -2)

    camera = CAMERA.with_figures(full_well_e=full_well_e)
    monkeypatch.setattr(stages, "STAGES", (*stages.STAGES[:place], Rolled(), *stages.STAGES[place:]))
    monkeypatch.setattr(threads, "WORTH_IT", 1)  # the pieces of so small a picture are shared by threads, too
    given: dict[str, Any] = {"white_e": [4000.0, 9000.0], "exposure_s": 0.01, "temperature_c": 25.0}
    given |= {
        "generator": [1, 2],
        "fidelity": fidelity,
        "fixed_pattern": camera.sensor.fixed_pattern((3, 41, 67), 1),
    }
    frames = []
    for values in (1 << 30, 3 * 67 * 5, 1):
        monkeypatch.setattr(readout, "_PIECE", values)
        frames.append(read_out(picture().repeat(2, 1, 1, 1), camera, **given))
    assert torch.equal(frames[0], frames[1])
    assert torch.equal(frames[0], frames[2])


def test_what_is_small_is_left_out_whatever_it_is(monkeypatch):
    before = mean_frame()
    monkeypatch.setattr(effects, "EFFECTS", (*effects.EFFECTS, Veil(1e-8)))
    monkeypatch.setattr(stages, "STAGES", (*stages.STAGES[:6], Pedestal(1e-4), *stages.STAGES[6:]))
    found = budget(CAMERA, **CONDITIONS)
    assert {"veil", "pedestal"} <= found.without
    assert torch.equal(mean_frame(), before)
    assert not torch.equal(mean_frame(fidelity="full"), before)


def test_a_scene_and_simulate_give_the_same_bits_with_new_entries(monkeypatch):
    monkeypatch.setattr(effects, "EFFECTS", (Veil(0.05), *effects.EFFECTS, Shift()))
    monkeypatch.setattr(stages, "STAGES", (*stages.STAGES[:6], Pedestal(40.0), *stages.STAGES[6:]))
    coded = (picture()[0].permute(1, 2, 0) * 255).round().byte().numpy()
    at = [Exposure(CAMERA, 0.004, lux, (900.0, -300.0), seed=5) for lux in (20.0, 60.0)]
    at.append(Exposure(CAMERA.with_figures(f_number=4.0), 0.004, 60.0, (900.0, -300.0), 45.0, 6.0, seed=6))
    at.append(replace(at[-1], gain_db=27.0))  # 24 dB of it analogue
    for exposure, frame in zip(at, take_each(Scene.of_picture(coded), at), strict=True):
        camera, digital_db = exposure.camera.at_gain(exposure.gain_db)
        names = ("exposure_s", "illuminance_lux", "velocity_px_s", "temperature_c")
        given = {name: getattr(exposure, name) for name in names} | {"generator": [exposure.seed]}
        light = torch.from_numpy(coded).permute(2, 0, 1)[None] / 255
        dn = simulate(light, camera, **given, tolerance_dn=0.1 / 10 ** (digital_db / 20))
        assert torch.equal(frame.eight_bit, develop_8bit(dn, camera, digital_db))
        moved = exposure.move_boxes(torch.tensor([[1.0, 2.0, 3.0, 4.0]]))
        assert moved.tolist() == [[21.0, 12.0, 23.0, 14.0]]


def test_what_moves_boxes_moves_masks():
    for effect in effects.EFFECTS:
        own = type(effect)
        assert (own.move_boxes is LightEffect.move_boxes) == (own.origins is LightEffect.origins), effect.name


@pytest.mark.parametrize("noise", [True, False])
@pytest.mark.parametrize("full_well_e", [20000.0, 5000.0])
@pytest.mark.parametrize("read_noise_e", [2.5, 0.4])
@pytest.mark.parametrize(
    "alone", [(), ("prnu",), ("dark_current_e_s",), ("dsnu_e",), ("read_noise_e",), None]
)
def test_the_fast_route_is_the_reference_stage_by_stage(alone, read_noise_e, noise, full_well_e, monkeypatch):
    """With each stage alone, with none and with all: equal but for rounding, one DN in one pixel of a thousand.

    The well beyond the converter, and cutting a third of the brighter picture.
    """
    figures = {figure for stage in stages.STAGES for figure in stage.figures if CAMERA.figure(figure) != ()}
    lines = {"row_noise_e": 4.0, "column_noise_e": 2.0, "black_level_drift_dn": 1.5, "prnu_row": 0.03}
    lines |= {"prnu_column": 0.02, "dsnu_row_e": 5.0, "dsnu_column_e": 8.0}
    busy = CAMERA.with_figures(read_noise_e=read_noise_e, **(lines if alone is None else {}))
    kept = {name: 0.0 for name in figures if alone is not None and name not in alone}
    camera = busy.with_figures(**kept, full_well_e=full_well_e)
    light = torch.rand(2, 3, 61, 47, generator=torch.Generator().manual_seed(1)) * 1.1 - 0.05
    pattern = (
        camera.sensor.fixed_pattern(tuple(light.shape[1:]), 3)
        if camera.sensor.prnu or camera.sensor.dsnu_e
        else None
    )
    given: dict[str, Any] = {"white_e": [300.0, 7000.0], "exposure_s": 0.02, "temperature_c": 30.0}
    given |= {"generator": [5, 6], "fixed_pattern": pattern, "noise": noise}
    assert fused.supports(stages.active(camera))
    quick = read_out(light, camera, **given)
    monkeypatch.setattr(fused, "supports", lambda active: False)
    reference = read_out(light, camera, **given)
    off = (quick - reference).abs()
    assert float(off.max()) <= 1
    assert float((off > 0).float().mean()) < 1e-3
    if noise:
        assert float(reference.std()) > 0


def test_the_fast_route_declines_another_order_or_a_lack(monkeypatch):
    every = stages.active(CAMERA)
    assert fused.supports(every)
    assert not fused.supports(every[:-1])
    assert not fused.supports([*every[1:], every[0]])
    assert not fused.supports([stage for stage in every if stage is not stages.QUANTISATION])


def test_every_noise_of_the_dark_counts_in_threshold_and_range():
    """A stage that draws has its figures in the camera's sum, which doubles with them."""
    drawn = {figure for stage in stages.STAGES if stage.draws for figure in stage.figures}
    other = {"black_level_drift_dn", "photon_transfer", "row_gain_noise"}  # of whole frames; of light
    why = "mark its figure dark_noise=True, or list it here if it is not the rms of every pixel in the dark"
    assert drawn - other == set(DARK_NOISE), why
    noisier = CAMERA.with_figures(**{name: 2 * CAMERA.figure(name) for name in DARK_NOISE})
    assert noisier.sensor.dark_noise_e == pytest.approx(2 * CAMERA.sensor.dark_noise_e)
    assert noisier.sensor.threshold_e > 1.7 * CAMERA.sensor.threshold_e


def test_boxes_of_the_augmentation_move_with_the_picture(monkeypatch):
    monkeypatch.setattr(effects, "EFFECTS", (*effects.EFFECTS, Shift((3, 2))))
    boxes = torch.tensor([[[5.0, 6.0, 20.0, 26.0], [1.0, 2.0, 3.0, 4.0]]] * 2)
    options: dict[str, Any] = {"exposure_s": 0.004, "illuminance_lux": 50.0, "speed_px_s": 0.0, "p": 1.0}
    seen = AugmentationSequential(RandomExposure(**options), data_keys=["input", "bbox_xyxy"])
    _, moved = seen(picture().expand(2, -1, -1, -1), boxes)
    torch.testing.assert_close(moved, boxes + torch.tensor([3.0, 2.0, 3.0, 2.0]))


@pytest.mark.parametrize("fidelity", ["auto", "full"])
def test_a_new_noise_is_drawn_where_no_other_is(monkeypatch, fidelity):
    """In the dark of a camera without read noise: 20 e- of columns, their deviation known to 5 / sqrt(2 n)."""
    quiet = Camera.preset("imx250").with_figures(read_noise_e=0.0, black_level_dn=100.0)
    place = stages.STAGES.index(stages.GAIN)
    monkeypatch.setattr(stages, "STAGES", (*stages.STAGES[:place], ColumnNoise(20.0), *stages.STAGES[place:]))
    dark = torch.zeros(1, 1, 2, 4000)
    dn = simulate(dark, quiet, exposure_s=0.01, illuminance_lux=0.0, generator=[3], fidelity=fidelity)
    expected = 20 * quiet.sensor.system_gain_dn_per_e
    assert float(dn[..., 0, :].std()) == pytest.approx(expected, rel=5 / (2 * 4000) ** 0.5)
    assert torch.equal(dn[..., 0, :], dn[..., 1, :])
    mean = simulate(dark, quiet, exposure_s=0.01, illuminance_lux=0.0, fidelity=fidelity, noise=False)
    assert float(mean.std()) == 0
