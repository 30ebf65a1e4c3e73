"""Simulated frames beside real ones that NumPy made by the same law, or by one with rows that the simulator lacks."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from blurnoise_eval.cli import main
from blurnoise_eval.measure import classifier
from blurnoise_eval.measure import frames as held_out
from blurnoise_eval.measure.comparison import DIFFERS, Stack, compare

from blurnoise import Camera

REAL = Path(__file__).resolve().parents[4] / "shared" / "real" / "emva_ccd"
CAMERA = Camera.preset("imx250m").with_figures(
    cfa="none", system_gain_dn_per_e=0.4, read_noise_e=8.0, prnu=0.005, dsnu_e=1.0,
    dark_current_e_s=0.0, black_level_dn=40.0, full_well_e=9000.0, quantum_efficiency=0.5, prnu_row=0.0,
    prnu_column=0.0,
)  # fmt: skip
PHOTONS = np.array([400.0, 1600.0, 3600.0, 6400.0, 10000.0])


def frames(electrons, random, size=(96, 128), count=2, rows=0.0):
    """Frames (count, H, W) of CAMERA by NumPy alone; rows: of the read noise, that whole rows have beside it."""
    pattern = (
        1 + CAMERA.sensor.prnu * random.standard_normal(size),
        CAMERA.sensor.dsnu_e * random.standard_normal(size),
    )
    charge = random.poisson(electrons * pattern[0], (count, *size))
    noise = CAMERA.sensor.read_noise_e * random.standard_normal((count, *size))
    noise += rows * CAMERA.sensor.read_noise_e * random.standard_normal((count, size[0], 1))
    dn = CAMERA.sensor.system_gain_dn_per_e * (charge + noise + pattern[1]) + CAMERA.sensor.black_level_dn
    return np.clip(np.round(dn), 0, 4095).astype(np.uint16)


def folder(path, seed, rows=0.0, size=(96, 128)):
    """Two dark levels, and flat ones of PHOTONS, two frames each, with their list."""
    random = np.random.default_rng(seed)
    path.mkdir()
    lines = ["file,kind,exposure_s,photons_per_px"]
    levels = [("dark", 1.0, ""), ("dark", 2.0, ""), *(("flat", each / 1e6, each) for each in PHOTONS)]
    for number, (kind, exposure_s, photons) in enumerate(levels):
        electrons = CAMERA.sensor.quantum_efficiency * photons if photons else 0.0
        for place, frame in enumerate(frames(electrons, random, size, rows=rows)):
            name = f"{number}_{place}.npy"
            np.save(path / name, frame)
            lines.append(f"{name},{kind},{exposure_s},{photons}")
    (path / "frames.csv").write_text("\n".join(lines))
    return path


@pytest.mark.slow
def test_same_law_agrees_but_for_chance(tmp_path):
    """At most one validation of 20 finds a difference where there is none; in 40, at most 6 (5 times in 100: 2, and
    7 or more once in 300). Each has over a hundred comparisons."""
    wrong = 0
    for seed in range(40):
        found = held_out.validate(folder(tmp_path / f"{seed}", seed), CAMERA, seed=seed)
        assert len(found.comparisons) > 100
        wrong += any(each.verdict == DIFFERS for each in found.comparisons)
    assert wrong <= 6


def test_rows_that_the_simulator_lacks_differ(tmp_path):
    """Of 16 % of the read noise: row means of 128 px in the dark vary by 1 + 128 .16^2 = 4.3 of white noise."""
    found = held_out.validate(folder(tmp_path / "frames", 1, rows=0.16, size=(256, 256)), CAMERA)
    rows = found.of("rows", "dark")
    assert all(each.verdict == DIFFERS for each in rows)
    assert rows[0].real == pytest.approx(1 + 256 * 0.16**2, rel=0.3)
    assert rows[0].simulated == pytest.approx(1.0, abs=0.3)
    for name in ("kurtosis", "columns", "noise_0.25", "correlation_y"):
        assert all(each.verdict != DIFFERS for each in found.of(name, "dark")), name
    assert "on dark frames" in found.answer
    assert "rows in time (2 of 2)" in found.answer
    simulated = held_out.validate(
        tmp_path / "frames", CAMERA.with_figures(row_noise_e=0.16 * CAMERA.sensor.read_noise_e)
    )
    assert all(each.verdict != DIFFERS for each in simulated.of("rows", "dark"))


def test_wrong_figures_differ(tmp_path):
    wrong = CAMERA.with_figures(read_noise_e=9.0, system_gain_dn_per_e=0.42)
    found = held_out.validate(folder(tmp_path / "frames", 2, size=(256, 256)), wrong)
    assert found.of("variance", "dark")[0].difference == pytest.approx(
        (8 * 0.4) ** 2 / (9 * 0.42) ** 2 - 1, abs=0.02
    )
    assert found.of("variance", "flat")[-1].difference == pytest.approx(0.4 / 0.42 - 1, abs=0.02)
    assert {each.verdict for kind in ("dark", "flat") for each in found.of("variance", kind)} == {DIFFERS}
    assert found.answer.startswith("Simulated frames differ from the real frames")


@pytest.mark.slow
def test_intervals_hold_the_truth():
    """Of the variance's ratio, of normal noise of ratio 1.1, in 95 % of 200 (90 to 99 %)."""
    random, held = np.random.default_rng(3), 0
    for _ in range(200):
        one, other = (Stack(d * random.standard_normal((2, 128, 128))) for d in (1.1**0.5, 1.0))
        variance = next(each for each in compare("", "dark", one, other) if each.measure.name == "variance")
        held += variance.low <= 0.1 <= variance.high
    assert 0.9 <= held / 200 <= 0.99


