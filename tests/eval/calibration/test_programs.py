"""Folders as capture programs write them: the guide's table, a row a case. Gain 0.4 DN/e-, or why there is none."""

import cv2
import made_frames
import numpy as np
import pytest
from blurnoise_eval.calibration.fit import measure
from blurnoise_eval.calibration.formats import RawLayout

CAMERA = made_frames.LOUDER.with_figures(dark_current_e_s=500.0)


@pytest.fixture(scope="module")
def taken():
    """Kind, exposure, number of the exposure's frame, and its plane."""
    of_levels = made_frames.exposed(CAMERA, 3, size=(64, 80), levels=4, top=0.8)
    return [(*key, number, plane) for key, planes in of_levels.items() for number, plane in enumerate(planes)]


def comma(number):
    return f"{number:g}".replace(".", ",")


def fits(name, **cards):
    """What writes a frame as FITS; name, cards: their words and numbers by kind and exposure."""

    def write(folder, kind, exposure_s, number, plane):
        filled = {
            key: card(kind, exposure_s) if callable(card) else card
            for key, card in {"GAIN": 100, **cards}.items()
        }
        path = folder / name(kind, exposure_s, number)
        path.parent.mkdir(exist_ok=True)
        filled = {key: f"'{card}'" if isinstance(card, str) else card for key, card in filled.items()}
        made_frames.write_fits(path, plane, **filled)

    return write


def picture(suffix, stored=lambda plane: plane):
    def write(folder, kind, exposure_s, number, plane):
        cv2.imwrite(str(folder / f"{kind}_{1000 * exposure_s:g}ms_{number}{suffix}"), stored(plane))

    return write


def array(folder, kind, exposure_s, number, plane):
    np.save(folder / f"{kind}_{1000 * exposure_s:g}ms_{number}.npy", plane)


def packed(folder, kind, exposure_s, number, plane):
    """RAW12 of MIPI CSI-2: two high bytes, then both low halves."""
    pairs = plane.reshape(-1, 2)
    low = pairs[:, 0] & 15 | (pairs[:, 1] & 15) << 4
    octets = np.column_stack([pairs >> 4, low]).astype(np.uint8)
    (folder / f"{kind}_{1000 * exposure_s:g}ms_{number}.raw").write_bytes(octets.tobytes())


def dng(folder, kind, exposure_s, number, plane, black=60):
    (folder / kind).mkdir(exist_ok=True)
    exif = {33434: exposure_s, 34855: 100}
    tags = {50714: (4, black), 50717: (4, 4095), 34665: (4, exif), 50712: (3, tuple(range(4096)))}
    made_frames.write_dng(folder / kind / f"{1000 * exposure_s:g}_{number}.dng", plane, tags)


def dng_of_another_black(*frame):
    dng(*frame, black=256)


def each(one, other):
    """Dark frames by one writer, flat ones by another."""
    return lambda folder, kind, *rest: (one if kind == "dark" else other)(folder, kind, *rest)


def with_other_frame(writer, name, **cards):
    """Of one frame more, which is none."""

    def write(folder, kind, exposure_s, number, plane):
        writer(folder, kind, exposure_s, number, plane)
        extra = fits(lambda *_: name, **cards)
        extra(folder, kind, exposure_s, number, np.full_like(plane, 900))

    return write


TYPES = {"dark": "DARK", "flat": "FLAT"}
NINA = fits(
    lambda kind, time_s, n: f"{kind.upper()}/2026-01-01_{kind.upper()}_{comma(time_s)}s_{n:04}.fits",
    EXPTIME=lambda _, time_s: time_s, IMAGETYP=lambda kind, _: {"dark": "DARKFLAT", "flat": "FLAT"}[kind],
    ROWORDER="TOP-DOWN",
)  # fmt: skip
SHARPCAP = fits(
    lambda kind, time_s, n: f"{kind}/{1000 * time_s:g}_{n}.fits",
    EXPTIME=lambda _, time_s: time_s, BAYERPAT="GBRG", COLORTYP="GBRG", YBAYROFF=1, BAYOFFY=1,
)  # fmt: skip
ASIAIR = fits(
    lambda kind, time_s, n: (
        f"{kind.title()}_{1000 * time_s:.1f}ms_Bin1_gain100_20260101-120000_-10.0C_{n:04}.fit"
    )
)
SGPRO = fits(
    lambda kind, time_s, n: f"{kind}{time_s:g}_{n}.fit",
    EXPOSURE=lambda _, time_s: time_s, IMAGETYP=lambda kind, _: TYPES[kind], TEMPERAT=-10.0,
)  # fmt: skip
MAXIM = fits(
    lambda kind, time_s, n: f"{kind[0]}{time_s:g}_{n}.fit",
    EXPTIME=lambda _, time_s: time_s, IMAGETYP=lambda kind, _: {"dark": "Dark Frame", "flat": "Flat Field"}[kind],
    SNAPSHOT=1,
)  # fmt: skip
EKOS = fits(
    lambda kind, time_s, n: f"{kind.title()}_{time_s:g}_secs_2026-01-01T12-00-00_{n:03}.fits",
    EXPTIME=lambda _, time_s: time_s, FRAME=lambda kind, _: kind.title(),
)  # fmt: skip


