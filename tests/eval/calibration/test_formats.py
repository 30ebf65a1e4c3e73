"""Files of frames are read as they were written, and refused where they hold no frames."""

import cv2
import made_frames
import numpy as np
import pytest
from blurnoise_eval.calibration.formats import PACKINGS, RawLayout, format_of, read_plane

PLANE = np.arange(40 * 50, dtype=np.uint16).reshape(40, 50)


def test_files_of_one_frame(tmp_path):
    for name in ("a.png", "a.tiff", "a.pgm"):
        cv2.imwrite(str(tmp_path / name), PLANE)
    np.save(tmp_path / "a.npy", PLANE.astype(float))
    PLANE.astype("<u2").tofile(tmp_path / "a.raw")
    made_frames.write_fits(tmp_path / "a.fits", PLANE)
    layout = RawLayout.parse("u16,50x40")
    for name in ("a.png", "a.tiff", "a.pgm", "a.npy", "a.raw", "a.fits"):
        np.testing.assert_array_equal(read_plane(tmp_path / name, layout), PLANE, name)
        assert format_of(tmp_path / name).pages(tmp_path / name, layout) == 1


def test_files_of_several_frames(tmp_path):
    """Of unlike numbers, so that an exchange of pages, rows or columns shows."""
    stack = np.random.default_rng(1).integers(0, 60_000, (3, 40, 50), dtype=np.uint16)
    cv2.imwritemulti(str(tmp_path / "a.tif"), [*stack])
    np.save(tmp_path / "a.npy", stack)
    stack.astype("<u2").tofile(tmp_path / "a.bin")
    made_frames.write_fits(tmp_path / "a.fit", stack)
    layout = RawLayout.parse("u16,50x40,100")
    for name in ("a.tif", "a.npy", "a.bin", "a.fit"):
        assert format_of(tmp_path / name).pages(tmp_path / name, layout) == 3
        read = [read_plane(tmp_path / name, layout, page) for page in range(3)]
        np.testing.assert_array_equal(read, stack, name)


def packed(name, rows):
    """Pixels (H, W) packed bit by bit as the standards draw it; W a multiple of the group."""
    bits, pixels, _, mipi = PACKINGS[name]
    octets = bytearray()
    for group in rows.reshape(-1, pixels).tolist():
        # CSI-2, RAW10 and RAW12: the high eight bits of each, then the low ones of the first in bit 0
        if mipi:
            octets += bytes(value >> bits - 8 for value in group)
            digits = "".join(f"{value & (1 << bits - 8) - 1:0{bits - 8}b}" for value in group[::-1])
        else:  # PFNC: the first pixel's lowest bit is the first byte's lowest
            digits = "".join(f"{value:0{bits}b}" for value in group[::-1])
        octets += int(digits, 2).to_bytes(len(digits) // 8, "little")
    return bytes(octets)


@pytest.mark.parametrize("name", PACKINGS)
def test_packed_rows_with_padding(tmp_path, name):
    bits = PACKINGS[name].bits
    frames = np.random.default_rng(2).integers(0, 1 << bits, (2, 40, 64), dtype=np.uint16)
    stride = 64 * bits // 8 + 7
    (tmp_path / "a.raw").write_bytes(
        b"".join(packed(name, row).ljust(stride, b"\xff") for frame in frames for row in frame)
    )
    for width in (64, 61):  # the last pixels of a row are left out where the size says so
        layout = RawLayout.parse(f"{name},{width}x40,{stride}")
        read = [read_plane(tmp_path / "a.raw", layout, page) for page in (0, 1)]
        np.testing.assert_array_equal(read, frames[..., :width])


def test_first_bytes_of_mipi_and_mono():
    """Numbers worked out by hand: 0x3FF, 0, 0x155, 2 and 0xABC, 0x123."""
    four, two = [[0x3FF, 0, 0x155, 2]], [[0xABC, 0x123]]
    assert packed("mipi10", np.array(four)) == bytes([0xFF, 0x00, 0x55, 0x00, 0b10_01_00_11])
    assert packed("mipi12", np.array(two)) == bytes([0xAB, 0x12, 0x3C])
    assert packed("mono12p", np.array(two)) == bytes([0xBC, 0x3A, 0x12])


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("mipi10", "must be PACKING,WIDTHxHEIGHT"),
        ("mipi11,64x48", "raw_layout = 'mipi11'"),
        ("mipi10,64x0", "raw_layout, height = 0"),
        ("mono12p,64x48,95", "stride = 95: must be 96 or more, the bytes of 64 pixels"),
    ],
)
def test_layouts_that_cannot_be(text, why):
    with pytest.raises(ValueError, match=why):
        RawLayout.parse(text)