def test_classifier_tells_what_there_is():
    """Alike: about 0.5, within its interval. Noise of 10 % more variance, whose logarithm is known to .022 by 4096
    pixels: 0.1 over .031 is a d' of 3, an AUC of .98 (by the normal law, Phi(d' / sqrt 2))."""
    random = np.random.default_rng(5)
    draw = [100 + random.standard_normal((4, 256, 512)) for _ in range(3)]
    alike = classifier.told_apart([draw[0]], [draw[1]])
    assert alike.low <= 0.5 <= alike.high
    assert classifier.real_apart([draw[0]]).value == pytest.approx(0.5, abs=0.2)
    louder = classifier.told_apart([draw[0]], [100 + 1.1**0.5 * (draw[2] - 100)])
    assert louder.value == pytest.approx(0.98, abs=0.025)
    assert np.isnan(classifier.told_apart([draw[0][:, :128, :128]], [draw[1][:, :128, :128]]).value)


@pytest.mark.slow
def test_command_writes_what_it_found(tmp_path, capsys):
    out = tmp_path / "out"
    CAMERA.save(tmp_path / "mine.yaml")
    words = ["validate", str(folder(tmp_path / "frames", 6)), "-o", str(out)]
    assert main([*words, "--camera", str(tmp_path / "mine.yaml")]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith("Simulated frames")
    assert max(map(len, shown.replace(str(out), "").splitlines())) <= 80
    rows = list(csv.DictReader((out / "validation.csv").open()))
    document = json.loads((out / "validation.json").read_text())
    assert [row["measure"] for row in rows] == [row["measure"] for row in document["rows"]]
    page = (out / "validation.html").read_text()
    assert document["answer"].partition(":")[0] in page
    assert page.count("data:image/png") == 2
    assert "://" not in page
    assert not (out / "camera.yaml").exists()
    assert main([*words, "--json"]) == 0  # fitted on every other level: three of five
    assert (out / "camera.yaml").is_file()
    assert "held-out levels" in json.loads(capsys.readouterr().out)["answer"]


@pytest.mark.slow
@pytest.mark.skipif(not REAL.is_dir(), reason="the shared frames are absent")
def test_real_camera_behaves_as_simulated():
    found = held_out.validate(REAL)
    assert abs(found.largest("mean")) < 0.01
    assert abs(found.largest("variance")) < 0.04
    assert found.apart["flat"][0].value < 0.65
