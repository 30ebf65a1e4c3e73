"""The Kornia augmentation: what it does, gains and colours, its replay, and the places it has to work in."""

import copy
import math
import pickle
import subprocess
import sys
from dataclasses import replace
from typing import Any

import pytest
import torch
from batches import one_of, pictures
from exposures import exposed
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from blurnoise import Camera, Exposure, develop, expose_pictures, photoelectrons, simulate
from blurnoise.motion.ego import Vehicle
from blurnoise.training.arrays import expose_numpy
from blurnoise.training.augmentation import RandomExposure

TWO = ("imx250", "ar0237")
AT: dict[str, Any] = {"exposure_s": 0.02, "illuminance_lux": 80.0}
LIT = Exposure(Camera.preset("imx250"), 0.02, 80.0)


@pytest.mark.parametrize("encoding", ["srgb", "linear"])
@pytest.mark.parametrize("channels", [1, 3])
def test_is_simulate_and_develop(encoding, channels):
    torch.manual_seed(0)
    image = pictures(channels=channels)
    warm = Camera.preset("imx250").with_figures(dark_current_e_s=2000.0)
    cameras = (warm, Camera.preset("ar0237"))
    conditions = {"temperature_c": (0, 60), "gain_db": 0.0, "exposure_s": (0.001, 0.06)}
    aug = RandomExposure(cameras, **conditions, encoding=encoding, fidelity="full", p=1.0)
    out, params = aug(image), aug._params
    for index in range(len(image)):
        camera = cameras[int(params["camera_index"][index])]
        angle, speed = math.radians(float(params["direction_deg"][index])), float(params["speed_px_s"][index])
        at = {name: params[name][index] for name in ("exposure_s", "illuminance_lux", "temperature_c")}
        at |= {"velocity_px_s": [speed * math.cos(angle), -speed * math.sin(angle)], "fidelity": "full"}
        seed = [int(params["noise_seed"][index])]
        dn = simulate(image[index : index + 1], camera, encoding=encoding, generator=seed, **at)
        # the angle's rounding moves light by less than a digital number, in few pixels
        alike = develop(dn, camera, encoding=encoding)[0] == out[index]
        assert float(alike.float().mean()) > 0.99


def test_light_above_white_stays():
    """A lamp of 20 times white is white where white itself is a tenth of full scale; of sRGB-coded pictures, and of
    whole numbers, which are those of a file, values above 1 are refused."""
    camera = Camera.preset("imx250")
    tenth_lux = 0.1 * camera.sensor.full_well_e / photoelectrons(camera, 1.0, 0.01)
    at: dict[str, Any] = {"exposure_s": 0.01, "illuminance_lux": tenth_lux, "speed_px_s": 0.0, "p": 1.0}
    image = torch.full((1, 3, 8, 11), 0.5)
    image[..., 2:5, 3:7] = 20.0
    out = RandomExposure(camera, encoding="linear", **at)(image)
    assert float(out[..., 2:5, 3:7].min()) == 1.0
    assert float(out[..., 6:, :].mean()) == pytest.approx(0.05, rel=0.05)
    with pytest.raises(ValueError, match=r"must lie within \[0, 1\]"):
        RandomExposure(camera, **at)(image)
    with pytest.raises(ValueError, match="divide by 255"):
        RandomExposure(camera, encoding="linear", **at)(image.round())


DRAWN = {
    "usual": {},
    "gains": {"gain_db": (3.0, 30.0)},
    "shakes": {"shake_px": (0.0, 5.0), "exposure_s": (0.001, 0.06)},
    "driven": {"ego_kmh": (10.0, 90.0), "vehicle": Vehicle(hfov_deg=60.0, lens="rectilinear")},
    "lamps and captures": {
        "camera": ("ar0132x3", "imx250"),
        "lamp_hz": (80.0, 120.0),
        "exposure_s": (1e-4, 1e-3),
    },
}


@pytest.mark.parametrize("given", DRAWN.values(), ids=DRAWN)
def test_a_picture_does_not_depend_on_its_batch_and_is_replayed(given):
    torch.manual_seed(2)
    aug, image = RandomExposure(**{"camera": TWO, "p": 1.0, **given}), pictures(6)
    out, params = aug(image), aug._params
    assert torch.equal(aug(image, params=params), out)
    for index in range(6):
        alone = aug(image[index : index + 1], params=one_of(params, index))
        assert torch.equal(alone[0], out[index])
    other = {**params, "noise_seed": params["noise_seed"] + 1}
    assert not torch.equal(aug(image, params=other), out)


