"""Numbers that drivers store are a converter's counts, or are refused; numbers that noise cannot have are doubted."""

import made_frames
import numpy as np
import pytest
from blurnoise_eval.calibration import counts
from blurnoise_eval.calibration.fit import measure

CAMERA = made_frames.LOUDER.with_figures(dark_current_e_s=5.0)


@pytest.fixture(scope="module")
def taken():
    return made_frames.exposed(CAMERA, 1, size=(64, 80), levels=5, top=0.8)


def saved(folder, taken, dark, flat):
    stored = {"dark": dark, "flat": flat}
    return made_frames.save(
        folder,
        {key: [stored[key[0]](plane).astype(np.uint16) for plane in planes] for key, planes in taken.items()},
    )


def plain(plane):
    return plane


def times(factor):
    return lambda plane: np.floor(plane * float(factor))


def repeated(plane):
    """12 bits, with the highest again below them: IDS peak's PNG, FFmpeg's gray12le as gray16."""
    return plane << 4 | plane >> 8


def repeated_in_14(plane):
    return plane << 2 | plane >> 10


def scaled(plane):
    return np.rint(plane * (65535 / 4095))


def clipped_at_the_top(plane):
    return np.where(plane > 3000, 65535, plane * 16)


READ = {
    "as arrays": (plain, plain, ""),
    "at the top of 16 bits": (times(16), times(16), "all numbers are multiples of 16"),
    "beside 65535": (times(16), clipped_at_the_top, "all numbers are multiples of 16"),
    "bits repeated": (repeated, repeated, "numbers are 12 bits stretched to 16"),
    "bits repeated in 14": (repeated_in_14, repeated_in_14, "numbers are 12 bits stretched to 14"),
    "scaled to 65535": (scaled, scaled, "numbers are 12 bits stretched to 16"),
}


@pytest.mark.parametrize(("dark", "flat", "note"), READ.values(), ids=READ)
def test_counts_are_read(tmp_path, taken, dark, flat, note):
    """Gain and read noise are those of the arrays: repeated bits made them 16 times, and 10 to 16 % more."""
    found = measure(saved(tmp_path / "frames", taken, dark, flat))
    gain, read_e = (found.estimates[name] for name in ("system_gain_dn_per_e", "read_noise_e"))
    assert gain.low <= 0.4 <= gain.high
    assert gain.value == pytest.approx(0.4, rel=0.05)
    assert read_e.low <= 6 <= read_e.high
    assert (found.bit_depth, found.doubts) == (12, [])
    assert [text.startswith(note) for text in found.notes] == ([True] if note else [])


MIXED = {
    "pictures and arrays of pylon": (times(16), plain, "dark.*multiples of 16 .*unlike those of .*flat"),
    "arrays and pictures of IDS": (plain, repeated, "flat.*multiples of 2, unlike those of .*dark"),
    "big-endian": (np.ndarray.byteswap, np.ndarray.byteswap, "numbers have their two bytes exchanged"),
    "dead pixels below the cut": (
        lambda plane: np.where(np.arange(80) + np.arange(64)[:, None] < 2, 7, np.maximum(plane, 56)), plain,
        "7.* % of its pixels are 56, hardly any below",
    ),
    "cut below black": (lambda plane: np.maximum(plane, 56), plain, "7.* % of its pixels are 56, hardly any below"),
}  # fmt: skip


@pytest.mark.parametrize(("dark", "flat", "why"), MIXED.values(), ids=MIXED)
def test_frames_of_two_scales_and_cut_ones_are_refused(tmp_path, taken, dark, flat, why):
    """Arrays beside pictures gave a gain of 3.47 for 0.25 DN/e-; cut dark frames 3.5 e- for 6.2."""
    with pytest.raises(ValueError, match=why):
        measure(saved(tmp_path / "frames", taken, dark, flat))


def test_eight_bits_that_ffmpeg_widened_are_not_called_exchanged_alone():
    """rgb24 as rgb48: 255 is 65283."""
    widened = np.rint(np.arange(256) * 65283 / 255).astype(np.uint16)
    with pytest.raises(ValueError, match=r"a.png: .* or are 8 bits widened to about 256 times"):
        counts.scale_of([counts.FrameNumbers("a.png", widened)])


