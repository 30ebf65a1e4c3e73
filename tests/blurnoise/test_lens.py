"""Lenses as camera files state them: figures, curves, and what is wrong with them in one line."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from blurnoise import Camera
from blurnoise.optics.lens import Distortion, Lens, Mtf, RelativeIllumination

IMX250 = Camera.preset("imx250")
EVERY: dict[str, Any] = {
    "field_curvature_px": 1.5,
    "lateral_red": 0.0004,
    "lateral_blue": -0.0003,
    "relative_illumination": {"heights": [0, 0.5, 1], "values": [1, 0.9, 0.6]},
    "distortion": {"model": "opencv", "coefficients": [-0.2, 0.03, 0.001, 0, 0], "focal_px": [2400, 2400]},
    "mtf": {"frequencies": [20, 80, 160], "values": [0.9, 0.6, 0.1], "unit": "lp/mm"},
}


def of_file(folder: Path, lens: Any, **others: Any) -> Camera:
    path = folder / "mine.yaml"
    path.write_text(yaml.safe_dump({"base": "imx250", "lens": lens, **others}))
    return Camera.load(path)


@pytest.mark.parametrize("suffix", ["json", "yaml"])
def test_files_bring_a_lens_back(tmp_path: Path, suffix: str) -> None:
    camera = of_file(tmp_path, EVERY)
    assert camera.lens.mtf == Mtf((20.0, 80.0, 160.0), (0.9, 0.6, 0.1), "lp/mm")
    assert camera.lens.relative_illumination == RelativeIllumination((0.0, 0.5, 1.0), (1.0, 0.9, 0.6))
    assert camera.lens.distortion == Distortion("opencv", (-0.2, 0.03, 0.001, 0.0, 0.0), (2400.0, 2400.0))
    assert camera.sources["lens"] == "from mine.yaml"
    camera.save(tmp_path / f"camera.{suffix}")
    assert Camera.load(tmp_path / f"camera.{suffix}") == camera
    assert Camera.from_dict(json.loads(json.dumps(camera.to_dict()))) == camera
    assert len({camera, replace(camera, name="mine")}) == 1


def test_presets_have_none(tmp_path: Path) -> None:
    assert IMX250.lens == Lens()
    assert of_file(tmp_path, {}) == replace(IMX250, name="mine")


def test_curves_of_tables(tmp_path: Path) -> None:
    (tmp_path / "mtf.csv").write_text("frequency,on axis,corner\n0,1,1\n80,0.5,0.4\n145,0.2,0.1\n")
    (tmp_path / "light.csv").write_text("0,1\n5.5,0.7\n")
    camera = of_file(
        tmp_path,
        {
            "mtf": {"csv": "mtf.csv", "column": 2, "unit": "lp/mm"},
            "relative_illumination": {"csv": "light.csv", "unit": "mm"},
        },
    )
    assert camera.lens.mtf == Mtf((0.0, 80.0, 145.0), (1.0, 0.4, 0.1), "lp/mm")
    assert camera.lens.relative_illumination == RelativeIllumination((0.0, 5.5), (1.0, 0.7), "mm")
    assert camera.optics.measured is not None
    assert camera.optics.measured.frequencies[1] == pytest.approx(80 * 3.45e-3)


@pytest.mark.parametrize(
    ("lens", "others", "named"),
    [
        (3, {}, "lens = 3: must be a Lens, in a file a mapping of its figures"),
        ({"field_curvature_px": 60}, {}, "lens: field_curvature_px = 60.0: must be finite and >= -50 and <= 50"),
        ({"field_curvature_px": "1"}, {}, "lens: field_curvature_px = '1': must be a number"),
        ({"lateral_red": 0.2}, {}, "lens: lateral_red = 0.2: must be"),
        ({"falloff_power": -1}, {}, "lens: falloff_power = -1.0: must be"),
        ({"field_curvatur_px": 1}, {}, "lens: figure 'field_curvatur_px' is unknown; did you mean 'field_curvature"),
        ({"mtf": [1]}, {}, "lens: mtf = [1]: must map figures to values"),
        ({"mtf": {"frequencies": [1]}}, {}, "lens: mtf: missing values, unit"),
        ({"mtf": {"frequencies": [1, 2], "values": [1, 0.1], "unit": "m"}}, {}, "lens: mtf: unit = 'm': must be"),
        (
            {"mtf": {"frequencies": [0.1, 0.5], "values": [1, 1.1], "unit": "cycles/px"}}, {},
            "lens: mtf: values",
        ),
        (
            {"mtf": {"frequencies": [0.3, 0.1], "values": [1, 0.1], "unit": "cycles/px"}}, {},
            "lens: mtf: frequencies = (0.3, 0.1): must be >= 0 and increase",
        ),
        (
            {"mtf": {"frequencies": [0.3], "values": [1], "unit": "cycles/px"}}, {},
            "lens: mtf: frequencies, values: must be as many, at least 2, got 1 and 1",
        ),
        (
            {"mtf": {"frequencies": [0, 0.5], "values": [0.9, 0.1], "unit": "cycles/px"}}, {},
            "lens: mtf: values: must be 1 at frequency 0, got 0.9",
        ),
        (
            {"mtf": {"frequencies": [10, 40], "values": [0.9, 0.6], "unit": "lp/mm"}}, {},
            "lens.mtf: frequencies: must reach 0.5 cycles/px (144.928 lp/mm) or a value of 0.05, end at 40",
        ),
        ({"mtf": {"csv": "no.csv", "unit": "lp/mm"}}, {}, "lens: mtf: csv 'no.csv' cannot be read: No such file"),
        ({"mtf": {"csv": "bad.csv", "unit": "lp/mm"}}, {}, "bad.csv, line 2: expected one of frequencies and"),
        ({"mtf": {"csv": "bad.csv", "row": 1}}, {}, "lens: mtf: figure 'row' is unknown"),
        (
            {"mtf": {"frequencies": [0.1, 0.5], "values": [1, 0.1], "unit": "cycles/px"}}, {"defocus_radius_px": 1},
            "lens.mtf: is measured with defocus and diffraction",
        ),
        (
            {"relative_illumination": {"heights": [0, 1], "values": [1, 0.5]}, "falloff_power": 4}, {},
            "lens: falloff_power = 4: must be 0 beside relative_illumination",
        ),
        ({"field_curvature_px": 1}, {"defocus_counts_pixel": True}, "lens.field_curvature_px: must be 0 where"),
        ({"falloff_power": 4}, {"hfov_deg": 180}, "hfov_deg = 180: must be < 180 for"),
        ({"distortion": {"model": "barrel", "coefficients": [1]}}, {}, "lens: distortion: model = 'barrel': must"),
        (
            {"distortion": {"model": "opencv", "coefficients": [0.1, 0.2]}}, {},
            "lens: distortion: coefficients = (0.1, 0.2): must be 4 or 5 or 8 numbers, got 2",
        ),
        (
            {"distortion": {"model": "fisheye", "coefficients": [0, 0, 0, 0], "focal_px": [0, 1]}}, {},
            "lens: distortion: focal_px = 0.0: must be",
        ),
        (
            {"distortion": {"model": "opencv", "coefficients": [-0.9, 0, 0, 0]}}, {"hfov_deg": 100},
            "lens.distortion: images nothing beyond 0.4057 focal lengths from the centre",
        ),
    ],
)  # fmt: skip
def test_what_is_wrong_is_one_line(tmp_path: Path, lens: Any, others: Any, named: str) -> None:
    (tmp_path / "bad.csv").write_text("1,1\n2,x\n")
    with pytest.raises((ValueError, TypeError)) as error:
        of_file(tmp_path, lens, **others)
    assert named in str(error.value)
    assert "mine.yaml" in str(error.value)
    assert len(str(error.value).splitlines()) == 1