def test_probability_chooses_pictures_and_leaves_the_others():
    torch.manual_seed(0)
    image = pictures(400, 1, 4, 5)
    aug = RandomExposure(illuminance_lux=1.0, p=0.3)
    out = aug(image)
    changed = (out != image).flatten(1).any(1)
    assert torch.equal(changed, aug._params["batch_prob"] > 0.5)
    assert abs(float(changed.float().mean()) - 0.3) < 5 * math.sqrt(0.3 * 0.7 / 400)
    assert torch.equal(RandomExposure(p=0.0)(image), image)


def test_same_on_batch_treats_equal_pictures_equally():
    image = pictures(1).expand(5, -1, -1, -1)
    aug = RandomExposure(TWO, same_on_batch=True, p=0.999)
    out = aug(image)
    assert torch.equal(out, out[:1].expand_as(out))
    assert not torch.equal(out, image)
    aug.same_on_batch = False
    out = aug(image)
    assert not torch.equal(out[0], out[1])


@pytest.mark.parametrize("p", [0.5, 1.0])
def test_an_empty_batch_stays_empty(p):
    for same in (False, True):
        out = RandomExposure(p=p, same_on_batch=same)(torch.rand(0, 3, 8, 9))
        assert out.shape == (0, 3, 8, 9)


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.float64])
def test_other_precisions_come_back_as_they_came(dtype):
    """Half precision is computed in float32: its result is float32's, rounded once."""
    aug, image = RandomExposure(TWO, p=1.0), pictures().to(dtype)
    out = aug(image)
    assert out.dtype == dtype
    single = aug(image.float(), params=aug._params)
    if dtype == torch.float64:  # noise is drawn in double precision there, so only the mean agrees
        assert float((out - single).mean().abs()) < 0.01
    else:
        assert torch.equal(out, single.to(dtype))


def test_gradients_reach_the_pictures():
    """A picture's light moves its own output, upward; a picture that p leaves has the identity."""
    torch.manual_seed(8)
    image = pictures(6).mul(0.5).add(0.2).requires_grad_()
    aug = RandomExposure(TWO, exposure_s=0.01, illuminance_lux=(30, 60), speed_px_s=(0, 100), p=0.5)
    (gradient,) = torch.autograd.grad(aug(image).sum(), image)
    chosen = aug._params["batch_prob"] > 0.5
    assert 0 < int(chosen.sum()) < 6
    assert torch.equal(gradient[~chosen], torch.ones_like(gradient[~chosen]))
    assert bool((gradient[chosen].sum((1, 2, 3)) > 0).all())
    assert bool(torch.isfinite(gradient).all())


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda aug: pickle.loads(pickle.dumps(aug))])
def test_copies_draw_and_expose_alike(copied):
    aug = RandomExposure(TWO, temperature_c=(0, 40), grow_boxes=True, p=0.8)
    other = copied(aug)
    outs = []
    for each in (aug, other):
        torch.manual_seed(6)
        outs.append(each(pictures()))
    assert torch.equal(*outs)
    assert repr(other) == repr(aug)
    assert "imx250, ar0237" in repr(aug)


class Exposed(Dataset[tuple[Tensor, dict[str, Tensor]]]):
    """Picture i, exposed, with the parameters that were drawn for it."""

    aug = RandomExposure(TWO, p=1.0)

    def __len__(self):
        return 8

    def __getitem__(self, index):
        return self.aug(pictures(8)[index]), self.aug._params


@pytest.mark.parametrize(
    ("start", "workers"),
    [("fork", 2), pytest.param("spawn", 1, marks=pytest.mark.slow)],  # which imports everything anew
)
def test_workers_draw_their_own_and_replay_elsewhere(start, workers):
    """Each worker's draws differ; given those, this process gets the same bits without workers."""
    how = {"num_workers": workers, "multiprocessing_context": start}
    loader = DataLoader(Exposed(), batch_size=None, generator=torch.Generator().manual_seed(1), **how)
    seeds = set()
    for index, (out, params) in enumerate(loader):
        assert torch.equal(Exposed.aug(pictures(8)[index], params=params), out)
        seeds.add(int(params["noise_seed"]))
    assert len(seeds) == 8


