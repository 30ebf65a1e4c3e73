"""Cameras of one's own: files that come back as they went, and one clear complaint for every bad one."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import blurnoise
from blurnoise import Camera, Curve, plan
from blurnoise.optics.camera import PRESETS
from blurnoise.optics.colour import FilterCurves
from blurnoise.optics.radiometry import electrons_per_lux_s
from blurnoise.optics.spectra import daylight

IMX250 = PRESETS["imx250"]
OWN = {
    "name": "own",
    "pixel_pitch_um": 3,
    "f_number": 2,
    "transmission": 0.9,
    "quantum_efficiency": 0.6,
    "full_well_e": 10000,
    "system_gain_dn_per_e": 0.4,
    "read_noise_e": 3.0,
}


def written(path: Path, values: Any) -> Path:
    path.write_text(values if isinstance(values, str) else yaml.safe_dump(values), encoding="utf-8")
    return path


def test_every_file_of_the_package_is_a_preset() -> None:
    files = Path(blurnoise.__file__).parent.joinpath("optics", "data", "cameras").glob("*.yaml")
    assert sorted(PRESETS) == sorted(file.stem for file in files)
    assert all(camera.name == name for name, camera in PRESETS.items())


@pytest.mark.parametrize("suffix", ["json", "yaml", "yml", "YAML"])
@pytest.mark.parametrize("name", sorted(PRESETS))
def test_files_bring_every_preset_back(tmp_path: Path, name: str, suffix: str) -> None:
    camera, path = PRESETS[name], tmp_path / f"camera.{suffix}"
    camera.save(path)
    back = Camera.load(path)
    assert back == camera
    assert dict(back.sources) == dict(camera.sources)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
    assert Camera.from_dict(json.loads(json.dumps(camera.to_dict()))) == camera


def test_json_and_yaml_are_what_their_suffixes_say(tmp_path: Path) -> None:
    IMX250.save(tmp_path / "a.json")
    IMX250.save(tmp_path / "a.yaml")
    assert json.loads((tmp_path / "a.json").read_text()) == IMX250.to_dict()
    assert yaml.safe_load((tmp_path / "a.yaml").read_text()) == IMX250.to_dict()
    with pytest.raises(ValueError, match="Expecting"):
        json.loads((tmp_path / "a.yaml").read_text())


def test_numbers_of_other_kinds_become_plain_ones(tmp_path: Path) -> None:
    """NumPy's numbers enter a camera; a file and the identity of a run need Python's."""
    camera = replace(IMX250, read_noise_e=np.float32(2.5), bit_depth=np.int64(12), f_number=2)  # type: ignore[arg-type]
    assert [type(value) for value in (camera.read_noise_e, camera.bit_depth, camera.f_number)] == [
        float, int, float,
    ]  # fmt: skip
    camera.save(tmp_path / "camera.yaml")
    assert Camera.load(tmp_path / "camera.yaml") == camera


def test_own_camera_says_where_its_figures_are_from(tmp_path: Path) -> None:
    own = OWN | {"sources": {"read_noise_e": "measured by me"}}
    camera = Camera.load(written(tmp_path / "own.yaml", own))
    assert (camera.full_well_e, camera.bit_depth) == (10000.0, 12)
    assert camera.sources["read_noise_e"] == "measured by me"
    assert camera.sources["full_well_e"] == "from own.yaml"
    assert camera.sources["bit_depth"].startswith("assumed")
    assert Camera.from_dict(OWN).sources["full_well_e"] == "given"


def test_base_gives_the_rest(tmp_path: Path) -> None:
    stated = {"base": "imx250", "read_noise_e": 5.0, "f_number": 2.8, "sources": {"f_number": "my lens"}}
    camera = Camera.load(written(tmp_path / "mine.yaml", stated))
    assert camera == replace(IMX250, name="mine", read_noise_e=5.0, f_number=2.8)
    changed = {"read_noise_e": "from mine.yaml", "f_number": "my lens"}
    assert dict(camera.sources) == {**IMX250.sources, **changed}
    assert Camera.from_dict({"base": "imx250"}) == IMX250
    assert dict(PRESETS["imx250"].sources) == dict(Camera.preset("imx250").to_dict()["sources"])  # type: ignore[call-overload]


@pytest.mark.parametrize(("column", "values"), [(None, (0.1, 0.6)), (2, (0.2, 0.5))])
def test_quantum_efficiency_from_csv(tmp_path: Path, column: int | None, values: tuple[float, float]) -> None:
    (tmp_path / "curves").mkdir()
    (tmp_path / "curves" / "qe.csv").write_text("nm,red,green\n400,0.1,0.2\n700,0.6,0.5\n")
    stated: dict[str, Any] = {"csv": "curves/qe.csv"} | ({} if column is None else {"column": column})
    path = written(tmp_path / "mine.yaml", {"base": "imx250", "quantum_efficiency": stated})
    camera = Camera.load(path)
    assert camera.quantum_efficiency == Curve((400.0, 700.0), values)
    assert camera.sources["quantum_efficiency"] == "from mine.yaml"


@pytest.mark.parametrize(
    ("change", "kind", "named"),
    [
        ({"read_noise": 3}, ValueError, "'read_noise' is unknown; did you mean 'read_noise_e'"),
        ({"iris": 3}, ValueError, "'iris' is unknown; Known are base, name, pixel_pitch_um"),
        ({7: 3}, ValueError, "field 7 is unknown"),
        ({"read_noise_e": None}, TypeError, "read_noise_e = None: must be a number"),
        ({"read_noise_e": True}, TypeError, "read_noise_e = True: must be a number"),
        ({"full_well_e": "1e4"}, TypeError, "full_well_e = '1e4': must be a number, not text (YAML"),
        ({"full_well_e": [1]}, TypeError, "full_well_e = [1]: must be a number"),
        ({"full_well_e": 10**400}, ValueError, "0: must be finite and >= 1 and <= 1e+12"),
        ({"full_well_e": float("nan")}, ValueError, "full_well_e = nan: must be finite and >= 1 and <= 1e+12"),
        ({"bit_depth": 12.0}, TypeError, "bit_depth = 12.0: must be an integer"),
        ({"bit_depth": True}, TypeError, "bit_depth = True: must be an integer"),
        ({"bit_depth": 17}, ValueError, "bit_depth = 17: must be finite and >= 1 and <= 16"),
        ({"name": 250}, TypeError, "name = 250: must be text"),
        ({"name": " "}, ValueError, "name = ' ': must not be empty"),
        ({"defocus_counts_pixel": 1}, TypeError, "defocus_counts_pixel = 1: must be true or false"),
        ({"black_level_dn": 4095}, ValueError, "black_level_dn = 4095.0: must be finite and >= 0 and <= 4094"),
        ({"black_level_dn": 5000}, ValueError, "black_level_dn = 5000.0"),
        ({"read_noise_e": -1}, ValueError, "read_noise_e = -1.0: must be finite and >= 0"),
        ({"diffraction_wavelength_um": -1}, ValueError, "diffraction_wavelength_um = -1.0: must be finite and >= 0"),
        ({"bit_depth": 10**400}, ValueError, "0: must be finite and >= 1 and <= 16"),
        ({"sources": {"x" * 10**5: "x"}}, ValueError, "sources: field 'xxx"),
        ({"y" * 10**5: 1}, ValueError, "field 'yyy"),
        ({"full_well_e": "9" * 10**5}, TypeError, "full_well_e = '999"),
        ({"quantum_efficiency": {"csv": ["a"] * 10**4}}, TypeError, "quantum_efficiency: csv = ['a', 'a'"),
        ({"base": "imx25"}, ValueError, "base = 'imx25': must be one of 'ar0132at'"),
        ({"base": ["imx250"]}, TypeError, "base = ['imx250']: must be text"),
        ({"sources": "a book"}, TypeError, "sources = 'a book': must map"),
        ({"sources": {"gain": "x"}}, ValueError, "sources: field 'gain' is unknown"),
        ({"sources": {"f_number": 3}}, TypeError, "sources.f_number = 3: must be text"),
        ({"quantum_efficiency": 60}, ValueError, "quantum_efficiency = 60.0: must be finite and >= 0 and <= 1"),
        ({"quantum_efficiency": {"nm": [1]}}, ValueError, "Known are wavelengths_nm, values, csv, column"),
        ({"quantum_efficiency": {"csv": "no.csv"}}, ValueError, "csv 'no.csv' cannot be read: No such file"),
        ({"quantum_efficiency": {"csv": "bad.csv"}}, ValueError, "bad.csv, line 2"),
        ({"quantum_efficiency": {"csv": "a.csv", "values": [1]}}, ValueError, "must not stand beside it"),
        ({"quantum_efficiency": {"csv": "bytes.csv"}}, ValueError, "quantum_efficiency: "),
        ({"quantum_efficiency": {"csv": "qe.csv", "column": 0}}, ValueError, "column = 0"),
        ({"quantum_efficiency": {"csv": "percent.csv"}}, ValueError, "quantum_efficiency = 60.0"),
        (
            {"quantum_efficiency": {"wavelengths_nm": [500, 400], "values": [0.1, 0.2]}},
            ValueError, "quantum_efficiency: wavelengths_nm = (500.0, 400.0): must be >= 0 and increase",
        ),
        (
            {"quantum_efficiency": {"wavelengths_nm": [400, 500], "values": [0.1, "a"]}},
            TypeError, "quantum_efficiency: values = 'a': must be a number",
        ),
        (
            {"quantum_efficiency": {"wavelengths_nm": 400, "values": 1}},
            TypeError, "wavelengths_nm = 400: must be a list",
        ),
    ],
)  # fmt: skip
def test_bad_fields_are_named(
    tmp_path: Path, change: dict[Any, Any], kind: type[Exception], named: str
) -> None:
    written(tmp_path / "bad.csv", "nm,qe\n400,high\n")
    written(tmp_path / "percent.csv", "400,60\n700,50\n")
    (tmp_path / "bytes.csv").write_bytes(b"400,0.1\n\xff\xfe\x00,2\n")
    path = written(tmp_path / "own.yaml", OWN | change)
    with pytest.raises((ValueError, TypeError)) as error:
        Camera.load(path)
    assert error.type is kind
    assert str(error.value).startswith(f"{path}: ")
    assert named in str(error.value)
    assert len(str(error.value).splitlines()) == 1
    assert len(str(error.value)) < len(str(path)) + 900


def test_halves_of_characters_are_refused_where_they_stand(tmp_path: Path) -> None:
    """They cannot be written: a camera that holds one could not be saved."""
    for change, named in ({"name": "a\ud800"}, "name"), ({"sources": {"prnu": "\ud800"}}, "sources.prnu"):
        path = tmp_path / "half.json"
        path.write_text(json.dumps(OWN | change))
        with pytest.raises(
            ValueError, match=rf"half\.json: {named} = '.*ud800': must be text, without halves"
        ):
            Camera.load(path)


def test_diffraction_is_of_the_wavelength_at_the_f_number() -> None:
    """A green f/2.8 on 3.45 um has lambda N = 0.446 px; by default the lens has none."""
    camera = replace(IMX250, f_number=2.8, diffraction_wavelength_um=0.55, defocus_radius_px=0.7)
    assert camera.optics.diffraction_lambda_n_px == pytest.approx(0.4464, abs=5e-5)
    assert camera.optics.defocus_radius_px == 0.7
    assert all(each.optics.diffraction_lambda_n_px == 0.0 for each in PRESETS.values())


@pytest.mark.parametrize("left_out", sorted(set(OWN) - {"name"}))
def test_missing_fields_are_named(left_out: str) -> None:
    with pytest.raises(ValueError, match=f"missing {left_out}; state them, or a base: one of ar0132at"):
        Camera.from_dict({name: value for name, value in OWN.items() if name != left_out})


def test_name_is_needed_or_the_files(tmp_path: Path) -> None:
    nameless = {name: value for name, value in OWN.items() if name != "name"}
    assert Camera.load(written(tmp_path / "rig.yaml", nameless)).name == "rig"
    with pytest.raises(ValueError, match="missing name"):
        Camera.from_dict(nameless)


@pytest.mark.parametrize(
    ("name", "text", "kind", "named"),
    [
        ("a.json", "{ no json", ValueError, "is no JSON: Expecting"),
        ("a.json", "[" * 100_000, ValueError, "is no JSON"),
        ("a.json", "name: own", ValueError, "is no JSON"),
        ("a.yaml", "a: b: c", ValueError, "is no YAML: mapping values"),
        ("a.yaml", "a: !!python/object:os.system x", ValueError, "is no YAML"),
        ("a.yaml", "- 1\n- 2\n", TypeError, "must map fields to values, got list"),
        ("a.json", "[1, 2]", TypeError, "must map fields to values, got list"),
        ("a.yaml", "", TypeError, "must map fields to values, got NoneType"),
        ("a.yaml", "name: !!int ''", ValueError, "is no YAML: "),
        ("a.json", '{"full_well_e": 1' + "0" * 5000 + "}", ValueError, "is no JSON: Exceeds the limit"),
        ("a.txt", "name: own", ValueError, "'.txt': must be one of '.json', '.yaml', '.yml'"),
        ("camera", "name: own", ValueError, "'': must be one of '.json'"),
    ],
)
def test_bad_files_are_named(tmp_path: Path, name: str, text: str, kind: type[Exception], named: str) -> None:
    path = written(tmp_path / name, text)
    with pytest.raises((ValueError, TypeError)) as error:
        Camera.load(path)
    assert error.type is kind
    assert str(path) in str(error.value)
    assert named in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_bytes_that_are_no_text(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_bytes(b"name: \xff\xfe")
    with pytest.raises(ValueError, match=r"a\.yaml: is no YAML"):
        Camera.load(tmp_path / "a.yaml")
    with pytest.raises(FileNotFoundError, match="nowhere"):
        Camera.load(tmp_path / "nowhere.yaml")


def test_nothing_is_half_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "camera.yaml"
    IMX250.save(path)
    before = path.read_bytes()

    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match=r"No space left on device: .*camera\.yaml'"):
        PRESETS["imx249"].save(path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(ValueError, match="suffix"):
        IMX250.save(tmp_path / "camera.txt")
    assert list(tmp_path.iterdir()) == [path]


def test_decibels_of_the_data_sheets() -> None:
    """EMVA 1288: the maximum SNR comes back; the dynamic range to the rounding noise, which K adds here."""
    for name, snr_db, range_db in (("imx250", 40.3, 71.2), ("imx249", 45.1, 73.0), ("mt9m034", 37.7, 63.4)):
        camera = PRESETS[name]
        assert camera.snr_max_db == pytest.approx(snr_db, abs=0.005)
        fine = replace(camera, system_gain_dn_per_e=1e9, black_level_dn=0.0, full_well_e=1.0)
        ideal_e = 0.5 + (0.25 + camera.read_noise_e**2) ** 0.5
        assert fine.threshold_e == pytest.approx(ideal_e)
        assert 0.0 < range_db - camera.dynamic_range_db < 0.5


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_every_preset_says_how_far_its_curve_reaches(name: str) -> None:
    """By the integral written out: what the band below 470 nm is worth; and the figures are what they were."""
    camera = PRESETS[name]
    source = camera.sources["quantum_efficiency"]
    if isinstance(camera.quantum_efficiency, FilterCurves):
        assert "held below 470 nm" in source
        return
    if not isinstance(camera.quantum_efficiency, Curve):
        assert "0 outside" in source
        return
    nm = np.arange(400.0, 701.0)
    light = daylight(5500 * 1.4388 / 1.4380).at(nm) * nm
    stated = camera.quantum_efficiency.at(nm)
    held = np.where(nm < 470, 0.5, stated)
    more = (light * held).sum() / (light * np.where(nm < 470, 0, stated)).sum() - 1
    assert more == pytest.approx(0.193, abs=0.002)
    assert "marked" in source
    assert "begins at 470 nm with 83% of its peak" in source
    assert "+19.3% of white if held" in source
    if name == "imx250":
        assert electrons_per_lux_s(camera) == pytest.approx(6906, abs=1)


@pytest.mark.parametrize(
    ("nm", "values", "marked"),
    [
        ((470, 700), (0.5, 0.3), ["begins at 470 nm with 100%"]),
        ((380, 650), (0.1, 0.4), ["ends at 650 nm with 100%"]),
        ((450, 550, 650), (0.3, 0.6, 0.2), ["begins at 450 nm with 50%", "ends at 650 nm with 33%"]),
        ((450, 550, 650), (0.02, 0.6, 0.02), []),  # over where it ends
        ((400, 700), (0.5, 0.5), []),
        ((300, 1100), (0.2, 0.5), []),
    ],
)
def test_curves_cut_short_within_the_visible_band_are_marked(
    tmp_path: Path, nm: tuple[float, ...], values: tuple[float, ...], marked: list[str]
) -> None:
    stated = {"base": "imx250", "quantum_efficiency": {"wavelengths_nm": list(nm), "values": list(values)}}
    camera = Camera.load(written(tmp_path / "mine.yaml", stated))
    source = camera.sources["quantum_efficiency"]
    assert source.startswith("from mine.yaml")
    assert ("marked" in source) == bool(marked)
    assert all(mark in source for mark in marked)
    camera.save(tmp_path / "again.yaml")
    assert Camera.load(tmp_path / "again.yaml").sources["quantum_efficiency"] == source
    (how,) = (
        each.how for each in plan(camera, exposure_s=0.01, illuminance_lux=50).stages if "spec" in each.name
    )
    assert all(mark in how for mark in marked)
