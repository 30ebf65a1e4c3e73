"""Which frames a folder holds: by frames.csv, by EMVA's descriptor, by names and headers."""

import made_frames
import numpy as np
import pytest
from blurnoise_eval.calibration.listing import list_frames

PLANE = np.arange(40 * 50, dtype=np.uint16).reshape(40, 50)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("file,kind\na.npy,dark", "line 2: exposure_s: Field required"),
        (
            "file,kind,exposure_s,iso\na.npy,dark,1,100",
            "line 2: iso = '100': .*; columns: file, kind, exposure_s,",
        ),
        ("file,kind,exposure_s\na.npy,bias,0.1\n", "line 2: kind = 'bias': must be 'dark' or 'flat'"),
        ("file,kind,exposure_s\na.npy,dark,soon\n", "line 2: exposure_s = 'soon': must be a valid number"),
        ("file,kind,exposure_s\n../a.npy,dark,1\n", r"line 2: file name '\.\./a\.npy' leaves the folder"),
        ("file,kind,exposure_s\n", "no frames; must have a line for each file"),
    ],
)
def test_lists_with_faults(tmp_path, text, why):
    np.save(tmp_path / "a.npy", PLANE)
    (tmp_path / "frames.csv").write_text(text)
    with pytest.raises(ValueError, match=why):
        list_frames(tmp_path)


def test_a_list_of_stacks(tmp_path):
    for name in ("a.npy", "b.npy"):
        np.save(tmp_path / name, np.stack([PLANE] * 3))
    (tmp_path / "frames.csv").write_text("file,kind,exposure_s,page\na.npy,dark,1,\nb.npy,flat,1,2\n")
    assert [(frame.kind, frame.page) for frame in list_frames(tmp_path).frames] == [
        ("dark", 0), ("dark", 1), ("dark", 2), ("flat", 2),
    ]  # fmt: skip


DESCRIPTOR = r"""# made up
v 3.0
n 10 50 40
b 40000,5 120.25
i images\b_0.npy
i images\b_1.npy
d 1000000
i images\d_0.npy
"""


def test_a_descriptor_of_emva_1288(tmp_path):
    """With decimal commas, backslashes, and pictures that are listed and absent."""
    (tmp_path / "images").mkdir()
    for name in ("b_0", "d_0"):
        np.save(tmp_path / "images" / f"{name}.npy", PLANE)
    (tmp_path / "readme.txt").write_text("of the camera\nnot a list\n")
    (tmp_path / "Data.txt").write_text(DESCRIPTOR)
    found = list_frames(tmp_path)
    flat, dark = found.frames
    assert (flat.kind, flat.photons_per_px, flat.file.name) == ("flat", 120.25, "b_0.npy")
    assert flat.exposure_s == pytest.approx(40_000.5e-9)
    assert (dark.kind, dark.exposure_s, dark.photons_per_px) == ("dark", 0.001, None)
    assert found.bit_depth == 10
    assert list(found.notes) == ["Data.txt lists 3 pictures; 1 of them are missing and left out"]
    (tmp_path / "Data.txt").write_text(DESCRIPTOR + "b 1000")
    with pytest.raises(ValueError, match=r"Data\.txt: line 9: must be b EXPOSURE_NS PHOTONS"):
        list_frames(tmp_path)


def test_names_of_files_and_folders(tmp_path):
    for name in [
        "dark_10ms_0",
        "FLAT_2.5ms_b",
        "flat_500us_1",
        "cam1-dark-1s",
        "flat_10_1",
        "x",
        "flatfish_1ms",
    ]:
        np.save(tmp_path / f"{name}.npy", PLANE)
    for folder in ("darks", "flat"):
        (tmp_path / folder).mkdir()
        np.save(tmp_path / folder / "7ms_1.npy", PLANE)
    found = list_frames(tmp_path)
    assert {(frame.kind, frame.exposure_s) for frame in found.frames} == {
        ("dark", 0.01), ("flat", 0.0025), ("flat", 0.0005), ("dark", 1.0), ("dark", 0.007), ("flat", 0.007),
    }  # fmt: skip
    assert list(found.notes) == ["left out: no exposure in name or header (1 files, such as flat_10_1.npy)"]
    with pytest.raises(ValueError, match="must be a folder"):
        list_frames(tmp_path / "x.npy")
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError, match=r"no frames; must contain frames\.csv, a descriptor of EMVA 1288"):
        list_frames(tmp_path / "empty")


def test_raw_files_in_a_folder_of_darks_and_beside_it(tmp_path):
    """ISO 800 relative to ISO 200 is 12.04 dB; what is not called dark is a frame of light."""
    pytest.importorskip("rawpy", reason="needs rawpy: pip install 'blurnoise[raw]'")
    plane = np.arange(64 * 96, dtype=np.uint16).reshape(64, 96)
    (tmp_path / "dark").mkdir()
    for name, exposure_s, iso in (("dark/IMG_2", 0.1, 200), ("IMG_1", 0.01, 800)):
        made_frames.write_dng(tmp_path / f"{name}.dng", plane, {34665: (4, {33434: exposure_s, 34855: iso})})
    found = list_frames(tmp_path)
    listed = {(frame.kind, frame.exposure_s, frame.gain_db, frame.cfa) for frame in found.frames}
    assert listed == {("dark", 0.1, 0.0, "RGGB"), ("flat", 0.01, 12.041, "RGGB")}
    assert list(found.notes) == ["ISO 200, the lowest, is used as 0 dB of gain"]


def test_fits_files(tmp_path):
    """By their headers; a gain of a maker's unit needs frames.csv, which counts more."""
    for name, kind, gain in (("a", "'Dark Frame'", 0), ("b", "'FLAT'", 120)):
        made_frames.write_fits(tmp_path / f"{name}.fits", PLANE, EXPTIME=0.02, IMAGETYP=kind, GAIN=gain)
    with pytest.raises(ValueError, match=r"GAIN in the headers = 0, 120: .* add the column gain_db"):
        list_frames(tmp_path)
    (tmp_path / "frames.csv").write_text("file,gain_db\na.fits,0\nb.fits,12\n")
    listed = [(frame.kind, frame.exposure_s, frame.gain_db) for frame in list_frames(tmp_path).frames]
    assert listed == [("dark", 0.02, 0.0), ("flat", 0.02, 12.0)]