@pytest.mark.parametrize(
    ("given", "error", "said"),
    [
        ({"exposure_s": (0.0, 0.01)}, ValueError, "exposure_s.*log-uniform"),
        ({"exposure_s": (0.02, 0.01)}, ValueError, "exposure_s.*low <= high"),
        ({"speed_px_s": (-1.0, 5.0)}, ValueError, "speed_px_s.*>= 0"),
        ({"direction_deg": (0.0, 90.0, 180.0)}, TypeError, "direction_deg.*low, high"),
        ({"camera": "imx999"}, ValueError, "imx999"),
        ({"gain_db": (0.0, 60.0)}, ValueError, "gain_db"),
        ({"white_e": 1e12}, ValueError, "white_e = .*illuminance_lux"),
        ({"blur_px": 1e5, "exposure_s": (1e-3, 1e-2)}, ValueError, "blur_px = .*speed_px_s"),
        ({"camera": "ar0237", "exposure_s": 1e-6, "shake_px": 3.0}, ValueError, "ar0237"),
    ],
)
def test_wrong_arguments_are_named(given, error, said):
    with pytest.raises(error, match=said):
        RandomExposure(**given)


@pytest.mark.parametrize(
    ("exposure", "said"),
    [
        ([LIT] * 3, "exposure: got 3; must be one, or 2"),
        (replace(LIT, seed=[1, 2], exposure_s=torch.full((3,), 0.01)), "exposure_s: got 3 for a batch of 2"),
        (replace(LIT, seed=[1, 2], trajectory=[None]), "trajectory: got 1 for a batch of 2"),
        (replace(LIT, seed=[1, 2], velocity_px_s=torch.zeros(2, 2, 4, 4)), "velocity_px_s: shape is"),
    ],
)
def test_one_exposure_or_one_for_each_picture(exposure, said):
    with pytest.raises(ValueError, match=said):
        expose_pictures(pictures(2), exposure)


@pytest.mark.parametrize("channels", [1, 3])
def test_colour_cameras_return_the_shape_they_got(channels):
    """A camera each: with filters, of one plane, with a sensor for each colour; one plane comes out grey."""
    mono = Camera.preset("imx250").with_figures(cfa="mono")
    cameras = (Camera.preset("imx250c"), mono, Camera.preset("imx250"))
    image = pictures(channels=channels)[:1].expand(3, -1, -1, -1)
    seen = exposed(image, cameras, seeds=[4, 5, 6], **AT)
    assert seen.shape == image.shape
    for index, camera in enumerate(cameras):
        alone = exposed(image[:1], camera, seeds=[4 + index], **AT)
        assert torch.equal(alone[0], seen[index])
    assert [torch.equal(each[0], each[-1]) for each in seen] == [channels == 1, True, channels == 1]


@pytest.mark.parametrize(
    ("scaled", "words"),
    [
        (lambda image: 2 * image - 1, r"look like \[-1, 1\]: give \(image \+ 1\) / 2"),
        (lambda image: (image - 0.45) / 0.22, "normalised by mean and standard deviation"),
        (lambda image: 1.1 * image - 0.05, "overshoots"),
        (lambda image: 255 * image, "0 to 255: divide by 255"),
        (lambda image: 4095 * image, "0 to 4095: divide by 4095"),
    ],
)
@pytest.mark.parametrize("dtype", [torch.float16, torch.float32])
def test_pictures_of_other_ranges_are_refused_by_name(scaled, words, dtype):
    image = scaled(pictures()).to(dtype)
    with pytest.raises(ValueError, match=words):
        RandomExposure(p=1.0)(image)
    with pytest.raises(ValueError, match=words):
        expose_numpy(image[0].permute(1, 2, 0).numpy(), LIT)


def test_roundings_and_bright_light_are_taken():
    image = pictures().clamp(0.1, 0.9) * 2 - 0.203
    assert float(image.min()) < 0
    seen = RandomExposure(p=1.0)(image)
    assert bool(((seen >= 0) & (seen <= 1)).all())


@pytest.mark.parametrize("camera", ["imx250", "imx250c", ["imx250c", "ar0237", "imx250", "imx250"]])
def test_the_memory_format_stays(camera):
    image = pictures()
    last = exposed(image.contiguous(memory_format=torch.channels_last), camera, **AT)
    assert last.is_contiguous(memory_format=torch.channels_last)
    assert not last.is_contiguous()
    assert exposed(image, camera, **AT).is_contiguous()


def test_the_first_call_does_not_wait_for_the_compiler():
    """Whose import takes as long as torch's own; in a process that has not compiled anything."""
    program = (
        "import sys, torch\n"
        "from blurnoise import RandomExposure\n"
        "RandomExposure(p=1.0)(torch.rand(1, 3, 8, 8))\n"
        "assert 'torch._dynamo' not in sys.modules"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
