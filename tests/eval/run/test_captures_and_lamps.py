"""Cameras of several captures and pulsed lamps in sweeps: pictures as ``simulate`` takes them, and a run's tables."""

import csv
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from blurnoise_eval import SweepPlan, evaluate
from blurnoise_eval.datasets import decode, rendered_signs, target_mask, write_picture
from blurnoise_eval.plan.conditions import Cell, Conditions
from blurnoise_eval.plan.files import PlanFile
from blurnoise_eval.plan.lamps import Lamps
from blurnoise_eval.plan.typed import AUTOMATIC
from blurnoise_eval.run.exposing import PictureScene, check_plan, frames, snr_db
from blurnoise_eval.run.run import Run
from commands import main
from signs_in_memory import BOX, CAMERA, matched_detector, noise, picture, picture_set, sign

from blurnoise import AutoExposure, Exposure, photoelectrons
from blurnoise.camera.captures import Capture, longest_first_s, staggered, windows
from blurnoise.light.lamp import Pwm

HDR = CAMERA.with_figures(captures=staggered(16))
ROLLING = CAMERA.with_figures(row_time_s=2e-5, shutter="rolling")
TARGETS = Lamps(pwm="90,0.1", pwm_mask="targets")
LIT = {"illuminance_lux": 300.0}


def exposed(image, shown=None, **settings):
    """The scene of a picture under a plan with these settings."""
    return PictureScene(image, replace(SweepPlan.of({"lux": 300}), **settings), shown)


def framed(scene, at, camera, seed=3, repeat=0):
    (frame,) = frames(scene, [Cell("p", repeat, Conditions(**at), seed)], camera)
    return frame


def simulated(folder, words, scene=None):
    """The picture of ``blurnoise simulate`` with these words and settings of a scene file, and its figures."""
    (folder / "scene.yaml").write_text(json.dumps(scene or {"lux": 300}))
    write_picture(folder / "p.png", sign())
    words = ["simulate", str(folder / "p.png"), "-o", str(folder / "seen.png"), "--seed", "3", *words.split()]
    words += ["--picture-tone", "srgb"]
    assert main([*words, "--scene", str(folder / "scene.yaml")]) == 0
    return decode(folder / "seen.png")


def mask_file(folder):
    mask = target_mask(picture("p"), sign().shape[:2])
    write_picture(folder / "mask.png", np.round(255 * mask).astype(np.uint8))
    return str(folder / "mask.png")


@pytest.mark.parametrize("gain", ["0", "9", "auto"])
@pytest.mark.parametrize("captures", ["[{}, {exposure_ratio: 16}]", "[{gain_db: 12}, {start_s: 0}]"])
def test_a_sweep_takes_the_picture_that_simulate_takes(tmp_path, gain, captures, capsys):
    (tmp_path / "c.yaml").write_text(f"base: imx250\ncaptures: {captures}\n")
    words = f"--camera {tmp_path / 'c.yaml'} --exposure-ms 2 --lux 3000 --dx 500 --gain {gain}"
    expected = simulated(tmp_path, words, {"hdr_white": 4})
    camera = CAMERA.with_figures(
        captures=staggered(16) if "ratio" in captures else (Capture(gain_db=12.0), Capture(start_s=0.0)),
    )
    at = {"exposure_s": 0.002, "illuminance_lux": 3000.0, "velocity_x_px_s": 500.0}
    at["gain_db"] = AUTOMATIC if gain == "auto" else float(gain)
    frame = framed(exposed(sign(), hdr_white=4.0), at, camera)
    np.testing.assert_array_equal(frame.image, expected)


def test_it_sees_lamps_as_simulate_does(tmp_path, capsys):
    """Targets are emitters and pulsed; a rolling shutter, two captures, the phase of the seed."""
    (tmp_path / "c.yaml").write_text(
        "base: imx250\nrow_time_s: 2.0e-5\nshutter: rolling\ncaptures: [{}, {exposure_ratio: 4}]\n"
    )
    camera, mask = ROLLING.with_figures(captures=staggered(4)), mask_file(tmp_path)
    given = {"emitters": f"{mask}:9", "pwm": "90,0.1", "pwm_mask": mask}
    lamps = replace(TARGETS, emitters="targets:9")
    at = {"exposure_s": 0.009, "illuminance_lux": 30.0, "velocity_x_px_s": 100.0}
    words = f"--camera {tmp_path / 'c.yaml'} --exposure-ms 9 --lux 30 --dx 100"
    frame = framed(exposed(sign(), picture("p"), lamps=lamps), at, camera)
    assert frame.exposure.lamp == Pwm(90.0, 0.1).with_phase_of(3)
    # the mask's file has 8 bits, and so the light of its edge is another by up to 0.2 %
    seen = simulated(tmp_path, words, given).astype(int)
    assert np.abs(seen - frame.image).max() <= 2
    dark = framed(PictureScene(sign(), picture=picture("p")), at, camera)
    assert np.abs(seen - dark.image).mean() > 2