def companded(plane):
    """As by a LinearizationTable of two parts: numbers 5 and 17 apart."""
    return np.where(plane < 300, (plane + 2) // 5 * 5, (plane + 8) // 17 * 17 + 1)


STRETCHED = {
    "times 1.5": (times(1.5), 1.5, 1 / 3),
    "times 3.7": (times(3.7), 3.7, 2.7 / 3.7),
    "table": (companded, 1, 0.94),
}


@pytest.mark.parametrize(("change", "factor", "missing"), STRETCHED.values(), ids=STRETCHED)
def test_numbers_that_never_occur_are_doubted_and_their_rounding_is_no_noise(
    tmp_path, taken, change, factor, missing
):
    """The rounding of the table made the read noise 12 % too large."""
    found = measure(saved(tmp_path / "frames", taken, change, change))
    (doubt,) = found.doubts
    never, could = (int(word) for word in doubt.text.split()[:3:2])
    assert never / could == pytest.approx(missing, abs=0.02)
    assert "never occur between frequent ones" in doubt.text
    gain, read_e = (found.estimates[name] for name in ("system_gain_dn_per_e", "read_noise_e"))
    assert gain.value == pytest.approx(0.4 * factor, rel=0.025)  # 4 deviations of 5 levels of 5120 pixels
    assert read_e.value == pytest.approx(6, rel=0.04)  # 4 deviations


def test_noise_below_the_steps_of_numbers_widens_the_read_noise(tmp_path, taken):
    """2.4 DN of noise and steps of 8 DN: whatever rounding adds, 6 e- are within."""
    coarse = saved(tmp_path / "frames", taken, *[lambda plane: plane // 8 * 8 + plane // 2048] * 2)
    found = measure(coarse)
    assert "where it is not known well" in found.doubts[0].text
    assert found.estimates["read_noise_e"].low <= 6 <= found.estimates["read_noise_e"].high


@pytest.mark.parametrize("dead", [False, True])
def test_little_noise_that_is_clamped_at_black_is_doubted(tmp_path, dead):
    """0.5 DN of noise, cut at its mean: 0.7 e- for 1.2 with an interval of 5 %."""
    quiet = CAMERA.with_figures(read_noise_e=1.2, dsnu_e=0.6)
    taken = made_frames.exposed(quiet, 1, size=(64, 80), levels=5, top=0.8)
    spots = (np.arange(80) + np.arange(64)[:, None] < 2) & dead
    cut = saved(tmp_path / "frames", taken, lambda plane: np.where(spots, 7, np.maximum(plane, 60)), plain)
    found = measure(cut)
    assert "black seems clamped: 80" in found.doubts[-1].text
    assert found.estimates["read_noise_e"].value < 0.8
    assert found.estimates["read_noise_e"].high > 1.2


def test_two_frequent_numbers_show_a_scale():
    """Dark frames with little noise have two numbers, of pictures here; the flat ones are arrays."""
    dark = counts.FrameNumbers.of("dark.png", np.repeat([[240], [244]], 60, 1).astype(np.uint16))
    flat = counts.FrameNumbers.of("flat.npy", np.arange(300, 400, dtype=np.uint16)[None])
    with pytest.raises(
        ValueError, match=r"dark\.png: all numbers are multiples of 4 .*unlike those of flat\.npy"
    ):
        counts.scale_of([dark, flat])
    one = counts.FrameNumbers.of("dark.png", np.repeat([[240], [244]], 40, 1).astype(np.uint16))
    assert counts.scale_of([one, flat]) == counts.Scale()  # by chance


def test_gains_of_two_programs_are_refused():
    """A digital gain of 16 needs 24 dB; one of 4 at 12 dB is one."""
    plain, times_16 = counts.Scale(), counts.Scale(step=16)
    with pytest.raises(
        ValueError, match=r"frames at 6 dB: all numbers are multiples of 16 .*unlike those at 0 dB"
    ):
        counts.common_scale({0.0: plain, 6.0: times_16})
    with pytest.raises(ValueError, match="frames at 0 dB: all numbers are multiples of 16"):
        counts.common_scale({0.0: times_16, 6.0: plain})
    assert counts.common_scale({0.0: plain, 12.0: counts.Scale(step=4)}) == plain


def test_noise_below_rounding_is_not_taken_as_cut(tmp_path):
    """Black at 1.3 DN, noise of 0.1 DN: three quarters of the pixels are 1, others 2, none 0."""
    quiet = made_frames.drawn_camera(0)
    found = measure(saved(tmp_path / "frames", made_frames.exposed(quiet, 0, size=(64, 80)), plain, plain))
    assert found.dark[0].share(0) < 1e-3
    assert found.fit.rounding


def exchanged(folder, one, other):
    """Two files of the folder under each other's names."""
    (folder / one).rename(folder / "x")
    (folder / other).rename(folder / one)
    (folder / "x").rename(folder / other)


ORDER = {
    "times exchanged": (
        [(f"flat_40.0000ms_{n}.npy", f"flat_80.0000ms_{n}.npy") for n in (0, 1)],
        r"flat 60 ms: its mean is .* of flat 40 ms; are exposure times and kinds right",
    ),
    "one frame of another time": (
        [("flat_40.0000ms_0.npy", "flat_80.0000ms_0.npy")],
        r"flat 40 ms: the means of its frames are .*; are some of another exposure or kind",
    ),
    "flat for dark": (
        [(f"flat_40.0000ms_{n}.npy", f"dark_40.0000ms_{n}.npy") for n in (0, 1)],
        r"(flat|dark) 40 ms: its mean is .*; are exposure times and kinds right",
    ),
    "flat frames among dark ones": (
        [("flat_60.0000ms_0.npy", "dark_60.0000ms_0.npy")],
        r"dark 60 ms: the means of its frames are .*; are some of another exposure or kind",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("pairs", "why"), ORDER.values(), ids=ORDER)
def test_levels_that_do_not_rise_with_time_are_refused_by_name(tmp_path, taken, pairs, why):
    folder = saved(tmp_path / "frames", taken, plain, plain)
    for pair in pairs:
        exchanged(folder, *pair)
    with pytest.raises(ValueError, match=why):
        measure(folder)


def test_a_dark_level_of_another_time_is_refused_by_name(tmp_path):
    """Before, dark current was half of the true one, and a tone curve was suspected."""
    warm = CAMERA.with_figures(dark_current_e_s=5000.0)
    taken = made_frames.exposed(warm, 1, size=(64, 80), levels=5, top=0.8)
    taken["dark", 0.15] = taken.pop(("dark", 0.06))
    with pytest.raises(
        ValueError, match=r"dark 150 ms: its mean is .* by the other dark levels; is its exposure"
    ):
        measure(saved(tmp_path / "frames", taken, plain, plain))
