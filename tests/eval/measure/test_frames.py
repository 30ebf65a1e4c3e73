"""Simulated frames against frames that NumPy made by the same law, or by one that the simulator or camera lacks."""

import csv
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy_cmos
import pytest
from blurnoise_eval.calibration import fit, to_camera
from blurnoise_eval.cli import main
from blurnoise_eval.measure import classifier, frames
from blurnoise_eval.measure.comparison import AGREES, DIFFERS, SMALL, MeasureComparison, compared, summary
from blurnoise_eval.measure.frames import LevelPair, Validation
from blurnoise_eval.measure.statistics import MEAN, STATISTICS, VARIANCE, FrameStack, compare_levels
from numpy_cmos import Cmos

from blurnoise import Camera
from blurnoise.metrics.values import Estimate

REAL = Path(__file__).resolve().parents[4] / "shared" / "real" / "emva_ccd"
CAMERA = Camera.preset("imx250m").with_figures(
    cfa="none", system_gain_dn_per_e=0.5, read_noise_e=5.0, row_noise_e=0.0,
    column_noise_e=0.0, prnu=0.006, prnu_row=0.0, prnu_column=0.0, dsnu_e=3.0, dsnu_row_e=0.0, dsnu_column_e=0.0,
    dark_current_e_s=0.0, black_level_dn=40.0, full_well_e=8000.0, black_level_drift_dn=0.0, quantum_efficiency=0.5,
)  # fmt: skip
SHARES = np.linspace(0.05, 0.7, 6)  # of the full well, of the flat levels


