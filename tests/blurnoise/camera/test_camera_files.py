"""Cameras of one's own: files that come back as they went, and one clear complaint for every bad one."""

import json
from pathlib import Path

import pytest
import yaml

import blurnoise
from blurnoise import Camera, Curve
from blurnoise.camera import PRESETS
from blurnoise.camera.isp import LocalTone, NoiseReduction, Sharpening
from blurnoise.camera.radiometry import electrons_per_lux_s

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


def written(path, values):
    path.write_text(values if isinstance(values, str) else yaml.safe_dump(values), encoding="utf-8")
    return path


def test_every_file_of_the_package_is_a_preset():
    files = Path(blurnoise.__file__).parent.joinpath("camera", "data", "cameras").glob("*.yaml")
    assert sorted(PRESETS) == sorted(file.stem for file in files)


@pytest.mark.parametrize("suffix", ["json", "YAML"])
@pytest.mark.parametrize("name", sorted(PRESETS))
def test_files_bring_every_preset_back(tmp_path, name, suffix):
    camera, path = PRESETS[name], tmp_path / f"camera.{suffix}"
    camera.save(path)
    back = Camera.load(path)
    assert back == camera
    assert dict(back.sources) == dict(camera.sources)
    read = json.loads if suffix == "json" else yaml.safe_load
    assert read(path.read_text()) == camera.to_dict()
    assert Camera.from_dict(json.loads(json.dumps(camera.to_dict()))) == camera


def test_own_camera_says_where_its_figures_are_from(tmp_path):
    own = OWN | {"sources": {"read_noise_e": "measured by me"}}
    camera = Camera.load(written(tmp_path / "own.yaml", own))
    assert (camera.sensor.full_well_e, camera.sensor.bit_depth) == (10000.0, 12)
    assert camera.sources["read_noise_e"] == "measured by me"
    assert camera.sources["full_well_e"] == "from own.yaml"
    assert camera.sources["bit_depth"].startswith("assumed")
    assert Camera.from_dict(OWN).sources["full_well_e"] == "given"


def test_base_gives_the_rest(tmp_path):
    stated = {"base": "imx250", "read_noise_e": 5.0, "f_number": 2.8, "sources": {"f_number": "my lens"}}
    camera = Camera.load(written(tmp_path / "mine.yaml", stated))
    assert camera == IMX250.with_figures(name="mine", read_noise_e=5.0, f_number=2.8)
    changed = {"read_noise_e": "from mine.yaml", "f_number": "my lens"}
    assert dict(camera.sources) == {**IMX250.sources, **changed}
    assert Camera.from_dict({"base": "imx250"}) == IMX250


def test_files_have_the_enhancement_by_gain(tmp_path):
    table = [
        {"luma_sigma_dn": 2},
        {"gain_db": 24, "luma_sigma_dn": 9, "chroma_sigma_dn": 18, "strength": 0.8},
    ]
    stated = {"base": "imx250", "noise_reduction": table, "sharpening": [{"strength": 1, "limit_dn": 9}]}
    camera = Camera.load(written(tmp_path / "mine.yaml", stated | {"local_tone": {"clip_limit": 2}}))
    assert camera.isp.noise_reduction == (NoiseReduction(0.0, 2.0), NoiseReduction(24.0, 9.0, 18.0, 0.8))
    assert camera.isp.sharpening == (Sharpening(strength=1.0, limit_dn=9.0),)
    assert camera.isp.local_tone == LocalTone(2.0, 8)
    assert camera.sources["noise_reduction"] == "from mine.yaml"
    camera.save(tmp_path / "back.yaml")
    assert Camera.load(tmp_path / "back.yaml") == camera


@pytest.mark.parametrize(("column", "values"), [(None, (0.1, 0.6)), (2, (0.2, 0.5))])
def test_quantum_efficiency_from_csv(tmp_path, column, values):
    (tmp_path / "curves").mkdir()
    (tmp_path / "curves" / "qe.csv").write_text("nm,red,green\n400,0.1,0.2\n700,0.6,0.5\n")
    stated = {"csv": "curves/qe.csv"} | ({} if column is None else {"column": column})
    path = written(tmp_path / "mine.yaml", {"base": "imx250", "quantum_efficiency": stated})
    camera = Camera.load(path)
    assert camera.sensor.quantum_efficiency == Curve((400.0, 700.0), values)
    assert camera.sources["quantum_efficiency"] == "from mine.yaml"