def times_16(plane):
    return plane * 16


def repeated(plane):
    return plane << 4 | plane >> 8


PROGRAMS = {
    "N.I.N.A.": (
        with_other_frame(NINA, "LIGHT/a.fits", EXPTIME=30.0, IMAGETYP="LIGHT"), "left out: light frames (LIGHT)",
    ),
    "SharpCap": (SHARPCAP, "GBRG in the header is RGGB from the file's first row on, by YBAYROFF"),
    "ASIAIR": (
        with_other_frame(ASIAIR, "MasterFlat_Stack20_50.0ms_Bin1_gain100.fit"), "left out: averages or processed",
    ),
    "SGPro": (SGPRO, None),
    "MaxIm DL": (
        with_other_frame(MAXIM, "m.fit", EXPTIME=0.1, IMAGETYP="Flat Field", SNAPSHOT=20),
        "left out: averages or processed frames (SNAPSHOT = 20.0)",
    ),
    "Ekos": (EKOS, None),
    "Siril": (
        with_other_frame(EKOS, "dark_stacked.fit", EXPTIME=0.1, STACKCNT=20),
        "left out: averages or processed frames (STACKCNT = 20.0)",
    ),
    "PixInsight": (
        with_other_frame(EKOS, "masterDark_BIN-1_EXPOSURE-0.10s.fit", IMAGETYP="Master Dark"),
        "left out: averages or processed",
    ),
    "pylon": (picture(".png", times_16), "all numbers are multiples of 16"),
    "pylon, mixed": (each(array, picture(".tiff", times_16)), "error: .*multiples of 16.*unlike those of"),
    "SpinView": (picture(".pgm", times_16), "all numbers are multiples of 16"),
    "IDS peak": (picture(".png", repeated), "numbers are 12 bits stretched to 16"),
    "FFmpeg": (picture(".tiff", repeated), "numbers are 12 bits stretched to 16"),
    "rpicam-still": (dng, "a LinearizationTable spreads 4096 stored numbers to 4095"),
    "changed DNG": (dng_of_another_black, "the dark frames have a black level of 59.97 DN, but the files state 256"),
    "v4l2-ctl": (packed, None),
    "OpenCV": (picture(".png", lambda plane: cv2.merge([plane] * 3)), "error: .*not colours"),
    "ccdproc": (each(picture(".png", lambda plane: plane - 60), array), "error: .*wrap around below 0"),
    "Alpaca simulators": (each(picture(".png", lambda plane: plane.clip(60)), array), "error: .*60, hardly any"),
}  # fmt: skip


@pytest.mark.parametrize(("write", "said"), PROGRAMS.values(), ids=PROGRAMS)
def test_a_folder_of_the_program(tmp_path, taken, write, said):
    if write in (dng, dng_of_another_black):
        pytest.importorskip("rawpy", reason="needs rawpy: pip install 'blurnoise[raw]'")
    for frame in taken:
        write(tmp_path, *frame)
    layout = RawLayout.parse("mipi12,80x64") if write is packed else None
    if said and said.startswith("error: "):
        with pytest.raises(ValueError, match=said.removeprefix("error: ")):
            measure(tmp_path, layout=layout)
        return
    found = measure(
        tmp_path, layout=layout, cfa=None if write in (SHARPCAP, dng, dng_of_another_black) else "none"
    )
    gain, dark = (found.estimates[name] for name in ("system_gain_dn_per_e", "dark_current_e_s"))
    assert gain.low <= 0.4 <= gain.high
    assert dark.value == pytest.approx(500, rel=0.05)
    assert sum(level.frames for level in (*found.flat, *found.dark)) == len(taken)
    notes = [note for note in found.notes if "colour filters" not in note and "ISO" not in note]
    assert any(note.startswith(said) for note in notes) if said else not notes
    assert len(notes) <= 2