def _npy(path, shape):
    header = f"{{'descr': '<u2', 'fortran_order': False, 'shape': {shape}}}".ljust(117) + "\n"
    path.write_bytes(b"\x93NUMPY\x01\0" + len(header).to_bytes(2, "little") + header.encode() + bytes(4000))


FAULTY = {
    "a.jpg": (lambda path: cv2.imwrite(str(path), PLANE.astype(np.uint8)), "JPEG file"),
    "colour.png": (lambda path: cv2.imwrite(str(path), np.zeros((40, 50, 3), np.uint8)), "not colours"),
    "mean.npy": (lambda path: np.save(path, PLANE + 0.5), "integers"),
    "line.npy": (lambda path: np.save(path, PLANE.ravel()), r"shape = \(2000,\): must be \(H, W\), or"),
    "negative.npy": (lambda path: _npy(path, "(-1, 40)"), "is not an NPY file"),
    "beyond.npy": (lambda path: _npy(path, f"({10**24}, 2)"), "is not an NPY file"),
    "open.npy": (lambda path: _npy(path, "(40, (50"), "is not an NPY file"),
    "flags.npy": (lambda path: np.save(path, PLANE > 3), "integers"),
    "records.npy": (lambda path: np.save(path, PLANE.astype([("dn", "<u2")])), "integers"),
    "small.png": (lambda path: cv2.imwrite(str(path), PLANE[:20]), "at least 32 x 32"),
    "a.raw": (lambda path: PLANE.tofile(path), "4000 bytes; must have 4100, 41 rows of 100 bytes"),
    "mean.fits": (lambda path: made_frames.write_fits(path, PLANE, BSCALE=0.5), "integers"),
    "short.fits": (lambda path: path.write_bytes(b"SIMPLE  =  T"), "its header has no END"),
    "cut.fits": (lambda path: made_frames.write_fits(path, PLANE, NAXIS2=4000), "according to its header"),
    "endless.fits": (lambda path: made_frames.write_fits(path, PLANE, NAXIS=10**11), "axes"),
    "far.fits": (lambda path: made_frames.write_fits(path, PLANE, NAXIS1="1E400"), "NAXIS1 = inf: must be a number"),
    "odd.fits": (lambda path: made_frames.write_fits(path, PLANE, BITPIX=64), "BITPIX = 64"),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTY)
def test_files_that_are_no_frames(tmp_path, name):
    write, why = FAULTY[name]
    write(tmp_path / name)
    with pytest.raises(ValueError, match=f"{name}: .*{why}"):
        read_plane(tmp_path / name, RawLayout.parse("u16,50x41"))


def test_what_is_missing_is_named(tmp_path, monkeypatch):
    (tmp_path / "a.bin").write_bytes(b"0000")
    with pytest.raises(ValueError, match=r"--raw-layout PACKING,WIDTHxHEIGHT \(packing: u8, u16, mipi10"):
        read_plane(tmp_path / "a.bin")
    monkeypatch.setitem(__import__("sys").modules, "rawpy", None)
    (tmp_path / "a.cr2").write_bytes(b"II*\0")
    with pytest.raises(ValueError, match=r"pip install 'blurnoise\[raw\]'"):
        read_plane(tmp_path / "a.cr2")
