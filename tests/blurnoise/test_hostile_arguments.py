"""Every public function under arguments of every wrong kind: a documented error of one line, or a finite result."""

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor
from torch._subclasses.fake_tensor import FakeTensorMode

import blurnoise
from blurnoise import AutoExposure, Camera, charts, metrics
from blurnoise.camera.captures import staggered
from blurnoise.metrics import flicker, information, patches, sharpness, slanted_edge
from blurnoise.training.pictures import expose_pictures

CAMERA = Camera.preset("imx250")
PICTURES = torch.rand(2, 3, 24, 31, generator=torch.Generator().manual_seed(1))
PATCH = PICTURES[0, 0].double()
AXIS = torch.linspace(0, 0.5, 9, dtype=torch.float64)
EDGE = charts.slanted_edge(40, 40)[0, 0] + 0.01 * torch.rand(
    40, 40, generator=torch.Generator().manual_seed(2)
)
MEASURED = slanted_edge(EDGE, bootstrap=3)
LIT = {"camera": CAMERA, "exposure_s": 0.01, "illuminance_lux": 10.0}
ROAD = {"speed_m_s": 10.0, "distance_m": 10.0, "target_width_m": 1.0, "width_px": 1000.0, "hfov_deg": 60.0}
NATURE = {"temperature_c": 25.0, "illuminant": "D55", "tolerance_dn": 0.1}
DIRECTED = {
    "speed_px_s": 0.0,
    "direction_deg": 0.0,
    "temperature_c": 25.0,
    "encoding": "srgb",
    "fidelity": "auto",
}
SCENE = {"border": "reflect"}
BATCH = {
    "exposure_s": torch.full((2,), 0.01),
    "illuminance_lux": torch.full((2,), 10.0),
    "temperature_c": 25.0,
}
OPTIONS = {"pattern_seed": 0, "fidelity": "auto", "tolerance_dn": 0.1}
ROLLS = blurnoise.Exposure(Camera.preset("ar0237"), 0.01, 10.0, (90.0, 20.0))
BOXES = torch.tensor([[3.0, 4.0, 9.0, 20.0]])
LABELS = {"keypoints": np.zeros((1, 2)), "boxes": np.ones((1, 4))}
LAYER = {
    "light": torch.full((3, 9, 7), 0.4),
    "alpha": torch.ones(9, 7),
    "velocity_px_s": (80.0, 0.0),
    "place_px": (5, 6),
}
MOVED = {"exposure_s": 0.05, "velocity_px_s": (0.0, 9.0), "border": "reflect"}
TURNED = {"angle_deg": 5.0}
DRAWN = {"size_px": 9.0, "height_px": 20, "width_px": 20, **TURNED, "supersample": 2}
ACROSS = {"across_x": MEASURED, "across_y": MEASURED}
NOISY = {"signal_pp": 1.0, "noise_variance": 0.1}
PLANE = {"frequency_x": AXIS, "frequency_y": AXIS}
MEASURING = {"image": EDGE, "mode": "exact", "full_scale": 1.0, "black_level": 0.0, "roi": (0, 0, 30, 30)}
MEASURING |= {"bootstrap": 2, "seed": 0}
METERED = {"target": 0.18, "frame_rate_hz": 30.0, "readout_s": 0.001, "longest_s": 0.02, "mains_hz": 50.0}
METERED |= {"row_time_s": 1e-5, "gain_max_db": 24.0}


def fixed_pattern(shape):
    return CAMERA.sensor.fixed_pattern(shape, 0)


def exposed(**values):
    """Pictures of a batch by a camera of two captures."""
    several = CAMERA.with_figures(captures=staggered(4.0))
    return blurnoise.take(blurnoise.Scene(PICTURES), blurnoise.Exposure(several, **values)).picture


