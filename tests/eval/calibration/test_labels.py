"""Levels whose exposure or light is wrong by the other levels: left out by name, or refused with the reason."""

import made_frames
import numpy as np
import pytest
from blurnoise_eval.calibration.fit import measure

SIZE = (64, 81)
GAIN = made_frames.CAMERA.sensor.system_gain_dn_per_e
WRONG = "flat 2.5 ms: its signal fits 50 ms by the other levels; left out"


@pytest.fixture(scope="module")
def planes():
    return made_frames.exposed(made_frames.CAMERA, 1, size=SIZE)


def relabelled(planes, **new_ms):
    """The planes with other exposures of flat levels: of_50=2.5 is 50 ms called 2.5 ms."""
    changes = {("flat", round(float(old[3:]) / 1e3, 6)): ("flat", ms / 1e3) for old, ms in new_ms.items()}
    return {
        changes.get((kind, round(exposure_s, 6)), (kind, exposure_s)): x
        for (kind, exposure_s), x in planes.items()
    }


def test_a_level_that_the_others_contradict_is_left_out_by_name(planes, tmp_path):
    found = measure(made_frames.save(tmp_path / "frames", relabelled(planes, of_50=2.5)))
    assert WRONG in found.notes
    assert len(found.flat) == 7
    assert found.estimates["system_gain_dn_per_e"].value == pytest.approx(GAIN, rel=0.03)


def test_a_level_with_too_long_an_exposure_is_left_out(planes, tmp_path):
    found = measure(made_frames.save(tmp_path / "frames", relabelled(planes, of_50=500.0)))
    assert [note for note in found.notes if note.endswith("left out")] == [
        "flat 500 ms: its signal fits 50 ms by the other levels; left out"
    ]


def test_photons_that_the_others_contradict(planes, tmp_path):
    """Exposure and photons are wrong, as in a set of EMVA's: both are told."""
    folder = made_frames.save(tmp_path / "frames", planes)
    lines = ["file,kind,exposure_s,photons_per_px"]
    for (kind, exposure_s), each in planes.items():
        time_s = 0.0025 if kind == "flat" and round(exposure_s, 3) == 0.05 else exposure_s
        photons = 2e5 * time_s if kind == "flat" else ""
        names = [f"{kind}_{1e3 * exposure_s:.4f}ms_{number}.npy" for number in range(len(each))]
        lines += [f"{name},{kind},{time_s},{photons}" for name in names]
    (folder / "frames.csv").write_text("\n".join(lines))
    assert (
        "flat 2.5 ms, 500 photons/px: its signal fits 50 ms, 1e+04 photons/px by the other levels; left out"
        in measure(folder).notes
    )


def test_saturated_levels_are_right(tmp_path):
    """Those of 80 and 90 ms have the signal of 55 ms."""
    planes = made_frames.exposed(made_frames.CAMERA, 2, size=SIZE, levels=20, top=1.8)
    found = measure(made_frames.save(tmp_path / "frames", planes))
    assert len(found.flat) == 20


def test_no_level_is_left_out_after_a_tone_curve(planes, tmp_path):
    coded = {
        key: [np.round(4095 * (x / 4095) ** 0.45).astype(np.uint16) for x in of] for key, of in planes.items()
    }
    folder = made_frames.save(tmp_path / "frames", relabelled(coded, of_50=2.5))
    with pytest.raises(ValueError, match=r"not linear|are exposure times and kinds right"):
        measure(folder)


def test_more_than_a_fifth_of_the_levels_is_refused(planes, tmp_path):
    folder = made_frames.save(tmp_path / "frames", relabelled(planes, of_50=2.5, of_75=3.0))
    with pytest.raises(ValueError, match=r"flat 12\.5 ms: its mean is .* DN of flat 3 ms"):
        measure(folder)


def test_named_levels_are_left_out(planes, tmp_path):
    folder = made_frames.save(tmp_path / "frames", relabelled(planes, of_50=2.5, of_75=3.0))
    found = measure(folder, leave_out=["flat 2.5 ms", "flat 3 ms", "dark 50 ms"])
    assert [round(1e3 * level.exposure_s, 1) for level in found.flat] == [12.5, 25, 37.5, 62.5, 87.5, 100]
    assert len(found.dark) == 7


def test_a_name_that_no_level_has_is_refused(planes, tmp_path):
    folder = made_frames.save(tmp_path / "frames", planes)
    with pytest.raises(ValueError, match=r"leave_out = 'flat 5 ms': must name a level, such as dark 100 ms"):
        measure(folder, leave_out=["flat 5 ms"])


def test_one_level_off_the_line_is_asked_for_its_label_not_for_gamma(planes, tmp_path):
    off = {
        key: [(0.85 * x).astype(np.uint16) for x in of] if key == ("flat", 0.05) else of
        for key, of in planes.items()
    }
    with pytest.raises(ValueError, match=r"the other levels are; .* --leave-out 'flat 50 ms'") as caught:
        measure(made_frames.save(tmp_path / "frames", off))
    assert "gamma" not in str(caught.value)
