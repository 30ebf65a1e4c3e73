"""Frames that no camera can be measured from are refused in one line that says which they are."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import made_frames
import numpy as np
import pytest
import torch
from blurnoise_eval.calibration.fit import measure
from blurnoise_eval.calibration.frames import frames_of, read_plane

from blurnoise.optics.colour import srgb_from_linear

CAMERA = replace(
    made_frames.drawn_camera(2),
    full_well_e=9000.0, system_gain_dn_per_e=0.4, read_noise_e=4.0, prnu=0.01, dsnu_e=2.0, black_level_dn=20.0,
    bit_depth=12,
)  # fmt: skip
SIZE = (96, 121)
Planes = dict[tuple[str, float], list[np.ndarray]]


@pytest.fixture(scope="module")
def planes() -> Planes:
    return made_frames.exposed(CAMERA, 1, size=SIZE)


def flats(
    planes: Planes, change: Callable[[np.ndarray, int], np.ndarray], only: float | None = None
) -> Planes:
    """The planes with each flat frame, or those of one exposure, changed; the number of the frame is passed, too."""
    return {
        (kind, exposure_s): [
            change(plane, number).astype(plane.dtype)
            if kind == "flat" and only in (None, exposure_s)
            else plane
            for number, plane in enumerate(each)
        ]
        for (kind, exposure_s), each in planes.items()
    }


def refused(folder: Path, planes: Planes, **how: object) -> str:
    with pytest.raises(ValueError, match=r"\S") as caught:
        measure(made_frames.save(folder / "frames", planes), **how)  # type: ignore[arg-type]
    told = str(caught.value)
    assert "\n" not in told
    return told


def test_what_the_others_change_is_sound(planes: Planes, tmp_path: Path) -> None:
    assert measure(made_frames.save(tmp_path / "frames", planes)).bit_depth == 12


def every(planes: Planes, change: Callable[[np.ndarray], np.ndarray]) -> Planes:
    """All planes changed."""
    return {key: [change(plane) for plane in each] for key, each in planes.items()}


def coded(plane: np.ndarray) -> np.ndarray:
    return (4095 * srgb_from_linear(torch.from_numpy(plane / 4095.0)).numpy()).astype(np.uint16)


def squeezed(plane: np.ndarray) -> np.ndarray:
    """8 bits through JPEG, then saved as something else."""
    return cv2.imdecode(cv2.imencode(".jpg", (plane / 16).astype(np.uint8))[1], cv2.IMREAD_UNCHANGED)


def blurred(plane: np.ndarray, _: int) -> np.ndarray:
    return cv2.blur(plane.astype(float), (2, 2))


def banded(plane: np.ndarray, number: int) -> np.ndarray:
    rows = 1 + 0.01 * np.sin(np.arange(SIZE[0]) / 5)[:, None]
    return plane * (rows if number else 1 / rows)


def of_50_ms(planes: Planes, change: Callable[[np.ndarray], np.ndarray]) -> Planes:
    """The second flat frame of 50 ms changed."""
    first, second = planes["flat", 0.05]
    return {**planes, ("flat", 0.05): [first, change(second)]}


def sixteenth(plane: np.ndarray) -> np.ndarray:
    return (plane // 16).astype(np.uint8)


REFUSED: dict[str, tuple[Callable[[Planes], Planes], str]] = {
    "gamma": (lambda p: every(p, coded), "not linear"),
    "off the line": (lambda p: flats(p, lambda x, _: x * 0.85, only=0.05), "^flat 50 ms: not linear"),
    "clipped": (
        lambda p: flats(p, lambda x, _: np.minimum(x, 300)), "clipped, [78] of 8 flat levels reach 300 DN"
    ),
    "dark cut off at 0": (
        lambda p: every(p, lambda x: np.maximum(x.astype(int) - 20, 0).astype(np.uint16)), "^dark.*clipped"
    ),
    "flicker": (
        lambda p: flats(p, lambda x, number: x * (1 - 0.04 * number), only=0.05),
        "^flat 50 ms: flickering, its frames' light differs by 4",
    ),
    "bands": (lambda p: flats(p, banded), "flickering in bands"),
    "filtered": (lambda p: flats(p, blurred), "filtered or lossy"),
    "compressed": (lambda p: every(p, squeezed), "filtered or lossy"),
    "the same frame twice": (lambda p: {key: [x[0], x[0]] for key, x in p.items()}, "all frames are the same"),
    "two exposures": (lambda p: dict(list(p.items())[:4]), "frames: 2 flat exposures; must be 3"),
    "no dark": (lambda p: {key: x for key, x in p.items() if key[0] == "flat"}, "no dark ones"),
    "one frame": (
        lambda p: {**p, ("flat", 0.05): p["flat", 0.05][:1]}, r"flat_50.0000ms_0.npy: alone; must be two"
    ),
    "sizes": (lambda p: of_50_ms(p, lambda x: x[:, :-1]), "this is 120 x 96 px, .* before it 121 x 96 px"),
    "depths": (lambda p: of_50_ms(p, sixteenth), "this is 121 x 96 px, 8 bits; .* before it .* 16 bits"),
}  # fmt: skip


@pytest.mark.parametrize(("change", "why"), REFUSED.values(), ids=REFUSED)
def test_refused(planes: Planes, tmp_path: Path, change: Callable[[Planes], Planes], why: str) -> None:
    assert re.search(why, refused(tmp_path, change(planes)))


def test_more_than_the_bits_hold(planes: Planes, tmp_path: Path) -> None:
    assert "bit_depth = 10: frames hold" in refused(tmp_path, planes, bit_depth=10)


def test_numbers_at_the_top_of_16_bits_are_counted_in_steps(planes: Planes, tmp_path: Path) -> None:
    low = measure(made_frames.save(tmp_path / "low", planes))
    high = measure(made_frames.save(tmp_path / "high", every(planes, lambda plane: 16 * plane)))
    assert high.bit_depth == 12
    assert any("multiples of 16" in note for note in high.notes)
    for name, told in low.estimates.items():
        assert high.estimates[name].value == pytest.approx(told.value, rel=1e-6), name


def test_files(tmp_path: Path) -> None:
    plane = np.arange(40 * 50, dtype=np.uint16).reshape(40, 50)
    for name in ("a.png", "a.tiff", "a.pgm"):
        cv2.imwrite(str(tmp_path / name), plane)
    np.save(tmp_path / "a.npy", plane.astype(float))
    plane.astype("<u2").tofile(tmp_path / "a.raw")
    for name in ("a.png", "a.tiff", "a.pgm", "a.npy", "a.raw"):
        np.testing.assert_array_equal(read_plane(tmp_path / name, (50, 40)), plane)


FAULTY: dict[str, tuple[Callable[[Path, np.ndarray], object], str]] = {
    "a.jpg": (lambda path, plane: cv2.imwrite(str(path), plane.astype(np.uint8)), "JPEG is lossy"),
    "jpeg.png": (lambda path, plane: path.write_bytes(b"\xff\xd8\xff"), "JPEG is lossy"),
    "colour.png": (
        lambda path, plane: cv2.imwrite(str(path), np.zeros((40, 50, 3), np.uint8)),
        "not colours",
    ),
    "mean.npy": (lambda path, plane: np.save(path, plane + 0.5), "whole numbers"),
    "text.npy": (lambda path, plane: np.save(path, np.full((40, 50), "x")), "whole numbers"),
    "small.png": (lambda path, plane: cv2.imwrite(str(path), plane[:20]), "at least 32 x 32"),
    "broken.png": (lambda path, plane: path.write_bytes(b"\x89PNG"), "that OpenCV can decode"),
    "a.raw": (lambda path, plane: plane.tofile(path), "4000 bytes: must be 2 x 50 x 41"),
}


@pytest.mark.parametrize("name", FAULTY)
def test_files_that_are_no_frames(tmp_path: Path, name: str) -> None:
    write, why = FAULTY[name]
    write(tmp_path / name, np.arange(40 * 50, dtype=np.uint16).reshape(40, 50))
    with pytest.raises(ValueError, match=f"{name}: .*{why}"):
        read_plane(tmp_path / name, (50, 41))


def test_raw_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.bin").write_bytes(b"0000")
    with pytest.raises(ValueError, match="--raw-size"):
        read_plane(tmp_path / "a.bin")
    monkeypatch.setitem(__import__("sys").modules, "rawpy", None)
    (tmp_path / "a.cr2").write_bytes(b"II*\0")
    with pytest.raises(ValueError, match=r"pip install 'blurnoise\[raw\]'"):
        read_plane(tmp_path / "a.cr2")


def test_raw_files_are_read_by_rawpy(tmp_path: Path) -> None:
    pytest.importorskip("rawpy", reason="needs rawpy: pip install 'blurnoise[raw]'")
    plane = np.arange(64 * 96, dtype=np.uint16).reshape(64, 96)
    made_frames.write_dng(tmp_path / "a.dng", plane, {50708: (2, "Made Up")})
    np.testing.assert_array_equal(read_plane(tmp_path / "a.dng"), plane)
    (tmp_path / "b.dng").write_bytes(b"II*\0nothing")
    with pytest.raises(ValueError, match="LibRaw"):
        read_plane(tmp_path / "b.dng")


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("file,kind\na.npy,dark", "line 2: exposure_s: Field required"),
        ("file,kind,exposure_s,iso\na.npy,dark,1,100", "line 2: iso = '100': "),
        ("file,kind,exposure_s\na.npy,bias,0.1\n", "line 2: kind = 'bias': must be 'dark' or 'flat'"),
        ("file,kind,exposure_s\na.npy,dark,soon\n", "line 2: exposure_s = 'soon': must be a valid number"),
        ("file,kind,exposure_s\na.npy,dark,-1\n", "line 2: exposure_s = '-1': must be greater"),
        ("file,kind,exposure_s\n,dark,1\n", "line 2: file: Field required"),
        ("file,kind,exposure_s\n../a.npy,dark,1\n", r"line 2: file name '\.\./a\.npy' leaves the folder"),
        ("file,kind,exposure_s\nb.npy,dark,1\n", "file 'b.npy': must be a file"),
        ("file,kind,exposure_s\n", "no frames"),
    ],
)
def test_lists(tmp_path: Path, text: str, why: str) -> None:
    (tmp_path / "a.npy").touch()
    (tmp_path / "frames.csv").write_text(text)
    with pytest.raises(ValueError, match=why):
        frames_of(tmp_path)


def test_names(tmp_path: Path) -> None:
    names = "dark_10ms_0.png FLAT_2.5ms_b.TIF flat_500us_1.npy dark_1s.dng flat_10_1.png x.png"
    for name in names.split():
        (tmp_path / name).touch()
    found = {(frame.kind, frame.exposure_s) for frame in frames_of(tmp_path)}
    assert found == {("dark", 0.01), ("flat", 0.0025), ("flat", 0.0005), ("dark", 1.0)}
    with pytest.raises(ValueError, match="must be a folder"):
        frames_of(tmp_path / "x.png")