CALLS: list[tuple[Callable[..., Any], Mapping[str, Any]]] = [
    (blurnoise.Camera, {entry.name: getattr(CAMERA, entry.name) for entry in fields(CAMERA)}),
    *((type(record), vars(record)) for record in (CAMERA.lens, CAMERA.sensor, CAMERA.isp)),
    (fixed_pattern, {"shape": (1, 24, 31)}),
    (CAMERA.sensor.dark_variance_dn2, {"dark_e": 0.0}),
    (blurnoise.Layer, LAYER),
    (blurnoise.expose_layers, {**MOVED, "background": PICTURES, "layers": [blurnoise.Layer(**LAYER)]}),
    (blurnoise.Curve, {"wavelengths_nm": (400.0, 700.0), "values": (0.1, 0.2)}),
    (blurnoise.Exposure, {**LIT, "velocity_px_s": (0.0, 0.0), "temperature_c": 25.0, "gain_db": 0.0, "seed": 0,
                          "illuminant": "D55"}),
    (blurnoise.Optics, dict.fromkeys(("defocus_radius_px", "gaussian_sigma_px", "diffraction_lambda_n_px"), 1.0)),
    (blurnoise.RandomExposure, {**LIT, **DIRECTED, "p": 0.5}),
    (blurnoise.Scene, {"light": PICTURES, **SCENE}),
    (blurnoise.TakeOptions, {**OPTIONS, "noise": True, "quantised": True, "white": 1.0}),
    (blurnoise.Trajectory, {"time_s": (0.0, 1.0), "x_px": (0.0, 1.0), "y_px": (0.0, 1.0)}),
    (blurnoise.blur_pixels, {**ROAD, "exposure_s": 0.01, "lens": "f-theta"}),
    (blurnoise.velocity_px_s, {**ROAD, "lens": "rectilinear"}),
    (blurnoise.develop, {"dn": 4000 * PICTURES, "camera": CAMERA, "encoding": "srgb", "gain_db": 0.0}),
    (blurnoise.motion_blur, {"image": PICTURES, "displacement_px": (3.0, 1.0), "method": "auto"}),
    (blurnoise.photoelectrons, {**LIT, "illuminant": "D55"}),
    (blurnoise.plan, {"exposure": blurnoise.Exposure(**LIT), "scene": None, "tolerance_dn": 0.1}),
    (ROLLS.move_boxes, {"boxes_xyxy": BOXES, "size": (24, 31)}),
    (ROLLS.sweep_boxes, {"boxes_xyxy": BOXES, "size": (24, 31)}),
    (blurnoise.take, {"scene": blurnoise.Scene(PICTURES[:1]), "exposure": blurnoise.Exposure(**LIT),
                      "options": blurnoise.TakeOptions()}),
    (blurnoise.take_each, {"scene": blurnoise.Scene(PICTURES[:1]), "exposures": [blurnoise.Exposure(**LIT)],
                           "options": blurnoise.TakeOptions()}),
    (exposed, {**BATCH, "velocity_px_s": (9.0, 0.0), "gain_db": 0.0, "seed": [1, 2], "lamp": None}),
    (blurnoise.simulate, {"image": PICTURES, **LIT, **NATURE, **SCENE, **OPTIONS, "velocity_px_s": (0, 0),
                          "encoding": "srgb", "generator": [1, 2]}),
    (AutoExposure, METERED),
    (blurnoise.Capture, {"exposure_ratio": 4.0, "gain_db": 6.0}),
    (blurnoise.Pwm, {"frequency_hz": 90.0, "duty": 0.1, "phase": 0.5}),
    (blurnoise.expose_numpy, {"image": np.zeros((2, 24, 31, 3), np.uint8), "exposure": ROLLS, "channels": "rgb"}),
    (blurnoise.labels_numpy, {"shape": (24, 31), "exposure": ROLLS, **LABELS}),
    (expose_pictures, {"image": PICTURES, "exposure": ROLLS}),
    (slanted_edge, MEASURING),
    (charts.flat_patch, {"height_px": 5, "width_px": 5, "reflectance": 0.2}),
    (charts.slanted_edge, {"height_px": 5, "width_px": 5, **TURNED, "dark": 0.1, "bright": 0.8}),
    (charts.siemens_star, {**DRAWN, "cycles": 5, "dark": 0.1, "bright": 0.8}),
    (charts.stop_sign, {**DRAWN, "centre_px": (10.0, 10.0), "background": 0.2}),
    (patches.patch_contrast, {"bright": PATCH + 1, "dark": PATCH}),
    (patches.contrast_transfer_accuracy, {"patch_a": PATCH + 1, "patch_b": PATCH, "nominal": 0.5, "tolerance": 0.2}),
    (flicker.modulation_index, {"means": AXIS + 1}),
    (flicker.detection_index, {"means": AXIS + 1, "off": 1.0, "threshold": 0.1}),
    (flicker.mitigation_probability, {"means": AXIS + 1, "tolerance": 0.1}),
    (information.capacity_radial, {"edge": MEASURED}),
    (information.capacity_square, ACROSS),
    (information.neq_0, {"edge": MEASURED}),
    (information.neq_integral, ACROSS),
    (information.square_snr, {**ACROSS, "side_px": 5}),
    (information.shannon_capacity_radial, {"frequency": AXIS, "power": AXIS, **NOISY}),
    (information.shannon_capacity_square, {**PLANE, "power": AXIS[:, None] * AXIS, **NOISY}),
    (information.neq, {"power": AXIS, "mean_signal": 1.0, "noise_power_spectrum": 0.1}),
    (information.ideal_observer_snr, {"difference": PATCH, "power": 1.0, "noise_power_spectrum": 1.0}),
    (information.square_integral, {**PLANE, "density": AXIS[:, None] * AXIS}),
    (patches.patch_snr, {"patch": PATCH, "limits_dn": (0.0, 1.0)}),
    (patches.veiling_glare, {"black": PATCH, "white": PATCH + 1}),
    (sharpness.acutance, {"edge": MEASURED, "px_per_degree": 60.0}),
    (sharpness.contrast_sensitivity, {"cycles_per_degree": AXIS}),
    (sharpness.star_response, {"picture": charts.siemens_star(60)[0, 0], "cycles": 36, "modulation": 0.5}),
    (patches.psnr, {"picture": PICTURES, "reference": PICTURES, "data_range": 1.0}),
    (patches.ssim, {"picture": PICTURES, "reference": PICTURES, "data_range": 1.0}),
]  # fmt: skip
METRICS = (information, patches, sharpness)
with FakeTensorMode():
    FAKE = torch.ones(())
