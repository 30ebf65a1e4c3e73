"""The Kornia augmentation: what it does, its replay, and the places it has to work in."""

from __future__ import annotations

import copy
import inspect
import math
import pickle
from dataclasses import fields, replace
from typing import Any

import pytest
import torch
from batches import pictures
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from blurnoise import Camera, develop, photoelectrons, simulate
from blurnoise.optics.colour import linear_from_srgb
from blurnoise.training import augmentation
from blurnoise.training.augmentation import RandomExposure, expose_pictures, velocity_px_s
from blurnoise.training.ranges import ExposureRanges

TWO = ("imx250", "ar0237")
CONDITIONS = {"exposure_s": 0.02, "illuminance_lux": 80.0}


def item(params: dict[str, Tensor], index: int, gate: float = 1.0) -> dict[str, Tensor]:
    """The parameters of one picture of a batch."""
    one = {k: v[index : index + 1] for k, v in params.items() if k != "forward_input_shape"}
    return {**one, "batch_prob": torch.tensor([gate]), "forward_input_shape": params["forward_input_shape"]}


# What is done with it


@pytest.mark.parametrize("encoding", ["srgb", "linear"])
@pytest.mark.parametrize("channels", [1, 3])
def test_is_simulate_and_develop(encoding: Any, channels: int) -> None:
    """The class, its twin and the two functions it is made of agree bit for bit, with a camera each."""
    torch.manual_seed(0)
    image = pictures(channels=channels)
    warm = replace(Camera.preset("imx250"), dark_current_e_s=2000.0)
    cameras = (warm, Camera.preset("ar0237"))
    aug = RandomExposure(cameras, temperature_c=(0, 60), encoding=encoding, fidelity="full", p=1.0)
    out, params = aug(image), aug._params
    for index in range(len(image)):
        camera = cameras[int(params["camera_index"][index])]
        angle, speed = math.radians(float(params["direction_deg"][index])), float(params["speed_px_s"][index])
        dn = simulate(
            image[index : index + 1],
            camera,
            exposure_s=params["exposure_s"][index],
            illuminance_lux=params["illuminance_lux"][index],
            velocity_px_s=[speed * math.cos(angle), -speed * math.sin(angle)],
            temperature_c=params["temperature_c"][index],
            encoding=encoding,
            generator=[int(params["noise_seed"][index])],
            fidelity="full",
        )
        # the angle's rounding moves light by less than a digital number, in few pixels
        alike = develop(dn, camera, encoding=encoding)[0] == out[index]
        assert float(alike.float().mean()) > 0.99