BAD_FIELDS = [
    ({"read_noise": 3}, "'read_noise' is unknown (did you mean 'read_noise_e'?); must be one of "),
    ({"falloff_power": 4}, "field 'falloff_power': must be in the mapping lens, as lens: {falloff_power: "),
    ({"iris": 3}, "'iris' is unknown; must be one of analogue_gain_max_db, base, bit_depth"),
    ({"read_noise_e": True}, "read_noise_e = True: must be a number"),
    ({"full_well_e": "1e4"}, "full_well_e = '1e4': must be a number, not text (YAML"),
    ({"bit_depth": 12.0}, "bit_depth = 12.0: must be an integer"),
    ({"name": 250}, "name = 250: must be text"),
    ({"name": " "}, "name = ' ': must not be empty"),
    ({"name": "a\ud800"}, "ud800': must be text, without halves"),
    ({"black_level_dn": 4095}, "black_level_dn = 4095.0: must be finite and >= 0 and <= 4094"),
    ({"full_well_e": "9" * 10**5}, "full_well_e = '999"),
    ({"base": "imx25"}, "base = 'imx25': must be one of 'ar0132at'"),
    ({"captures": [{}, {"ratio": 16}]}, "captures: figure 'ratio' is unknown"),
    ({"noise_reduction": [{"sigma_dn": 3}]}, "noise_reduction: figure 'sigma_dn' is unknown"),
    (
        {"noise_reduction": [{"luma_sigma_dn": 256}]},
        "noise_reduction: luma_sigma_dn = 256.0: must be finite and >= 0 and",
    ),
    ({"sharpening": {"strength": 1}}, "sharpening = Sharpening("),
    ({"sharpening": [{}, {}]}, "sharpening: gain_db are [0.0, 0.0]; must increase"),
    ({"local_tone": {"tiles": 8}}, "local_tone: missing clip_limit"),
    ({"jpeg_subsampling": "4:1:1"}, "jpeg_subsampling = '4:1:1': must be one of '4:4:4', '4:2:2', '4:2:0'"),
    ({"sources": {"gain": "x"}}, "sources: field 'gain' is unknown"),
    ({"sources": {"f_number": 3}}, "sources.f_number = 3: must be text"),
    ({"quantum_efficiency": 60}, "quantum_efficiency = 60.0: must be finite and >= 0 and <= 1"),
    ({"quantum_efficiency": {"nm": [1]}}, "must be one of column, csv, values, wavelengths_nm"),
    ({"quantum_efficiency": {"csv": ["a"] * 10**4}}, "quantum_efficiency: csv = ['a', 'a'"),
    ({"quantum_efficiency": {"csv": "no.csv"}}, "csv 'no.csv' cannot be read: No such file"),
    ({"quantum_efficiency": {"csv": "bad.csv"}}, "bad.csv, line 2"),
    ({"quantum_efficiency": {"csv": "a.csv", "values": [1]}}, "give either the file or the numbers"),
    ({"quantum_efficiency": {"csv": "qe.csv", "column": 0}}, "column = 0"),
    ({"quantum_efficiency": {"csv": "percent.csv"}}, "quantum_efficiency = 60.0"),
    (
        {"quantum_efficiency": {"wavelengths_nm": [500, 400], "values": [0.1, 0.2]}},
        "quantum_efficiency: wavelengths_nm = (500.0, 400.0): must be >= 0 and increase",
    ),
]


def refusal(path):
    """The message, one line that begins with the file."""
    with pytest.raises((ValueError, TypeError)) as error:
        Camera.load(path)
    message = str(error.value)
    assert str(path) in message
    assert len(message.splitlines()) == 1
    assert len(message) < len(str(path)) + 900
    return message


def test_bad_fields_are_named(tmp_path):
    written(tmp_path / "bad.csv", "nm,qe\n400,high\n")
    written(tmp_path / "percent.csv", "400,60\n700,50\n")
    for change, named in BAD_FIELDS:
        assert named in refusal(written(tmp_path / "own.yaml", OWN | change))