def folder(
    path, camera=CAMERA, *, seed=0, size=(64, 96), levels=6, gain_db=0.0, kind="npy", site=(1.0,) * 4, photons=False
):  # fmt: skip
    """Two dark levels and flat ones, two frames each, by NumPy alone. site: light of the four sites of a mosaic."""
    random = np.random.default_rng(seed)

    def normal(pixel, row, column):
        height, width = size
        parts = (pixel, (height, width)), (row, (height, 1)), (column, (1, width))
        return sum((sigma * random.standard_normal(shape) for sigma, shape in parts), np.zeros(size))

    response = 1 + normal(camera.sensor.prnu, camera.sensor.prnu_row, camera.sensor.prnu_column)
    response *= np.tile(np.reshape(site, (2, 2)), (size[0] // 2, size[1] // 2))
    offset = normal(camera.sensor.dsnu_e, camera.sensor.dsnu_row_e, camera.sensor.dsnu_column_e)
    path.mkdir()
    lines = ["file,kind,exposure_s,gain_db" + ",photons_per_px" * photons]
    for number, share in enumerate((0.0, 0.0, *SHARES[:levels])):
        exposure_s = 0.02 * share if share else 0.001 * (1 + number)
        for frame in range(2):
            charge = random.poisson(share * camera.sensor.full_well_e * np.maximum(response, 0.0))
            noise = normal(
                camera.sensor.read_noise_e, camera.sensor.row_noise_e, camera.sensor.column_noise_e
            )
            dn = camera.sensor.system_gain_dn_per_e * (charge + offset + noise) + camera.sensor.black_level_dn
            plane = np.clip(np.round(dn), 0, 4095).astype("<u2")
            name = f"{number}_{frame}.{kind}"
            np.save(path / name, plane) if kind == "npy" else plane.tofile(path / name)
            light = f",{2 * share * camera.sensor.full_well_e if share else ''}" * photons
            lines.append(f"{name},{'flat' if share else 'dark'},{exposure_s:.6f},{gain_db}{light}")
    (path / "frames.csv").write_text("\n".join(lines))
    return path


def differing(validation):
    return [each for each in validation.comparisons if each.verdict == DIFFERS]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("whole", "size", "count"),
    [
        ({}, (96, 128), 30),
        ({"prnu_column": 0.012}, (192, 256), 16),
        ({"prnu_column": 0.004, "dsnu_column_e": 1.5}, (192, 256), 16),
        ({"prnu_row": 0.003, "dsnu_row_e": 1.0, "row_noise_e": 1.0, "column_noise_e": 0.5}, (192, 256), 16),
    ],
)
def test_frames_of_the_same_law_agree_but_for_chance(tmp_path, whole, size, count):
    """At most one validation of 20 is to find a difference: of 16, 4 or more once in 140, of 30, 6 or more once in
    300. Each has over a hundred comparisons."""
    camera, wrong = CAMERA.with_figures(**whole), 0
    for seed in range(count):
        made = folder(tmp_path / f"{seed}", camera, seed=seed, size=size, photons=not whole)
        validation = frames.validate(made, camera, seed=1000 + seed)
        assert len(validation.comparisons) > 100
        wrong += bool(differing(validation))
    assert wrong <= (3 if count == 16 else 5)


def test_rows_that_the_simulator_lacks_differ(tmp_path):
    """Of 16 % of the read noise: row means of 256 px in the dark vary by 1 + 256 .16^2 = 7.6 of white noise."""
    row_noise_e = 0.16 * CAMERA.sensor.read_noise_e
    made = folder(tmp_path / "frames", CAMERA.with_figures(row_noise_e=row_noise_e), seed=1, size=(256, 256))
    validation = frames.validate(made, CAMERA)
    rows = validation.of("dark", "rows")
    assert all(each.verdict == DIFFERS for each in rows)
    assert rows[0].real == pytest.approx(1 + 256 * 0.16**2, rel=0.3)
    assert rows[0].simulated == pytest.approx(1.0, abs=0.3)
    for name in ("kurtosis", "columns", "noise_0.25", "correlation_y"):
        assert all(each.verdict != DIFFERS for each in validation.of("dark", name)), name
    assert "on dark frames" in validation.answer
    assert "rows in time (2 of 2)" in validation.answer
    simulated = frames.validate(made, CAMERA.with_figures(row_noise_e=row_noise_e))
    assert all(each.verdict != DIFFERS for each in simulated.of("dark", "rows"))


def test_wrong_figures_differ(tmp_path):
    wrong = CAMERA.with_figures(read_noise_e=6.0, system_gain_dn_per_e=0.55)
    validation = frames.validate(folder(tmp_path / "frames", seed=2, size=(256, 256)), wrong)
    dark, flat = (validation.of(kind, "variance") for kind in ("dark", "flat"))
    of_dark = ((5 * 0.5) ** 2 + 1 / 12) / ((6 * 0.55) ** 2 + 1 / 12) - 1
    assert dark[0].difference.value == pytest.approx(of_dark, abs=0.02)
    assert flat[-1].difference.value == pytest.approx(0.5 / 0.55 - 1, abs=0.02)
    assert {each.verdict for each in (*dark, *flat)} == {DIFFERS}
    assert validation.answer.startswith("Simulated frames differ from the real frames")


@pytest.mark.slow
def test_intervals_contain_the_truth():
    """Of the variance's ratio, of normal noise of ratio 1.1, in 95 % of 200 (90 to 99 %)."""
    random, inside = np.random.default_rng(3), 0
    for _ in range(200):
        one, other = (FrameStack(d * random.standard_normal((2, 128, 128))) for d in (1.1**0.5, 1.0))
        variance = next(each for each in compare_levels(one, other) if each.measure == VARIANCE)
        inside += variance.difference.low <= 0.1 <= variance.difference.high
    assert 0.9 <= inside / 200 <= 0.99


@pytest.mark.parametrize("name", ["noise", "pattern"])
def test_octaves_leave_whole_rows_and_columns_out(name):
    """Their power is that of the pixels, block by block, whatever whole rows and columns have."""
    random = np.random.default_rng(0)
    pixels = random.standard_normal((2, 128, 128))
    whole = 3 * random.standard_normal((2, 1, 128)) + 2 * random.standard_normal((2, 128, 1))
    for measure in (each for each in STATISTICS if each.octave and each.name.startswith(name)):
        alone, both = (measure.sums(FrameStack(stack)) for stack in (pixels, pixels + whole))
        np.testing.assert_allclose(both, alone, rtol=1e-9)


def test_mean_is_as_uncertain_as_few_rows_and_columns(tmp_path):
    """Of 96 columns of 6 e- the mean varies by 6 / sqrt 96, of 64 rows of 4 e- by 4 / 8; in both, by sqrt 2 more."""
    camera = CAMERA.with_figures(dsnu_row_e=4.0, dsnu_column_e=6.0)
    validation = frames.validate(folder(tmp_path / "frames", camera), camera)
    half = 1.96 * 0.5 * math.sqrt(2 * (6**2 / 96 + 4**2 / 64)) / 40
    for each in validation.of("dark", "mean"):
        assert (each.difference.high - each.difference.low) / 2 > half
        assert each.verdict != DIFFERS


def test_camera_counts_gains_as_its_fit_did(tmp_path):
    """From the lowest of its folder, 6 dB: with frames of 6 dB it is as it was fitted, with those of 0 dB refused."""
    made = folder(tmp_path / "frames", gain_db=6.0)
    fitted = to_camera.camera_of(fit.measure(made), "mine", base="imx250m")
    fitted.save(tmp_path / "mine.yaml")
    camera = Camera.load(tmp_path / "mine.yaml")
    assert to_camera.lowest_gain_db(camera) == 6.0
    used = frames.validate(made, camera).camera
    assert used.sensor.system_gain_dn_per_e == pytest.approx(fitted.sensor.system_gain_dn_per_e)
    assert frames._at_gain(camera, 12.0) == camera.at_gain(6.0).camera
    # 0 dB of a preset is that of the frames
    assert frames._at_gain(CAMERA, 6.0) == CAMERA.at_gain(6.0).camera
    with pytest.raises(ValueError, match="gain_db = 0; must be 6 to"):
        frames._at_gain(camera, 0.0)


@pytest.mark.parametrize(
    ("made", "options", "message"),
    [
        ({"levels": 4}, [], "4 flat levels; must be 5 or more without --camera"),
        ({}, ["--seed", "-1"], "--seed = -1: must be >= 0"),
        ({}, ["--camera", "imx250c"], "imx250c: has the colour filters RGGB"),
        ({}, ["--cfa", "XYZ"], "--cfa = 'XYZ': must be one of"),
        ({}, ["--black-level", "40"], "--black-level: needs two pictures"),
        ({"kind": "raw"}, ["--raw-layout", "u16,96x65"], "12288 bytes"),
    ],
)
def test_what_cannot_be_compared_says_why(tmp_path, capsys, made, options, message):
    made = folder(tmp_path / "frames", **made)
    assert main(["validate", str(made), "-o", str(tmp_path / "out"), *options]) == 2
    assert message in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "out").exists()