def test_class_passes_on_every_argument_of_its_twin(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[dict[str, Any]] = []
    signature = inspect.signature(expose_pictures)

    def recorded(*args: Any, **kwargs: Any) -> Tensor:
        calls.append(signature.bind(*args, **kwargs).arguments)
        return torch.zeros_like(args[0])

    monkeypatch.setattr(augmentation, "expose_pictures", recorded)
    aug = RandomExposure(TWO, temperature_c=(0, 50), encoding="linear", fidelity="full", p=1.0)
    aug(pictures())
    (call,) = calls
    assert set(call) == set(signature.parameters)
    params = aug._params
    for name in ("exposure_s", "illuminance_lux", "speed_px_s", "direction_deg", "temperature_c"):
        assert torch.equal(call[name], params[name]), name
    assert call["generator"] == params["noise_seed"].tolist()
    assert [each.name for each in call["camera"]] == [TWO[i] for i in params["camera_index"]]
    assert (call["encoding"], call["fidelity"]) == ("linear", "full")


def test_class_offers_every_range_of_its_conditions() -> None:
    defaults = {each.name: each.default for each in fields(ExposureRanges)}
    stated = inspect.signature(RandomExposure).parameters
    assert {name: stated[name].default for name in defaults} == defaults
    assert RandomExposure(**defaults).ranges == ExposureRanges()
    assert RandomExposure(ego_kmh=(0.0, 50.0), p=0.1).ranges == ExposureRanges(ego_kmh=(0.0, 50.0))
    with pytest.raises(TypeError, match="speed_px"):
        RandomExposure(speed_px=(0.0, 100.0))  # type: ignore[call-arg]


@pytest.mark.parametrize(
    ("direction_deg", "x", "y"), [(0, 1, 0), (90, 0, -1), (180, -1, 0), (270, 0, 1), (30, 0.8660254, -0.5)]
)
def test_direction_is_counter_clockwise_as_displayed(direction_deg: float, x: float, y: float) -> None:
    velocity = velocity_px_s(torch.tensor([2.0]), torch.tensor([float(direction_deg)]))
    torch.testing.assert_close(velocity, torch.tensor([[2.0 * x, 2.0 * y]]), atol=1e-6, rtol=0)


def test_white_has_the_brightness_of_its_electrons() -> None:
    """The mean of n pixels scatters by the noise over sqrt(n); 5 standard errors and the tables' rounding."""
    camera = Camera.preset("imx250")
    white = torch.ones(3, 1, 64, 64)
    lux = [20.0, 60.0, 180.0]
    seen = expose_pictures(
        white, camera, exposure_s=0.005, illuminance_lux=lux, generator=[1, 2, 3], encoding="linear"
    )
    for picture, illuminance in zip(seen, lux, strict=True):
        electrons = photoelectrons(camera, illuminance, 0.005)
        scale_dn = camera.full_scale_dn - camera.black_level_dn
        expected = electrons * camera.system_gain_dn_per_e / scale_dn
        error = math.sqrt(electrons + camera.read_noise_e**2) * camera.system_gain_dn_per_e / scale_dn / 64
        assert expected < 0.9  # not clipped
        assert abs(float(picture.mean()) - expected) < 5 * error + 1e-6
        assert abs(float(picture.mean()) - 1.05 * expected) > 5 * error
    coded = expose_pictures(
        white, camera, exposure_s=0.005, illuminance_lux=lux, generator=[1, 2, 3], encoding="srgb"
    )
    torch.testing.assert_close(linear_from_srgb(coded), seen, atol=1e-5, rtol=0)


@pytest.mark.parametrize("camera", ["imx250", TWO])
def test_a_picture_does_not_depend_on_its_batch(camera: Any) -> None:
    torch.manual_seed(2)
    aug, image = RandomExposure(camera, p=1.0), pictures(6)
    out, params = aug(image), aug._params
    for index in range(6):
        alone = aug(image[index : index + 1], params=item(params, index))
        assert torch.equal(alone[0], out[index])


def test_probability_chooses_pictures_and_leaves_the_others() -> None:
    torch.manual_seed(0)
    image = pictures(400, 1, 4, 5)
    aug = RandomExposure(illuminance_lux=1.0, p=0.3)
    out = aug(image)
    changed = (out != image).flatten(1).any(1)
    assert torch.equal(changed, aug._params["batch_prob"] > 0.5)
    assert abs(float(changed.float().mean()) - 0.3) < 5 * math.sqrt(0.3 * 0.7 / 400)
    assert torch.equal(RandomExposure(p=0.0)(image), image)


def test_only_the_chosen_pictures_are_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[int] = []

    def counted(image: Tensor, *_: Any, **__: Any) -> Tensor:
        seen.append(len(image))
        return torch.zeros_like(image)

    monkeypatch.setattr(augmentation, "expose_pictures", counted)
    aug, image = RandomExposure(p=0.5), pictures()
    gate = torch.tensor([0.0, 1.0, 0.0, 1.0])
    out = aug(image, params={**aug.forward_parameters(image.shape), "batch_prob": gate})
    assert seen == [2]
    assert torch.equal(out[[0, 2]], image[[0, 2]])
    assert not out[[1, 3]].any()


def test_replay_gives_the_same_bits() -> None:
    aug, image = RandomExposure(TWO, p=0.6), pictures(8)
    out, params = aug(image), aug._params
    aug(image)
    assert torch.equal(aug(image, params=params), out)
    other = {**params, "noise_seed": params["noise_seed"] + 1}
    assert not torch.equal(aug(image, params=other), out)


def test_same_on_batch_treats_equal_pictures_equally() -> None:
    image = pictures(1).expand(5, -1, -1, -1)
    aug = RandomExposure(TWO, same_on_batch=True, p=0.999)
    out = aug(image)
    assert torch.equal(out, out[:1].expand_as(out))
    assert not torch.equal(out, image)
    assert all(
        len(value.unique()) == 1 for name, value in aug._params.items() if name != "forward_input_shape"
    )
    aug.same_on_batch = False
    out = aug(image)
    assert not torch.equal(out[0], out[1])


@pytest.mark.parametrize(("keepdim", "shape"), [(True, (3, 21, 34)), (False, (1, 3, 21, 34))])
def test_keepdim(keepdim: bool, shape: tuple[int, ...]) -> None:
    assert RandomExposure(p=1.0, keepdim=keepdim)(pictures()[0]).shape == shape


@pytest.mark.parametrize("p", [0.5, 1.0])
def test_an_empty_batch_stays_empty(p: float) -> None:
    for same in (False, True):
        out = RandomExposure(p=p, same_on_batch=same)(torch.rand(0, 3, 8, 9))
        assert out.shape == (0, 3, 8, 9)


def test_channels_last_pictures_give_the_same_bits() -> None:
    aug, image = RandomExposure(TWO, p=1.0), pictures()
    out = aug(image)
    assert torch.equal(aug(image.to(memory_format=torch.channels_last), params=aug._params), out)


# Precision, gradients, compilers


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.float64])
@pytest.mark.parametrize("camera", ["imx250", TWO])
def test_other_precisions_come_back_as_they_came(dtype: torch.dtype, camera: Any) -> None:
    """Half precision is computed in float32: its result is float32's, rounded once."""
    aug, image = RandomExposure(camera, p=1.0), pictures().to(dtype)
    out = aug(image)
    assert out.dtype == dtype
    single = aug(image.float(), params=aug._params)
    if dtype == torch.float64:  # noise is drawn in double precision there, so only the mean agrees
        assert float((out - single).mean().abs()) < 0.01
    else:
        assert torch.equal(out, single.to(dtype))