def test_diffraction_is_of_the_wavelength_at_the_f_number():
    """A green f/2.8 on 3.45 um has lambda N = 0.446 px; by default the lens has none."""
    camera = IMX250.with_figures(f_number=2.8, diffraction_wavelength_um=0.55, defocus_radius_px=0.7)
    assert camera.optics.diffraction_lambda_n_px == pytest.approx(0.4464, abs=5e-5)
    assert camera.optics.defocus_radius_px == 0.7
    assert all(each.optics.diffraction_lambda_n_px == 0.0 for each in PRESETS.values())


def test_missing_fields_are_named(tmp_path):
    nameless = {name: value for name, value in OWN.items() if name != "name"}
    assert Camera.load(written(tmp_path / "rig.yaml", nameless)).name == "rig"
    with pytest.raises(ValueError, match="missing name"):
        Camera.from_dict(nameless)
    for left_out in set(OWN) - {"name"}:
        with pytest.raises(ValueError, match=f"missing {left_out}; give them, or a base: one of ar0132at"):
            Camera.from_dict({name: value for name, value in OWN.items() if name != left_out})


BAD_FILES = [
    ("a.json", "{ no json", "is no JSON: Expecting"),
    ("a.json", "[" * 100_000, "is no JSON"),
    ("a.yaml", "a: !!python/object:os.system x", "is no YAML"),
    ("a.yaml", "- 1\n- 2\n", "must map fields to values, got list"),
    ("a.yaml", "", "must map fields to values, got NoneType"),
    ("a.yaml", "name: !!int ''", "is no YAML: "),
    ("a.json", '{"full_well_e": 1' + "0" * 5000 + "}", "is no JSON: Exceeds the limit"),
    ("a.txt", "name: own", "'.txt': must be one of '.json', '.yaml', '.yml'"),
    ("camera", "name: own", "'': must be one of '.json'"),
]


def test_bad_files_are_named(tmp_path):
    for name, text, named in BAD_FILES:
        assert named in refusal(written(tmp_path / name, text))
    (tmp_path / "a.yaml").write_bytes(b"name: \xff\xfe")
    assert "is no YAML" in refusal(tmp_path / "a.yaml")
    with pytest.raises(FileNotFoundError, match="nowhere"):
        Camera.load(tmp_path / "nowhere.yaml")


def test_decibels_of_the_data_sheets():
    """EMVA 1288: the maximum SNR comes back; the dynamic range to the rounding noise, which K adds here."""
    for name, snr_db, range_db in (("imx250", 40.3, 71.2), ("imx249", 45.1, 73.0), ("mt9m034", 37.7, 63.4)):
        camera = PRESETS[name]
        assert camera.sensor.snr_max_db == pytest.approx(snr_db, abs=0.005)
        assert 0.0 < range_db - camera.sensor.dynamic_range_db < 0.6


def test_a_curve_that_begins_at_470_nm_says_so():
    source = IMX250.sources["quantum_efficiency"]
    assert "begins at 470 nm with 83% of its peak" in source
    assert "+19.3% of white if held" in source
    assert electrons_per_lux_s(IMX250) == pytest.approx(6906, abs=1)


@pytest.mark.parametrize(
    ("nm", "values", "marked"),
    [
        ((470, 700), (0.5, 0.3), ["begins at 470 nm with 100%"]),
        ((380, 650), (0.1, 0.4), ["ends at 650 nm with 100%"]),
        ((450, 550, 650), (0.3, 0.6, 0.2), ["begins at 450 nm with 50%", "ends at 650 nm with 33%"]),
        ((450, 550, 650), (0.02, 0.6, 0.02), []),  # over where it ends
        ((300, 1100), (0.2, 0.5), []),
    ],
)
def test_curves_cut_short_within_the_visible_band_are_marked(tmp_path, nm, values, marked):
    stated = {"base": "imx250", "quantum_efficiency": {"wavelengths_nm": list(nm), "values": list(values)}}
    camera = Camera.load(written(tmp_path / "mine.yaml", stated))
    source = camera.sources["quantum_efficiency"]
    assert source.startswith("from mine.yaml")
    assert ("marked" in source) == bool(marked)
    assert all(mark in source for mark in marked)
    camera.save(tmp_path / "again.yaml")
    assert Camera.load(tmp_path / "again.yaml").sources["quantum_efficiency"] == source