def test_green_pixels_of_a_mosaic_are_compared(tmp_path):
    """With those of a camera whose mosaic the frames have, too: of 32 x 48 px, 16 x 24."""
    made = folder(tmp_path / "frames", size=(32, 48), site=(0.6, 1.0, 1.0, 0.5))
    colour = Camera.preset("imx250c")
    camera = CAMERA.with_figures(cfa=colour.sensor.cfa, quantum_efficiency=colour.sensor.quantum_efficiency)
    validation = frames.validate(made, camera, cfa="RGGB")
    assert validation.pairs[0].real.frames.shape == (2, 16, 24)
    assert not differing(validation)


def test_the_answer_follows_the_verdicts():
    """Relative differences of dim levels do not count; what differs is named, also in the dark."""

    def level(name, kind, measure, apart, p_value=1.0):
        difference = Estimate(apart, apart - 0.01, apart + 0.01)
        return MeasureComparison(measure, 1.0, 1.0, difference, p_value, kind, name)

    stacks = {name: FrameStack(np.full((2, 4, 4), dn)) for name, dn in (("dim", 50.0), ("bright", 2000.0))}
    pairs = [LevelPair(name, "flat", stack, stack) for name, stack in stacks.items()]
    rows = [
        level("dim", "flat", MEAN, 0.055), level("bright", "flat", MEAN, 0.004),
        level("dim", "flat", VARIANCE, 0.03), level("bright", "flat", VARIANCE, -0.01),
    ]  # fmt: skip
    alike = Validation(CAMERA, None, [], rows, {}, pairs, [])
    assert {each.verdict for each in rows} == {AGREES}
    near = "mean within 0.4 %, variance within 1 % at 1 levels (and 1 dim ones)"
    expected = f"Simulated frames behave like the real frames: {near}. There are no significant differences."
    assert alike.answer == expected
    apart = replace(alike, comparisons=[*rows, level("d", "dark", VARIANCE, 0.3, 0.01)]).answer
    assert apart.startswith("Simulated frames differ from the real frames: mean within 0.4 %")
    assert apart.endswith("Significant differences: on dark frames variance (1 of 1).")


def test_a_variance_that_differs_surely_by_less_than_8_percent_is_small():
    """The interval decides: of 5 +- 2 % all is below 8 %, of 7 +- 2 % it is not; means have no tolerance."""
    rows = [
        compared(VARIANCE, 1.0 + off, 1.0, 0.01, kind="flat", level=f"{off}") for off in (0.05, 0.07, -0.05)
    ]
    rows.append(compared(MEAN, 1.05, 1.0, 0.01, kind="flat", level="0.05"))
    assert [each.verdict for each in rows] == [SMALL, DIFFERS, SMALL, DIFFERS]
    alike = Validation(CAMERA, None, [], rows[::2], {}, [], [])
    assert alike.answer.startswith("Simulated frames behave like the real frames")
    assert alike.answer.endswith("Differences of the variance are below 8 % (2 levels).")
    assert [row[:2] for row, _ in summary(rows[::2])] == [("variance, DN²", "agrees within 8 %")]