def test_autocast_changes_nothing() -> None:
    torch.manual_seed(0)
    disc = replace(Camera.preset("imx250"), defocus_radius_px=2.0, defocus_counts_pixel=True)  # a convolution
    aug, image = RandomExposure((disc, "ar0237"), p=0.7), pictures(8)
    out, params = aug(image), aug._params
    with torch.autocast("cpu", dtype=torch.bfloat16):
        under = aug(image, params=params)
    assert under.dtype == torch.float32
    assert torch.equal(under, out)


@pytest.mark.parametrize("p", [0.5, 1.0])
def test_gradients_reach_the_pictures(p: float) -> None:
    """A picture's light moves its own output, upward; a picture that p leaves has the identity."""
    torch.manual_seed(8)
    image = pictures(6).mul(0.5).add(0.2).requires_grad_()
    aug = RandomExposure(TWO, exposure_s=0.01, illuminance_lux=(30, 60), speed_px_s=(0, 100), p=p)
    out = aug(image)
    out.sum().backward()
    assert image.grad is not None
    chosen = aug._params["batch_prob"] > 0.5
    if p < 1:
        assert 0 < int(chosen.sum()) < 6
        assert torch.equal(image.grad[~chosen], torch.ones_like(image.grad[~chosen]))
    sums = image.grad[chosen].sum((1, 2, 3))
    assert bool((sums > 0).all())
    assert bool(torch.isfinite(image.grad).all())


def test_gradients_reach_the_conditions_and_match_differences() -> None:
    lux = torch.tensor([40.0], dtype=torch.float64, requires_grad=True)
    scene = torch.full((1, 1, 64, 64), 0.5, dtype=torch.float64)

    def brightness(light: Tensor) -> Tensor:
        return expose_pictures(
            scene, "imx250", exposure_s=0.01, illuminance_lux=light, encoding="linear", generator=[3]
        ).mean()

    (slope,) = torch.autograd.grad(brightness(lux), lux)
    difference = (brightness(lux * 1.1) - brightness(lux * 0.9)) / (0.2 * lux)
    assert float(slope) == pytest.approx(float(difference.detach()), rel=0.02)


def test_developing_with_gradients_gives_the_tables_picture() -> None:
    camera = replace(Camera.preset("ar0237"), black_level_dn=64.0)
    dn = torch.arange(camera.full_scale_dn + 1.0)[None, None, None]
    for encoding in ("srgb", "linear"):
        formula = develop(dn.clone().requires_grad_(), camera, encoding=encoding)
        torch.testing.assert_close(formula, develop(dn, camera, encoding=encoding), atol=2e-6, rtol=0)


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["eager", "aot_eager"])
def test_compiled_models_may_begin_with_it(backend: str) -> None:
    torch.manual_seed(0)
    model = torch.nn.Sequential(RandomExposure(TWO, p=0.5), torch.nn.Conv2d(3, 4, 3), torch.nn.ReLU())
    compiled = torch.compile(model, backend=backend)
    with torch.no_grad():
        torch.manual_seed(1)
        expected = model(pictures())
        torch.manual_seed(1)
        torch.testing.assert_close(compiled(pictures()), expected, atol=1e-6, rtol=0)
    torch._dynamo.reset()