def test_saturation_of_a_merged_picture():
    """White takes 6906 e- per lux s; two captures reach 16 times 10 715 e-, which is 24.8 lux s."""
    image = np.zeros((40, 52, 3), np.uint8)
    image[:10], image[10:30] = 255, 118  # sRGB of 0.18
    for lux_s, white, share in ((20.0, 2.0, 0.0), (30.0, 2.0, 0.25), (200.0, 2.0, 0.75), (20.0, 0.5, 0.25)):
        at = {"exposure_s": 0.01, "illuminance_lux": lux_s / 0.01}
        frame = framed(exposed(image, hdr_white=white), at, HDR)
        assert frame.saturated == pytest.approx(share, abs=0.01)


def test_signal_to_noise_is_that_of_the_merged_pixel():
    """White of 2 lux s is beyond the first capture: the second's electrons, 16 times each, with its own noise."""
    camera = HDR.with_figures(read_noise_e=10.0, prnu=0.0, dsnu_e=0.0)
    white_e = photoelectrons(camera, 200.0, 0.01)
    noise_e = 16 * math.sqrt(white_e / 16 + 10.0**2 + 1 / 12 / camera.sensor.system_gain_dn_per_e**2)
    found = snr_db(Exposure(camera, exposure_s=0.01, illuminance_lux=200.0), 1.0)
    assert found == pytest.approx(20 * math.log10(white_e / noise_e), abs=0.05)
    assert snr_db(Exposure(camera, exposure_s=0.01, illuminance_lux=200.0), 0.0) is None


def test_captures_end_within_the_frame():
    assert longest_first_s(staggered(4, 16), 0.021) == pytest.approx(0.016)
    later = (Capture(), Capture(exposure_ratio=4, start_s=0.02))
    assert longest_first_s(later, 0.021) == pytest.approx(0.004)
    assert longest_first_s((), 0.02) == 0.02
    camera = CAMERA.with_figures(captures=staggered(4, 16))
    found = AutoExposure(frame_rate_hz=50.0).setting(camera, mean_light=0.2, illuminance_lux=0.01)
    assert sum(windows(camera.sensor.captures, found.exposure_s)[-1]) == pytest.approx(0.02)
    plan = SweepPlan({"exposure_s": (0.001, 0.03), "illuminance_lux": (50.0,)})
    with pytest.raises(ValueError, match="captures: number 2, 20 to"):
        check_plan(plan, CAMERA.with_figures(captures=later), picture_set(picture("p")))


@pytest.mark.parametrize(("camera", "rows"), [(CAMERA, 1), (ROLLING, 24)])
@pytest.mark.parametrize("exposure_s", [0.0003, 0.004, 0.0105])
def test_share_of_missed_pulses_is_the_closed_form(camera, rows, exposure_s):
    """1 - f T - D of an exposure T; of a lamp of n rows T is from the first row's start to the last row's end.

    1000 equidistant phases: the share is right to 1/1000 at either end.
    """
    phases = tuple((np.arange(1000) / 1000).tolist())
    scene = exposed(sign(), picture("p"), repeats=1000, lamps=replace(TARGETS, pwm_phase=phases))
    taken = framed(scene, {"exposure_s": exposure_s, **LIT}, camera).exposure
    lamps = scene.plan.lamps
    missed = [scene.missed_pulse(replace(taken, lamp=lamps.pulses(repeat, 3))) for repeat in range(1000)]
    first, last = np.flatnonzero(scene.lamp_mask.numpy().any(1))[[0, -1]]
    assert rows == 1 or abs(last - first + 1 - rows) <= 1
    lasting = exposure_s + (last - first) * camera.sensor.row_time_s / camera.field.per_sensor_px(
        sign().shape[:2]
    )
    assert np.mean(missed) == pytest.approx(Pwm(90.0, 0.1).dark_probability(lasting), abs=0.002)


