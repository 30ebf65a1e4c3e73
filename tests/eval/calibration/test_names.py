"""Kinds and exposures by names and headers, as capture programs write them, and what each doubts."""

import made_frames
import numpy as np
import pytest
from blurnoise_eval.calibration.listing import list_frames
from blurnoise_eval.calibration.names import exposure_of, kind_of

SIZE = (40, 50)
KINDS = {
    "DARKFLAT": "dark", "FlatDark": "dark", "Dark Flat": "dark", "flat darks": "dark", "Bias Frame": "dark",
    "offsets": "dark", "SKYFLAT": "flat", "twilight flats": "flat", "DomeFlat": "flat",
    "Offset_001": "dark", "Flat Field": "flat", "flat_1s_gain100_offset50": "flat",
    "FLAT_light_1": "flat", "Light Frame": "light", "lights": "light", "flatfish": "", "darkroom": "",
}  # fmt: skip
AVERAGED = ("Master Dark", "masterFlat_BIN-1", "dark_stacked", "MasterFlat_Stack20_50.0ms", "mean_dark")


@pytest.mark.parametrize(("name", "kind"), KINDS.items())
def test_kinds(name, kind):
    assert kind_of(name)[:2] == (kind, False)


@pytest.mark.parametrize("name", AVERAGED)
def test_averages(name):
    assert kind_of(name).averaged
    assert not kind_of("flat_stack_10ms").averaged  # pages of a file


EXPOSURES = {
    "dark_0,1s_0": 0.1, "Light_60_secs_001": 60.0, "EXPOSURE-0.001s": 0.001, "Flat_10.0ms_Bin1_-10.0C": 0.01,
    "gain100_10ms": 0.01, "flat_1.5e-3s": 0.0015, "dark_5min": 300.0,
    "exp100us": 1e-4, "20260101-120000_10ms": 0.01, "0001_10ms": 0.01, "flat 10 ms": 0.01,
    "5\u00b5s": 5e-6, "7\u03bcs": 7e-6, "flat_10_1": None, "21h16m00s": None, "img_-10.0C": None,
}  # fmt: skip


@pytest.mark.parametrize(("name", "exposure_s"), EXPOSURES.items())
def test_exposures(name, exposure_s):
    found = exposure_of(name)
    assert (found and found.readings[0]) == exposure_s
    assert found is None or found.clear


def lit(folder, names):
    """Frames whose light is that of their exposure, by name; dark ones of 60 DN."""
    random = np.random.default_rng(1)
    for name, exposure_s in names.items():
        mean = 60 + (3000 * exposure_s / max(names.values()) if "flat" in name else 0)
        np.save(folder / f"{name}.npy", np.rint(random.normal(mean, 3, SIZE)).astype(np.uint16))
    return folder


UNCLEAR = {
    "decimals": {f"{kind}_0_{n}s_{i}": n / 10 for kind in ("dark", "flat") for n in (1, 2, 4) for i in "ab"},
    "decimals above 1": {f"flat_{n // 10}_{n % 10}s": n / 10 for n in (1, 2, 4, 8, 16, 32)}
    | {"dark_1s": 1.0},
    "fractions": {f"{kind}_1_{n}s": 1 / n for kind in ("dark", "flat") for n in (50, 100, 250, 500)},
    "whole decimals": {f"flat_{n}_0s": float(n) for n in (1, 2, 4)} | {"dark_1s": 1.0},
    "numbers": {
        f"{kind}_{i}_{n}ms": n / 1000 for kind in ("dark", "flat") for n in (1, 2, 5) for i in (0, 1, 2)
    },
}


@pytest.mark.parametrize("names", UNCLEAR.values(), ids=UNCLEAR)
def test_the_light_decides_how_a_name_is_read(tmp_path, names):
    """0_1s is 0.1 s, or number 0 of 1 s; 1_250s is 1/250 s, or 1.25 s."""
    found = list_frames(lit(tmp_path, names))
    assert {frame.file.stem: frame.exposure_s for frame in found.frames} == pytest.approx(names)
    assert any(note.startswith("exposures in names: ") for note in found.notes)


def test_names_that_fit_the_light_in_no_reading(tmp_path):
    lit(tmp_path, {"flat_1_5s": 1, "flat_2_5s": 9, "flat_3_5s": 3})
    with pytest.raises(
        ValueError, match=r"flat_1_5s\.npy can be 0\.2 s or 1\.5 s or 5 s, and .* fits none; list them in"
    ):
        list_frames(tmp_path)


def fits(folder, name, **cards):
    (folder / name).parent.mkdir(exist_ok=True)
    made_frames.write_fits(folder / name, np.full(SIZE, 300, np.uint16), **cards)


HEADERS = {
    "another exposure": ({"EXPTIME": 2.0}, "0.1 s by name but 2 s by header; the header's is used", ("flat", 2.0)),
    "an exposure in ms": ({"EXPTIME": 100}, "exposures in headers are in ms, by the names", ("flat", 0.1)),
    "rounded": ({"EXPTIME": 0.1333}, None, ("flat", 0.1333)),
    "milliseconds": ({"EXPOSURE": "100 / [ms]"}, None, ("flat", 0.1)),
    "two exposures": ({"EXPTIME": 0.1, "EXPOSURE": 100}, "EXPTIME = 0.1 but EXPOSURE = 100", ("flat", 0.1)),
    "a decimal comma": ({"EXPTIME": "0,1"}, None, ("flat", 0.1)),
    "another kind": ({"IMAGETYP": "'Dark'"}, "flat by name but 'Dark' by header; the name", ("flat", 0.1)),
    "an average": ({"NCOMBINE": 20}, "left out: averages or processed frames (NCOMBINE = 20.0)", None),
    "calibrated": ({"CALSTAT": "'BDF'"}, "left out: averages or processed frames (CALSTAT = BDF)", None),
    "sky coordinates": ({"FRAME": "'FK5'"}, None, ("flat", 0.1)),
}  # fmt: skip