# Copies and workers


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda aug: pickle.loads(pickle.dumps(aug))])
def test_copies_draw_and_expose_alike(copied: Any) -> None:
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

    def __init__(self) -> None:
        self.aug = RandomExposure(TWO, p=1.0)
        self.images = pictures(8)

    def __len__(self) -> int:
        return len(self.images)

    def __getitem__(self, index: int) -> tuple[Tensor, dict[str, Tensor]]:
        out = self.aug(self.images[index])
        return out, self.aug._params


@pytest.mark.parametrize(
    ("start", "workers"),
    [("fork", 2), pytest.param("spawn", 1, marks=pytest.mark.slow)],  # which imports everything anew
)
def test_workers_draw_their_own_and_replay_elsewhere(start: str, workers: int) -> None:
    """Each worker's draws differ; given those, this process gets the same bits without workers."""
    data = Exposed()
    loader = DataLoader(
        data,
        batch_size=None,
        num_workers=workers,
        multiprocessing_context=start,
        generator=torch.Generator().manual_seed(1),
    )
    seeds = []
    for index, (out, params) in enumerate(loader):
        assert torch.equal(data.aug(data.images[index], params=params), out)
        seeds.append(int(params["noise_seed"]))
    assert len(set(seeds)) == len(data)


# Errors


@pytest.mark.parametrize(
    ("ranges", "error", "said"),
    [
        ({"exposure_s": (0.0, 0.01)}, ValueError, "exposure_s.*log-uniform"),
        ({"illuminance_lux": 0}, ValueError, "illuminance_lux.*log-uniform"),
        ({"exposure_s": (0.02, 0.01)}, ValueError, "exposure_s.*low <= high"),
        ({"exposure_s": (0.01, math.inf)}, ValueError, "exposure_s.*finite"),
        ({"speed_px_s": (-1.0, 5.0)}, ValueError, "speed_px_s.*>= 0"),
        ({"direction_deg": (0.0, 90.0, 180.0)}, TypeError, "direction_deg.*low, high"),
        ({"direction_deg": (math.nan, 1.0)}, ValueError, "direction_deg.*finite"),
        ({"temperature_c": (25.0, 400.0)}, ValueError, "temperature_c.*300"),
        ({"temperature_c": "warm"}, TypeError, "temperature_c.*number"),
        ({"temperature_c": None}, TypeError, "temperature_c.*number"),
        ({"camera": "imx999"}, ValueError, "imx999"),
        ({"camera": ()}, ValueError, "camera"),
        ({"camera": (3,)}, TypeError, "camera.*int"),
        ({"encoding": "rgb"}, ValueError, "encoding.*srgb"),
        ({"fidelity": "high"}, ValueError, "fidelity.*auto"),
        ({"p": 1.5}, ValueError, "p = 1.5"),
    ],
)
def test_wrong_arguments_are_named(ranges: dict[str, Any], error: type[Exception], said: str) -> None:
    with pytest.raises(error, match=said):
        RandomExposure(**ranges)


def test_overshoots_are_clamped_and_other_ranges_refused() -> None:
    image = pictures(2)
    image[0, 0, 0, 0], image[1, 0, 0, 0] = 1.0000001, -1e-7
    args: dict[str, Any] = {**CONDITIONS, "generator": [1, 2]}
    clamped = expose_pictures(image.clamp(0, 1), "imx250", **args)
    assert torch.equal(expose_pictures(image, "imx250", **args), clamped)
    with pytest.raises(ValueError, match=r"image.*\[0, 1\].*255"):
        expose_pictures(image * 255, "imx250", **args)
    with pytest.raises(ValueError, match=r"image.*normalise"):
        expose_pictures((image - 0.45) / 0.22, "imx250", **args)


@pytest.mark.parametrize(
    ("image", "given", "error", "said"),
    [
        (pictures(2).mul(255).byte(), {}, TypeError, "image.*float"),
        (torch.full((1, 1, 4, 4), math.nan), {}, ValueError, "image.*NaN"),
        ([[1.0]], {}, TypeError, "image"),
        (pictures(2), {"camera": ["imx250"] * 3}, ValueError, "camera: got 3.*2"),
        (pictures(2), {"exposure_s": [0.1] * 3}, ValueError, "exposure_s"),
        (pictures(2), {"speed_px_s": -1.0}, ValueError, "speed_px_s"),
        (pictures(2), {"encoding": "hsv"}, ValueError, "encoding"),
        (pictures(2), {"generator": [1]}, ValueError, "generator"),
    ],
)
def test_the_twins_errors_name_the_argument(
    image: Any, given: dict[str, Any], error: type[Exception], said: str
) -> None:
    with pytest.raises(error, match=said):
        expose_pictures(image, **{"camera": "imx250", **CONDITIONS, **given})