def test_a_missed_pulse_leaves_the_lamp_dark_and_nothing_else():
    left, top, right, bottom = (round(edge) for edge in BOX)
    scene = exposed(sign(), picture("p"), repeats=2, lamps=replace(TARGETS, pwm_phase=(0.5, 0.0)))
    at = {"exposure_s": 0.001, **LIT}
    dark, bright = (framed(scene, at, CAMERA, repeat=repeat) for repeat in (0, 1))
    assert (dark.missed_pulse, bright.missed_pulse) == (True, False)
    middle = slice(top + 8, bottom - 8), slice(left + 8, right - 8)
    assert dark.image[middle].max() < 25 < bright.image[middle].mean()
    np.testing.assert_array_equal(dark.image[:, : left - 2], bright.image[:, : left - 2])
    everywhere = exposed(sign(), lamps=Lamps(pwm="90,0.1,0.5"))
    assert framed(everywhere, at, CAMERA).image.mean() < 10
    empty = replace(picture("p"), targets=())
    assert framed(exposed(sign(), empty, lamps=TARGETS), at, CAMERA).missed_pulse is None


def test_lamps_move_with_their_targets():
    """Rendered signs before the camera at rest: those that are missed are black wherever they are."""
    (one,) = rendered_signs([60], count=1)
    at = {"exposure_s": 0.004, **LIT, "velocity_x_px_s": 4000.0, "moves": 1.0}
    lit = framed(exposed(one.load(), one, lamps=Lamps(pwm="90,0.1,0.0", pwm_mask="targets")), at, CAMERA)
    dark = framed(exposed(one.load(), one, lamps=Lamps(pwm="90,0.1,0.2", pwm_mask="targets")), at, CAMERA)
    x0, y0, x1, y1 = (round(edge) for edge in one.targets[0].box_xyxy)
    middle = slice((y0 + y1) // 2 - 5, (y0 + y1) // 2 + 5), slice((x0 + x1) // 2 - 5, (x0 + x1) // 2 + 5)
    assert dark.image[middle].max() < 40 < lit.image[middle].mean()
    brighter = exposed(one.load(), one, lamps=Lamps(emitters="targets:3"))
    seen = framed(brighter, {**at, "illuminance_lux": 30.0, "moves": 0.0}, CAMERA)
    moved = framed(brighter, {**at, "illuminance_lux": 30.0}, CAMERA)
    assert moved.image[middle].mean() == pytest.approx(seen.image[middle].mean(), rel=0.05)


def test_targets_cover_their_outlines_or_boxes():
    (one,) = rendered_signs([60], count=1)
    mask = target_mask(one, one.load().shape[:2])
    x0, _, x1, _ = one.targets[0].box_xyxy
    area = 2 * (math.sqrt(2) - 1) * (x1 - x0) ** 2  # an octagon, by its distance across flats
    assert mask.sum() == pytest.approx(area, rel=0.02)
    x0, y0, x1, y1 = BOX
    assert target_mask(picture("p"), sign().shape[:2]).sum() == pytest.approx((x1 - x0) * (y1 - y0))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("pwm_phase: 0.5", "pwm_phase: needs pwm"),
        ("pwm: 90,0.1\npwm_phase: 1.5", "pwm_phase = 1.5: must be"),
        ("pwm: 90,0.1\npwm_phase: sometimes", "pwm_phase = 'sometimes': must be numbers"),
        ("pwm: 90,0.1\npwm_phase: [random, 0.5]", "'random', 0.5.: must be numbers"),
        ("pwm: 90,0.1,0.5\npwm_phase: 0.5", "has a phase; must not be combined with pwm_phase"),
        ("pwm: 90,0.1\npwm_mask: lamps.png", "pwm_mask = 'lamps.png': must be targets"),
        ("emitters: lamps.png:4", "emitters = 'lamps.png:4': must be targets:FACTOR"),
        ("hdr_white: 0", "hdr_white = 0"),
    ],
)
def test_settings_that_are_refused(tmp_path, text, message):
    (tmp_path / "plan.yaml").write_text(text)
    with pytest.raises(ValueError, match=message.replace("(", r"\(")):
        PlanFile.read(tmp_path / "plan.yaml")