@pytest.mark.parametrize(("cards", "note", "frame"), HEADERS.values(), ids=HEADERS)
def test_a_header_beside_a_name(tmp_path, cards, note, frame):
    """Two signs of one thing: what differs is said, within the digits of the name nothing is."""
    fits(tmp_path, "flat_0,1s.fits", **cards)
    fits(tmp_path, "dark_1s.fits")
    found = list_frames(tmp_path)
    listed = [(each.kind, each.exposure_s) for each in found.frames if each.file.name == "flat_0,1s.fits"]
    assert listed == ([frame] if frame else [])
    assert [text.startswith(note) for text in found.notes] == [True] if note else not found.notes


def test_light_frames_alone_are_named_as_such(tmp_path):
    fits(tmp_path, "lights/a.fits", EXPTIME=30.0)
    fits(tmp_path, "b.fits", EXPTIME=30.0, IMAGETYP="'SNAPSHOT'")
    with pytest.raises(
        ValueError, match=r"no frames; .*left out: light frames \(SNAPSHOT\).*left out: light frames,"
    ):
        list_frames(tmp_path)


MOSAICS = {
    "as it is": ({}, 40, "GBRG"), "a row down": ({"YBAYROFF": 1}, 40, "RGGB"),
    "a column right": ({"XBAYROFF": 1}, 40, "BGGR"), "both": ({"BAYOFFX": 1, "BAYOFFY": 3}, 40, "GRBG"),
    "from below": ({"ROWORDER": "'BOTTOM-UP'"}, 40, "RGGB"),
    "of odd height": ({"ROWORDER": "'BOTTOM-UP'"}, 41, "GBRG"),
    "from above": ({"ROWORDER": "'TOP-DOWN'"}, 40, "GBRG"),
}  # fmt: skip


@pytest.mark.parametrize(("cards", "height", "letters"), MOSAICS.values(), ids=MOSAICS)
@pytest.mark.parametrize("key", ["BAYERPAT", "COLORTYP"])
def test_the_mosaic_begins_at_the_files_first_pixel(tmp_path, key, cards, height, letters):
    plane = np.full((height, 50), 300, np.uint16)
    made_frames.write_fits(tmp_path / "flat.fits", plane, EXPTIME=1.0, **{key: "'GBRG'"}, **cards)
    found = list_frames(tmp_path)
    assert [frame.cfa for frame in found.frames] == [letters]
    assert bool(found.notes) == (letters != "GBRG")


def test_tables_of_other_countries(tmp_path):
    """Semicolons or tabs with decimal commas are read, quoted numbers between commas are not."""
    np.save(tmp_path / "a.npy", np.full(SIZE, 300, np.uint16))
    for separator in ";\t":
        lines = ("file,kind,exposure_s,gain_db", "a.npy,flat,0:1,12:5")
        text = "\n".join(lines).replace(",", separator).replace(":", ",")
        (tmp_path / "frames.csv").write_text("sep=;\n" * (separator == ";") + text)
        (frame,) = list_frames(tmp_path).frames
        assert (frame.exposure_s, frame.gain_db) == (0.1, 12.5)
    (tmp_path / "frames.csv").write_text('file,kind,exposure_s\na.npy,flat,"0,1"')
    with pytest.raises(ValueError, match=r"exposure_s = '0,1': must be a valid number"):
        list_frames(tmp_path)


def test_a_table_beside_headers(tmp_path):
    """Milliseconds for seconds are said, an average is refused."""
    fits(tmp_path, "a.fits", EXPTIME=0.1)
    (tmp_path / "frames.csv").write_text("file,kind,exposure_s\na.fits,flat,100")
    assert (
        list_frames(tmp_path)
        .notes[0]
        .startswith("100 s in frames.csv but 0.1 s in the header; that of frames.csv")
    )
    fits(tmp_path, "a.fits", IMAGETYP="'Master Flat'")
    with pytest.raises(
        ValueError, match=r"line 2: a\.fits: 'Master Flat': must be a raw frame, not an average"
    ):
        list_frames(tmp_path)


def test_a_folder_says_more_than_names_of_light_frames(tmp_path):
    """As of frames that a capture program took as lights; dark flats were taken as flats."""
    for name in ("flats/Light_1s_1", "flat darks/Flat_1s_1", "flats/Dark_1s_1", "lights/Light_1s_1"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        np.save(tmp_path / f"{name}.npy", np.full(SIZE, 300, np.uint16))
    found = list_frames(tmp_path)
    assert {(frame.file.parent.name, frame.file.stem[:4], frame.kind) for frame in found.frames} == {
        ("flats", "Ligh", "flat"), ("flat darks", "Flat", "dark"), ("flats", "Dark", "dark"),
    }  # fmt: skip
    assert [note.startswith("left out: light frames") for note in found.notes] == [True]