def test_dim_light_has_the_black_level_of_its_frames_where_rounding_is_coarse(tmp_path):
    """Noise of 0.25 DN; the black level wanders by 0.15 DN, which moves the variance after rounding by a tenth."""
    cmos = Cmos(bits=8, gain=0.02, read=12.0, black_dn=3.25, wander_dn=0.15)
    made = numpy_cmos.save(tmp_path / "frames", cmos, [0.004, 0.008, 0.012, *SHARES], seed=2)
    fitted = to_camera.camera_of(fit.measure(made), "mine", base="imx250m")
    dim = frames.validate(made, fitted).of("flat", "variance")[:3]
    assert [each.verdict for each in dim] == [AGREES] * 3


def test_patterns_of_the_standard_are_not_those_of_full_wells(tmp_path):
    """Signals that bend from 70 % of the range on lose their PRNU."""
    made = numpy_cmos.save(tmp_path / "frames", Cmos(sag=0.7), np.linspace(0.1, 1.0, 9))
    prnu = next(row for row in frames.validate(made).standard if row.name == "PRNU_pixel")
    assert prnu.standard.value == pytest.approx(0.7, rel=0.03)


def test_the_classifier_separates_what_can_be_separated():
    """Alike: about 0.5, within its interval. Noise of 10 % more variance, whose logarithm is known to .022 by 4096
    pixels: 0.1 over .031 is a d' of 3, an AUC of .98 (by the normal law, Phi(d' / sqrt 2))."""
    random = np.random.default_rng(5)
    draws = [100 + random.standard_normal((4, 256, 512)) for _ in range(3)]
    alike = classifier.separation([draws[0]], [draws[1]])
    assert alike.low <= 0.5 <= alike.high
    assert classifier.separation_of_halves([draws[0]]).value == pytest.approx(0.5, abs=0.2)
    louder = classifier.separation([draws[0]], [100 + 1.1**0.5 * (draws[2] - 100)])
    assert louder.value == pytest.approx(0.98, abs=0.025)
    assert np.isnan(classifier.separation([draws[0][:, :128, :128]], [draws[1][:, :128, :128]]).value)


@pytest.mark.slow
def test_the_command_writes_page_tables_and_camera(tmp_path, capsys):
    out = tmp_path / "out"
    CAMERA.save(tmp_path / "mine.yaml")
    words = ["validate", str(folder(tmp_path / "frames", seed=6, levels=5))]
    assert main([*words, "-o", str(out), "--camera", str(tmp_path / "mine.yaml")]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith("Of the figures of EMVA 1288")
    assert max(map(len, shown.replace(str(out), "").splitlines())) <= 80
    rows = list(csv.DictReader((out / "validation.csv").open()))
    document = json.loads((out / "validation.json").read_text())
    assert [row["measure"] for row in rows] == [row["measure"] for row in document["rows"]]
    page = (out / "validation.html").read_text()
    assert document["answer"].partition(":")[0] in page
    # the camera of the frames passes; without photons there is no quantum efficiency
    verdicts = {row["figure"]: row["verdict"] for row in document["standard"]}
    assert (verdicts["K"], verdicts["QE"]) == ("pass", "cannot tell")
    assert (
        page.index("Of the figures of EMVA 1288")
        < page.index("system gain K")
        < page.index("Simulated frames")
    )
    assert (
        shown.index("Of the figures of EMVA 1288")
        < shown.index("system gain K")
        < shown.index("Simulated frames")
    )
    assert page.count("data:image/png") == 2
    assert "://" not in page
    assert not (out / "camera.yaml").exists()
    assert main([*words, "-o", str(out), "--json"]) == 0  # fitted on every other level: three of five
    assert (out / "camera.yaml").is_file()
    assert "held-out levels" in json.loads(capsys.readouterr().out)["answer"]


@pytest.mark.slow
@pytest.mark.skipif(not REAL.is_dir(), reason="the shared frames are absent")
def test_real_camera_behaves_as_simulated():
    validation = frames.validate(REAL)
    assert abs(validation.largest("mean")) < 0.01
    assert abs(validation.largest("variance")) < 0.04
    assert validation.auc["flat"][0].value < 0.65