def test_phases_of_a_plan_file(tmp_path):
    (tmp_path / "plan.yaml").write_text("pwm: 90,0.1\npwm_phase: 0:0.75:0.25\nrepeats: 2\n")
    plan = PlanFile.read(tmp_path / "plan.yaml").plan
    assert (plan.repeats, plan.lamps.phases) == (8, (0.0, 0.25, 0.5, 0.75))
    assert [plan.lamps.pulses(repeat, 3).phase for repeat in range(5)] == [0.0, 0.25, 0.5, 0.75, 0.0]
    assert SweepPlan.from_dict(json.loads(json.dumps(plan.to_dict()))).lamps == plan.lamps
    (tmp_path / "plan.yaml").write_text("pwm: 90,0.1\npwm_phase: random\n")
    plan = PlanFile.read(tmp_path / "plan.yaml").plan
    assert (plan.repeats, plan.lamps.pulses(0, 3)) == (1, Pwm(90.0, 0.1).with_phase_of(3))
    with pytest.raises(ValueError, match="repeats = 3: must be a multiple of the 2 of pwm_phase"):
        SweepPlan(plan.grid, repeats=3, lamps=Lamps(pwm="90,0.1", pwm_phase=(0.0, 0.5)))


def test_lamps_need_to_know_where_targets_are():
    plan = SweepPlan({"exposure_s": (0.01,), "illuminance_lux": (50.0,)}, lamps=TARGETS)
    with pytest.raises(ValueError, match="needs labelled targets"):
        check_plan(plan, CAMERA, picture_set(picture("p", labels=None)))
    check_plan(replace(plan, lamps=Lamps(pwm="90,0.1")), CAMERA, picture_set(picture("p", labels=None)))


def rows_of(folder, name):
    with (folder / name).open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A sweep under a pulsed lamp, at ten phases, with a camera of two captures."""
    folder = tmp_path_factory.mktemp("run")
    phases = tuple(n / 10 for n in range(10))
    grid = {"exposure_s": (0.001, 0.003, 0.012), "illuminance_lux": (50.0,)}
    plan = SweepPlan(grid, repeats=10, lamps=replace(TARGETS, pwm_phase=phases))
    shown = picture_set(picture("a"), picture("b", lambda: noise(40, 51), None))
    shown = replace(shown, pictures=(shown.pictures[0], replace(shown.pictures[1], targets=())))
    done = evaluate(matched_detector(folder), shown, HDR, plan, output=folder / "run", strategy="grid")
    done.report()
    return folder / "run"


def test_tables_carry_phase_and_missed_pulses(run):
    rows = rows_of(run, "results.csv")
    clean = [row for row in rows if row["clean"] == "True"]
    assert all(row["pwm_phase"] == row["missed_pulse"] == "" for row in clean)
    seen = {(row["image"], row["repeat"]): row["pwm_phase"] for row in rows if row["clean"] == "False"}
    assert {float(phase) for phase in seen.values()} == {n / 10 for n in range(10)}
    assert {row["missed_pulse"] for row in rows if row["image"] == "b"} == {""}
    # pulses are 1.11 ms, captures 17/16 of the first exposure: dark from 0.1 to 1 - f T, ends not included
    shares = {float(row["exposure_s"]): row["missed_pulse_share"] for row in rows_of(run, "scores.csv")[1:]}
    assert {at: float(share) for at, share in shares.items()} == {0.001: 0.9, 0.003: 0.7, 0.012: 0.0}
    page = (run / "report.html").read_text()
    assert "Share of pictures that miss the pulsed lamp" in page
    (answer,) = Run.open(run).answers
    assert answer["window_from_limited_by"] == "missed pulses"


def test_a_cell_of_the_run_is_taken_again(run):
    """As the explorer shows it: the phase of its repeat, and all captures."""
    explored = Run.open(run, trust=True)
    cell = explored.cell(image="a", repeat=7, exposure_s=0.003)
    frame = explored.expose(PictureScene(sign(), explored.plan, picture("a")), cell)
    assert frame.exposure.lamp == Pwm(90.0, 0.1, 0.7)
    assert len(frame.exposure.camera.sensor.captures) == 2
