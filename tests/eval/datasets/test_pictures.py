"""Pictures as they come, in files and folders: depths, orientations, sizes, transparency, all that can be wrong."""

import hashlib
import os
import struct
import zlib

import cv2
import numpy as np
import PIL.Image
import pytest
from blurnoise_eval.datasets import (
    Picture,
    PictureSet,
    UnreadablePicture,
    bdd,
    coco,
    decode,
    decode_any,
    eight_bit,
    image_folder,
    read_picture,
    sample,
    size_group,
    write_light,
    write_picture,
)
from blurnoise_eval.datasets.likeness import perceptual_hash, scenes
from numpy.typing import NDArray

from blurnoise import Scene

ORIENTATION = 0x0112


def pixels(shape, dtype=np.uint8):
    return np.random.default_rng(0).integers(0, np.iinfo(dtype).max, shape, dtype, endpoint=True)


def png(width, height, rows=b"0"):
    """A grey PNG of 8 bits, whose pixels may be missing."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def saved(path, picture, orientation=1, **options):
    exif = PIL.Image.Exif()
    exif[ORIENTATION] = orientation
    PIL.Image.fromarray(picture).save(path, exif=exif, **options)
    return path


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("shape", [(5, 7), (5, 7, 3)])
@pytest.mark.parametrize("suffix", [".png", ".TIFF"])
def test_written_pictures_come_back(tmp_path, dtype, shape, suffix):
    picture = pixels(shape, dtype)
    path = tmp_path / f"picture{suffix}"
    write_picture(path, picture)
    again = decode(path)
    assert again.dtype == dtype
    np.testing.assert_array_equal(again, picture)
    colour = read_picture(path)
    assert colour.shape == (*shape[:2], 3)
    np.testing.assert_array_equal(colour[..., 1], picture if picture.ndim == 2 else picture[..., 1])
    assert sorted(entry.name for entry in tmp_path.iterdir()) == [".blurnoise", path.name]


@pytest.mark.parametrize(
    ("orientation", "turned"),
    [
        (2, lambda a: a[:, ::-1]),
        (3, lambda a: a[::-1, ::-1]),
        (6, lambda a: np.rot90(a, -1)),  # the camera was held upright: turn clockwise
        (8, lambda a: np.rot90(a, 1)),
    ],
)
def test_exif_orientation(tmp_path, orientation, turned):
    quadrants = np.kron(np.array([[0, 80], [160, 240]], np.uint8), np.ones((16, 32), np.uint8))
    seen = decode(saved(tmp_path / "turned.jpg", quadrants, orientation, quality=100))
    expected = turned(quadrants)
    assert seen.shape == expected.shape
    assert np.abs(seen.astype(int) - expected).max() <= 2  # of 255: JPEG's rounding


def test_size_groups_follow_the_area():
    for width, height, group in (
        (31, 33, "small"),
        (32, 32, "medium"),
        (95, 97, "medium"),
        (96, 96, "large"),
    ):
        assert size_group(width, height, "sign").startswith(f"sign, {group}")


def test_unreadable_pictures_say_why(tmp_path):
    jpeg = cv2.imencode(".jpg", pixels((64, 64, 3)))[1].tobytes()
    cv2.imwrite(str(tmp_path / "float.tiff"), np.zeros((4, 4, 3), np.float32))
    (tmp_path / "folder.png").mkdir()
    contents = {
        "empty.png": b"",
        "text.jpg": b"text\n",
        "cut.jpg": jpeg[:500],
        "bomb.png": png(100_000, 100_000),
    }
    for name, data in contents.items():
        (tmp_path / name).write_bytes(data)
    os.mkfifo(tmp_path / "pipe.png")
    for name, fault in {
        **dict.fromkeys((*contents, "float.tiff"), "an 8- or 16-bit"),
        "empty.png": "0 bytes", "missing.png": "No such file", "folder.png": "is a folder",
        "bomb.png": "at most 178 megapixels", "pipe.png": "pipe; must be a file",
    }.items():  # fmt: skip
        with pytest.raises(UnreadablePicture, match=f"{name}: .*{fault}"):
            decode(tmp_path / name)


@pytest.mark.parametrize("orientation", [1, 4, 5, 8])
def test_labels_are_for_the_upright_picture(tmp_path, orientation):
    saved(tmp_path / "a.jpg", pixels((21, 33, 3)), orientation)
    width, height = (21, 33) if orientation > 4 else (33, 21)
    other = {"width": height, "height": width}
    for size in ({}, {"width": width, "height": height}, other):
        frames = [{"name": "a.jpg", "size": size, "labels": []}]
        images = [{"id": 1, "file_name": "a.jpg", **size}]
        document = {"images": images, "categories": [], "annotations": []}
        (tmp_path / "bdd.json").write_text(str(frames).replace("'", '"'))
        (tmp_path / "coco.json").write_text(str(document).replace("'", '"'))
        for (picture,) in (bdd(tmp_path / "bdd.json"), coco(tmp_path / "coco.json")):
            if size is not other:
                assert picture.load().shape == (height, width, 3)
                continue
            said = rf"a\.jpg: {width} x {height} px .* labels are for {height} x {width} \(turned: "
            with pytest.raises(UnreadablePicture, match=said):
                picture.load()


def test_a_folder_is_read_in_order_and_below(tmp_path):
    """What is no file is passed: a circle of folders, links to nowhere."""
    (tmp_path / "sub").mkdir()
    for name in ("b.png", "a.JPG", "sub/<c>.tiff"):
        write_picture(tmp_path / name, pixels((4, 6, 3)))
    (tmp_path / "notes.txt").write_text("no picture")
    (tmp_path / "empty.png").write_bytes(b"")
    (tmp_path / "link.png").symlink_to(tmp_path / "b.png")
    (tmp_path / "loop.png").symlink_to(tmp_path / "loop.png")
    (tmp_path / "again").symlink_to(tmp_path)
    found = image_folder(tmp_path)
    names = ["a.JPG", "b.png", "empty.png", "link.png", "sub/<c>.tiff"]
    assert [(picture.image_id, picture.name) for picture in found] == list(enumerate(names, start=1))
    assert all(picture.targets is None for picture in found)
    assert found.pictures[3].load().shape == (4, 6, 3)
    with pytest.raises(UnreadablePicture, match="0 bytes"):
        found.pictures[2].load()
    before = [picture.identity for picture in found]
    assert [picture.identity for picture in image_folder(tmp_path)] == before
    write_picture(tmp_path / "b.png", pixels((9, 9)))
    assert [picture.identity for picture in image_folder(tmp_path)][1] != before[1]


# --- linear light ---

LIGHT = np.random.default_rng(3).uniform(0, 60, (7, 11, 3)).astype(np.float32)
LIGHT[0, :4] = (0.0, 0.5, 1.0)


@pytest.mark.parametrize("name", ["a.tiff", "a.hdr", "a.exr"])
def test_a_set_holds_light_above_white(tmp_path, name):
    """As floats, with a note, not clipped; for the eye up to white, as sRGB."""
    if name.endswith(".exr"):
        header = {"compression": openexr().ZIP_COMPRESSION, "type": openexr().scanlineimage}
        openexr().File(header, {"RGB": LIGHT}).write(str(tmp_path / name))
    else:
        write_light(tmp_path / name, LIGHT)
    found = image_folder(tmp_path)
    assert found.notes == (
        f"{name} holds floats: linear light, of which 1 is white and more is brighter than white",
    )
    loaded = found.pictures[0].load()
    # Radiance has one exponent for three colours of 8 bits
    np.testing.assert_allclose(loaded, LIGHT, atol=64 / 256 if name == "a.hdr" else 0)
    scene = Scene.of_picture(loaded).light
    np.testing.assert_array_equal(scene[0].permute(1, 2, 0).numpy(), loaded)
    coded = eight_bit(loaded)
    assert coded.max() == 255
    assert coded[0, 0].tolist() == [0, 188, 255]
    assert [light.shape for _, light in sample(found, 3)] == [LIGHT.shape]
    assert sample(found, 3, light=False) == []


def openexr():
    return pytest.importorskip("OpenEXR")


def test_light_has_a_hash_of_its_look(tmp_path):
    bright = np.kron(np.random.default_rng(1).uniform(0, 1, (9, 9)), np.ones((9, 9)))[..., None].repeat(3, 2)
    coded = eight_bit(bright.astype(np.float32))
    assert perceptual_hash(bright.astype(np.float32)) == perceptual_hash(coded) != ""


def test_light_of_openexr(tmp_path):
    openexr = pytest.importorskip("OpenEXR")
    light = np.random.default_rng(3).uniform(0, 60, (7, 11, 3)).astype(np.float16)
    path = tmp_path / "a.exr"

    def saved_light(**planes):
        header = {"compression": openexr.ZIP_COMPRESSION, "type": openexr.scanlineimage}
        openexr.File(header, planes).write(str(path))
        return path

    grey = light[..., 0].copy()
    np.testing.assert_array_equal(decode_any(saved_light(RGB=light, Z=grey)), light.astype(np.float32))
    np.testing.assert_array_equal(decode_any(saved_light(Y=grey)), grey.astype(np.float32))
    with pytest.raises(UnreadablePicture, match="11 x 7 px"):
        decode_any(path, 1e-5)
    with pytest.raises(UnreadablePicture, match=r"a\.exr: holds floats, .* must be an 8- or 16-bit picture"):
        decode(path)
    faulty = (
        ({"Z": grey}, "must have R, G, B or Y"),
        ({"Y": -grey}, "negative or infinite"),
        ({"Y": grey.astype(np.uint32)}, "the channels Y are UINT, of numbers such as object ids, not light"),
        ({"RGB": light.astype(np.uint32)}, "the channels B, G, R are UINT"),
    )
    for planes, fault in faulty:
        with pytest.raises(UnreadablePicture, match=fault):
            decode_any(saved_light(**planes))
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(UnreadablePicture, match=r"a\.exr"):
        decode_any(path)


# --- pictures of one scene, by their hashes ---


Pixels = NDArray[np.uint8]


def scene(seed, size=(213, 320)):
    """Smooth random light with a spectrum as photographs have it, in colour."""
    rng = np.random.default_rng([seed, 1])
    layers = [
        cv2.resize(rng.normal(size=(n, n, 3)), size[::-1], interpolation=cv2.INTER_CUBIC) / n
        for n in (3, 6, 12)
    ]
    whole = sum(layers)
    return np.clip(128 + 45 * whole / np.std(whole), 0, 255).astype(np.uint8)


def again(picture, rng):
    """The same shifted by up to a fiftieth of the width, at half to 1.6 times the light, with 4 % noise."""
    height, width = picture.shape[:2]
    dx, dy = rng.integers(-width // 80, width // 80 + 1, 2).tolist()
    shift = np.array([[1, 0, dx], [0, 1, dy]], np.float32)
    moved = cv2.warpAffine(picture, shift, (width, height), borderMode=cv2.BORDER_REFLECT) / 255
    lit = np.clip(moved**2.2 * 2 ** rng.uniform(-1, 0.7), 0, 1) ** (1 / 2.2)
    return np.clip(255 * lit + rng.normal(0, 10, lit.shape), 0, 255).astype(np.uint8)


def test_pictures_of_one_scene_are_found_together():
    rng = np.random.default_rng(0)
    found = scenes([perceptual_hash(again(scene(place // 5), rng)) for place in range(60)])
    together = np.arange(60) // 5
    assert (found[:, None] == found)[together[:, None] != together].sum() == 0
    assert 12 <= len(set(found.tolist())) <= 14


def test_links_make_a_scene():
    """a and c are 16 bits apart, and b is between them; d is far from all."""
    a, b, c, d = "00" * 8, "ff" + "00" * 7, "ffff" + "00" * 6, "0f" * 8
    assert scenes([a, d, c, b]).tolist() == [0, 1, 0, 0]
    assert scenes([a, d, c]).tolist() == [0, 1, 2]
    assert scenes([]).tolist() == []


@pytest.mark.parametrize(
    ("text", "named"),
    [(text, "must be K/N") for text in ("0/4", "5/4", "1", "a/b", "1/0", "-1/2")]
    + [("1/9999", "none of the 3")],
)
def test_parts_that_are_none(text, named):
    few = PictureSet("folder", "", tuple(Picture(f"{number}.png", (), list, "") for number in range(3)))
    with pytest.raises(ValueError, match=named):
        few.part(text)


def test_parts_have_every_picture_once_and_depend_on_its_name_alone():
    every = PictureSet("folder", "", tuple(Picture(f"{number}.png", (), list, "") for number in range(400)))
    parts = [[picture.name for picture in every.part(f"{number}/4")] for number in (1, 2, 3, 4)]
    assert sorted(name for part in parts for name in part) == sorted(picture.name for picture in every)
    assert min(map(len, parts)) > 70  # binomial, n = 400, p = 1/4: 100 - 3.5 sd of 8.7
    assert every.part("1/4").every is every
    # the hash of a name never changes: machines of any version agree on the parts
    digest = hashlib.blake2b(b"3.png", digest_size=8).digest()
    assert "3.png" in parts[int.from_bytes(digest, "little") % 4]