WITHIN_ITSELF: list[Any] = []
WITHIN_ITSELF.append(WITHIN_ITSELF)
HOSTILE: Mapping[str, Any] = {
    "None": None,
    "text": "abc",
    "NaN": math.nan,
    "Inf": math.inf,
    "-1e300": -1e300,
    "1e300": 1e300,
    "1e-300": 1e-300,
    "10**400": 10**400,
    "complex": 1j,
    "object": object(),
    "three": [1, 2, 3],
    "none": [],
    "mapping": {},
    "array": np.zeros((2, 3, 24, 31), np.float32),
    "NaN pictures": torch.full((2, 3, 24, 31), math.nan),
    "empty batch": torch.zeros(0, 3, 24, 31),
    "integer pictures": torch.zeros(2, 3, 24, 31, dtype=torch.int64),
    "half pictures": torch.zeros(2, 3, 24, 31, dtype=torch.float16),
    "complex pictures": torch.zeros(2, 3, 24, 31, dtype=torch.complex64),
    "masks": torch.zeros(2, 3, 24, 31, dtype=torch.bool),
    "five axes": torch.zeros(1, 1, 1, 2, 2),
    "meta": torch.ones((), device="meta"),
    "meta pictures": torch.ones(2, 3, 24, 31, device="meta"),
    "meta list": [torch.ones((), device="meta")] * 2,
    "fake": FAKE,
    "sparse": torch.ones(2).to_sparse(),
    "float8": torch.tensor(1.0).to(torch.float8_e4m3fn),
    "one pixel": torch.ones(1, 1, 1, 1),
    "within itself": WITHIN_ITSELF,
    "longdouble": np.longdouble(1),
}
NEVER_RIGHT = ("text", "NaN", "Inf", "-1e300", "complex", "object")
# A name is any text, dark electrons below 0 are a number; the others are read when they are used.
READ_LATER = {"Camera.name", "take_each.exposures", "Sensor.dark_variance_dn2.dark_e"}


def test_every_public_function_is_here():
    called = {function for function, _ in CALLS}
    assert {getattr(blurnoise, name) for name in blurnoise.__all__} - {blurnoise.Frames} <= called
    assert {getattr(metrics, name) for name in metrics.__all__} - {
        metrics.Flag,
        metrics.SlantedEdge,
    } <= called
    for module in METRICS:
        own = [
            each
            for _, each in inspect.getmembers(module, inspect.isfunction)
            if each.__module__ == module.__name__
        ]
        assert {each for each in own if not each.__name__.startswith("_")} <= called, module.__name__


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    ("function", "good"),
    CALLS,
    ids=[f"{each.__module__.split('.')[-1]}.{each.__name__}" for each, _ in CALLS],
)
def test_wrong_arguments_are_named_in_a_line(function, good):
    function(**good)
    for argument in good:
        for kind, bad in HOSTILE.items():
            try:
                found = function(**{**good, argument: bad})
            except (TypeError, ValueError) as error:
                text = str(error)
                named = [*good, "camera", "wavelengths"]  # an argument may be wrong beside another
                assert any(name in text for name in named), (argument, kind, text)
                assert len(text.splitlines()) == 1, (argument, kind, text)
                assert len(text) < 400, (argument, kind, text)
            else:
                if function.__module__.partition(".metrics")[1] == "":
                    finite = not isinstance(found, Tensor) or bool(torch.isfinite(found).all())
                    assert finite, (argument, kind)
                    name = f"{function.__qualname__}.{argument}"
                    assert kind not in NEVER_RIGHT or name in READ_LATER, (name, kind)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: blurnoise.simulate(PICTURES, **LIT, noise=torch.ones(2)), "noise: must be a bool, got Tensor"),
        (lambda: blurnoise.simulate(PICTURES.to_sparse(), **LIT), "image: must be a dense tensor with values"),
        (lambda: blurnoise.simulate(PICTURES.to("meta"), **LIT), "image: must be a dense tensor with values"),
        (lambda: blurnoise.motion_blur(PICTURES, torch.ones(2, device="meta")), "displacement_px: must be a dense"),
        (lambda: Camera.load(3), "path = 3: must be a path"),
        (lambda: blurnoise.RandomExposure()(PICTURES.to("meta")), "input: must be a dense tensor with values"),
        (lambda: blurnoise.RandomExposure()("text"), "input: must be a torch.Tensor, got str"),
    ],
)  # fmt: skip
def test_no_raw_errors_of_torch_or_python(call, message):
    with pytest.raises(TypeError, match=message):
        call()
