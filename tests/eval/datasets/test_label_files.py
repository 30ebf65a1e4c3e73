"""COCO's instances, BDD100K's frames and PP-OCR's texts: what becomes of sound files."""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest
import yaml
from blurnoise_eval.datasets import UnreadablePicture, bdd, coco, texts, write_picture, yolo

ANNOTATION = {"image_id": 7, "category_id": 13, "bbox": [1, 2, 3, 4]}
BOX = {"x1": 10, "y1": 20, "x2": 40.5, "y2": 60}
CORNERS = [[10, 20], [50, 22], [50, 40], [10, 38]]


def write(path, data):
    path.write_text(data if isinstance(data, str) else json.dumps(data), encoding="utf-8")
    return path


def instances(path, **changes):
    """A COCO file of three pictures: two objects, a crowd and two empty boxes; nothing; one small sign."""
    names = ["a.png", "b.png", "sub/c.png"]
    boxes = [
        ([10, 20, 30, 40.5], 13, 0),
        ([0, 0, 100, 200], 1, 0),
        ([0, 0, 50, 50], 1, 1),
        ([5, 5, 0, 9], 1, 0),
    ]
    annotations = [
        {"image_id": 7, "category_id": number, "bbox": box, "iscrowd": crowd} for box, number, crowd in boxes
    ]
    data: dict[str, Any] = {
        "images": [{"id": number, "file_name": name} for number, name in enumerate(names, start=7)],
        "categories": [{"id": 13, "name": "stop sign"}, {"id": 1, "name": "person"}],
        "annotations": [*annotations, {"image_id": 9, "category_id": 13, "bbox": [1, 2, 10, 10]}],
    }
    return write(path / "instances.json", {**data, **changes})


def test_coco_boxes_become_targets(tmp_path):
    found = coco(instances(tmp_path))
    a, b, c = found
    assert (found.kind, [picture.name for picture in found]) == ("coco", ["a.png", "b.png", "sub/c.png"])
    assert [picture.image_id for picture in found] == [7, 8, 9]
    assert found.categories == {"stop sign": 13, "person": 1}
    assert [(target.label, target.box_xyxy, target.crowd) for target in a.targets or ()] == [
        ("stop sign", (10.0, 20.0, 40.0, 60.5), False),
        ("person", (0.0, 0.0, 100.0, 200.0), False),
        ("person", (0.0, 0.0, 50.0, 50.0), True),
    ]
    assert [target.group for target in (*(a.targets or ()), *(c.targets or ()))] == [
        f"objects, {size}"
        for size in ("medium (32-96 px)", "large (> 96 px)", "medium (32-96 px)", "small (< 32 px)")
    ]
    assert b.targets == ()  # annotated as holding nothing, which differs from not annotated
    assert found.notes == ("1 box without area left out",)


def test_coco_keeps_what_an_annotation_says(tmp_path):
    """Ids that COCO's tools could not use, or that occur before, are forgotten; the targets stay, with a note."""
    beside = {"segmentation": [[1, 2, 4, 2, 4, 6]], "score": 0.5, "iscrowd": 0, "area": 6}
    entries = [{**ANNOTATION, **beside, "id": entry_id} for entry_id in (5, 5, 0, "x", 2**70, 6)]
    found = coco(instances(tmp_path, annotations=entries))
    targets = found.pictures[0].targets or ()
    assert found.notes[0].endswith("as a target of its own: 1")
    kept = [dict(target.annotation) for target in targets]
    assert kept == [{**beside, "id": 5}, *[beside] * 4, {**beside, "id": 6}]


def test_coco_boxes_that_cannot_be_found_are_counted(tmp_path):
    """In a picture of 100 x 80 px: four beyond its sides, three across them, two of no number, one too far
    away, one of no size."""
    outside = [[100, 0, 5, 5], [-5, 0, 5, 5], [0, 80, 5, 5], [0, -9, 5, 5]]
    across = [[99, 0, 5, 5], [-4.5, -4.5, 5, 5], [0, 79.5, 500, 500]]
    odd = [[1, 2, float("nan"), 4], [float("-inf"), 2, float("inf"), 4], [-2e6, 0, 3e6, 9], [1, 2, -3, 4]]
    entries = [{**ANNOTATION, "bbox": box} for box in (*outside, *across, *odd)]
    image = {"id": 7.0, "file_name": "a.png"}
    sized = [{**image, "width": 100, "height": 80}]
    found = coco(instances(tmp_path, images=sized, annotations=[*entries, {**ANNOTATION, "image_id": 99}]))
    placed = [target.box_xyxy[:2] for target in found.pictures[0].targets or ()]
    assert placed == [(99.0, 0.0), (-4.5, -4.5), (0.0, 79.5)]
    assert found.notes == (
        "4 boxes outside the picture left out",
        "3 boxes with coordinates that are not finite or beyond 1e6 px left out",
        "1 box without area left out",
        "1 box of pictures that are not in images left out",
        "doubtful labels: 9 of 9 boxes end outside of their picture or have no area: another size of the "
        "pictures? They are read as x, y, width, height",
    )
    # unknown: nothing is outside
    for size in ({}, {"width": None, "height": None}, {"width": 0, "height": 0}):
        file = instances(tmp_path, images=[{**image, **size}], annotations=entries)
        assert len(coco(file).pictures[0].targets or ()) == 7


def test_labels_choose_pictures_and_name_groups(tmp_path):
    """Crowds alone are no reason to look at a picture."""
    found = coco(instances(tmp_path), labels=["stop sign"])
    assert ([picture.name for picture in found], found.chosen) == (["a.png", "sub/c.png"], "stop sign")
    assert [target.group for picture in found for target in picture.targets or ()] == [
        "stop sign, medium (32-96 px)",
        "stop sign, small (< 32 px)",
    ]
    kept = coco(instances(tmp_path), labels=["stop sign"], keep_empty=True)
    assert (len(kept), kept.chosen) == (3, "stop sign, pictures without targets")
    crowd = {**ANNOTATION, "image_id": 8, "iscrowd": 1}
    file = instances(tmp_path, annotations=[ANNOTATION, crowd])
    assert [picture.name for picture in coco(file, labels=["stop sign"])] == ["a.png"]


@pytest.mark.parametrize("wrapped", [False, True])
def test_bdd_boxes_become_targets_under_their_own_names(tmp_path, wrapped):
    """Two boxes and a lane; nothing, in three ways of saying it."""
    labels = [
        {"id": "4", "category": "traffic sign", "box2d": BOX, "attributes": {"occluded": False}},
        {"category": "lane/road curb", "poly2d": [{"vertices": [[1, 2]]}]},
        {"category": "person", "box2d": {**BOX, "x1": 0}, "attributes": {"crowd": True}},
    ]
    frames = [
        {"name": "b1c6.jpg", "attributes": {"weather": "rainy"}, "labels": labels},
        *({"name": "day/a.jpg", "labels": None}, {"name": "day/b.jpg"}, {"name": "day/c.jpg", "labels": []}),
    ]
    file = write(tmp_path / "det.json", {"frames": frames} if wrapped else frames)
    found = bdd(file)
    assert [picture.name for picture in found] == [frame["name"] for frame in frames]
    assert [picture.image_id for picture in found] == [1, 2, 3, 4]
    assert (found.kind, found.categories) == ("bdd", {"person": 1, "traffic sign": 2})
    sign, person = found.pictures[0].targets or ()
    assert (sign.label, sign.box_xyxy, sign.crowd) == ("traffic sign", (10.0, 20.0, 40.5, 60.0), False)
    assert sign.annotation == {"attributes": {"occluded": False}}
    assert (person.label, person.crowd) == ("person", True)
    assert [picture.targets for picture in found.pictures[1:]] == [(), (), ()]
    (picture,) = bdd(file, labels=["traffic sign"])
    assert [target.group for target in picture.targets or ()] == ["traffic sign, medium (32-96 px)"]


def test_whole_pictures_are_read(tmp_path):
    for name, height in (("a.png", 15), ("sub/b.png", 16), ("c.png", 63), ("d.png", 64)):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        write_picture(tmp_path / name, np.zeros((height, 200), np.uint8))
    lines = [
        "\ufeffa.png\tSTOP\r",
        "sub/b.png\tzwei Wörter\tund <b>",
        "",
        "c.png\t",
        "d.png\t[1]",
        "no.png\tSTOP",
    ]
    found = texts(write(tmp_path / "gt.txt", "\n".join(lines)))
    assert (found.kind, found.categories, found.notes) == ("text", {"text": 1}, ())
    targets = [target for picture in found for target in picture.targets or ()]
    assert [target.text for target in targets] == ["STOP", "zwei Wörter\tund <b>", "", "[1]"]
    assert [target.group for target in targets] == [
        f"text, height {span} px" for span in ("< 16", "16-32", "32-64", "> 64")
    ]
    assert (targets[0].label, targets[0].box_xyxy) == ("text", (0.0, 0.0, 200.0, 15.0))
    assert [picture.image_id for picture in found] == [1, 2, 3, 4, 5]
    assert found.pictures[4].targets == ()
    with pytest.raises(UnreadablePicture, match=r"no\.png"):
        found.pictures[4].load()


def test_places_are_boxes_around_their_points(tmp_path):
    listed = [
        {"transcription": "STOP", "points": CORNERS, "difficult": False},
        *({"transcription": mark, "points": CORNERS} for mark in ("###", "*")),
        {"transcription": "flat", "points": [[1, 1], [5, 1], [9, 1], [4, 1]]},
        {"transcription": "lost", "points": [[1, 1], [float("nan"), 1], [9, 9], [4, 5]]},
    ]
    found = texts(write(tmp_path / "gt.txt", f"a.png\t{json.dumps(listed)}\nb.png\t[]"))
    stop, *unreadable = found.pictures[0].targets or ()
    assert (stop.text, stop.box_xyxy, stop.crowd) == ("STOP", (10.0, 20.0, 50.0, 40.0), False)
    assert stop.group == "text, height 16-32 px"
    assert stop.annotation == {"points": CORNERS, "difficult": False}
    assert [target.crowd for target in unreadable] == [True, True]
    assert found.pictures[1].targets == ()
    assert found.notes == (
        "1 box without area left out",
        "1 box with coordinates that are not finite or beyond 1e6 px left out",
    )


# --- YOLO's text labels ---


NAMES = {0: "sign", 1: "<b>car</b>"}


def make(root, files):
    """Write a data set: text files, and pictures of (width, height) px."""
    for name, content in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if isinstance(content, str):
            path.write_text(content, encoding="utf-8")
        else:
            write_picture(path, np.zeros((content[1], content[0], 3), np.uint8))
    return root


def described(**entries):
    return yaml.safe_dump({"names": NAMES, **entries})


def only(targets):
    assert targets is not None
    (target,) = targets
    return target


def test_shares_become_pixels(tmp_path):
    """A box of 0.2 x 0.5 around (0.3, 0.5) of 200 x 80 px, and a triangle as the box around it."""
    make(
        tmp_path,
        {
            "data.yaml": described(val="images"),
            "images/a.png": (200, 80),
            "images/b.jpg": (64, 64),
            "labels/a.txt": "0 0.3 0.5 0.2 0.5\n\n1 0.5 0.25 0.75 0.5 0.625 0.75\r\n",
        },
    )
    found = yolo(tmp_path / "data.yaml")
    assert (found.kind, found.categories) == ("yolo", {"sign": 1, "<b>car</b>": 2})
    assert [(picture.image_id, picture.name) for picture in found] == [(1, "a.png"), (2, "b.jpg")]
    box, triangle = found.pictures[0].targets or ()
    assert (box.label, box.group) == ("sign", "objects, medium (32-96 px)")
    np.testing.assert_allclose(box.box_xyxy, (40, 20, 80, 60), atol=1e-9)
    assert triangle.label == "<b>car</b>"
    assert triangle.box_xyxy == (100.0, 20.0, 150.0, 60.0)
    assert found.pictures[1].targets == ()
    assert found.notes == ("pictures without a label file, used as pictures without objects: 1",)
    assert found.pictures[1].load().shape == (64, 64, 3)


@pytest.mark.parametrize("orientation", [5, 6, 7, 8])
def test_boxes_are_of_the_picture_as_it_is_shown(tmp_path, orientation):
    """A file of 40 x 20 px, held upright: the left half of what is seen is 10 x 40 px."""
    make(tmp_path, {"data.yaml": described(val="images"), "labels/a.txt": "0 0.25 0.5 0.5 1\n"})
    (tmp_path / "images").mkdir()
    exif = PIL.Image.Exif()
    exif[0x0112] = orientation
    PIL.Image.new("RGB", (40, 20)).save(tmp_path / "images" / "a.jpg", exif=exif)
    (picture,) = yolo(tmp_path)
    assert picture.load().shape == (40, 20, 3)
    assert only(picture.targets).box_xyxy == (0.0, 0.0, 10.0, 40.0)


LINE = "0 0.5 0.5 0.5 0.5\n"
LAYOUTS = {
    "coco8": {
        "data.yaml": described(path=".", train="images/train", val="images/val"),
        "images/train/t.png": (8, 8), "labels/train/t.txt": LINE,
        "images/val/v.png": (8, 8), "labels/val/v.txt": LINE,
    },
    "darknet": {
        "data.yaml": described(path="set", train="train.txt", val="val.txt"),
        "set/train.txt": "images/t.png\n", "set/val.txt": "./images/v.png\n\n",
        "set/images/t.png": (8, 8), "set/labels/t.txt": LINE, "set/images/v.png": (8, 8), "set/labels/v.txt": LINE,
    },
}  # fmt: skip


@pytest.mark.parametrize("layout", LAYOUTS)
def test_layouts(tmp_path, layout):
    make(tmp_path, LAYOUTS[layout])
    for path in (tmp_path, tmp_path / "data.yaml"):
        for split, stem in ((None, "v"), ("val", "v"), ("train", "t")):
            (picture,) = yolo(path, split=split)
            assert Path(picture.name).stem == stem
            assert only(picture.targets).box_xyxy == (2.0, 2.0, 6.0, 6.0)
            assert picture.load().shape == (8, 8, 3)


@pytest.mark.parametrize(
    "files",
    [
        {"labels/classes.txt": "\ufeffsign\r\ncar\r\n", "images/sub/a.png": (8, 8), "labels/sub/a.txt": LINE},
        {"classes.txt": "sign\n", "sub/a.png": (8, 8), "sub/a.txt": LINE},
        {"classes.txt": "sign\n", "images/sub/a.png": (8, 8), "images/sub/a.txt": LINE},
        {"data.yaml": described(), "images/sub/a.png": (8, 8), "labels/sub/a.txt": LINE},
        {"data.yaml": described(val=["images/sub"]), "images/sub/a.png": (8, 8), "labels/sub/a.txt": LINE},
    ],
)
def test_folders(tmp_path, files):
    (picture,) = yolo(make(tmp_path, files))
    assert picture.name in ("sub/a.png", "a.png")
    assert only(picture.targets).label == "sign"


def test_pictures_may_lie_elsewhere_where_the_user_says_so(tmp_path):
    make(tmp_path / "moved", {"images/a.png": (8, 8), "labels/a.txt": LINE})
    for path in ("/nowhere", "..", "../away", f"{tmp_path}/../away"):  # named by the file, not by the user
        make(tmp_path, {"data.yaml": described(path=path, val="images")})
        with pytest.raises(ValueError, match=r"leaves the folder .*images"):
            yolo(tmp_path / "data.yaml")
    assert len(yolo(tmp_path / "data.yaml", images=tmp_path / "moved" / "images")) == 1
    make(tmp_path, {"data.yaml": described(path=str(tmp_path / "moved"), val="images")})
    assert len(yolo(tmp_path / "data.yaml")) == 1


# --- files that are almost right, or nothing at all ---


IMAGE = {"id": 7, "file_name": "a.png", "width": 9, "height": 9}
SIGN = {"id": 1, "name": "sign"}
SOUND = {"id": 1, "image_id": 7, "category_id": 1, "bbox": [1, 2, 3, 4], "area": 9, "iscrowd": 0}
COCO: Any = {"images": [IMAGE], "categories": [SIGN], "annotations": [SOUND]}
TEXTS = [{"transcription": "STOP", "points": [[1, 2], [3, 2], [3, 4], [1, 4]]}]


def of_coco(part, **change):
    return {**COCO, part: [{**COCO[part][0], **change}]}


def of_text(**change):
    return f"a.png\t{json.dumps([{**TEXTS[0], **change}])}"


@pytest.fixture
def folder(tmp_path):
    write_picture(tmp_path / "a.png", np.zeros((9, 9), np.uint8))
    (tmp_path / "classes.txt").write_text("sign\ncar\n")
    return tmp_path


@pytest.mark.parametrize(
    ("read", "content", "fault"),
    [
        (coco, "", "not a COCO instances file"),
        (coco, {}, "has no 'images'"),
        (coco, {**COCO, "images": [IMAGE, IMAGE]}, "images: id = 7 occurs twice"),
        (coco, {**COCO, "images": [{"id": 1}]}, r"images\[0\]: has no 'file_name'"),
        (coco, {**COCO, "images": [], "annotations": []}, "contains no pictures"),
        (coco, of_coco("images", file_name="\ud800.png"), r"images\[0\]: file_name = .*: must be a valid string"),
        (coco, of_coco("images", file_name="sub/../../secret.png"), "leaves the folder"),
        (coco, of_coco("categories", name=None), r"categories\[0\]: name = None: must be a valid string"),
        (coco, of_coco("annotations", bbox=[1, 2, 3]), r"annotations\[0\]: bbox = \[1, 2, 3\]: must have at least 4"),
        (coco, of_coco("annotations", category_id=99), r"annotations\[0\]: category_id = 99: must be"),
        (bdd, {}, "frames = None: must be a list"),
        (bdd, [{"name": "a.jpg"}, {"name": "./a.jpg"}], r"'a\.jpg' is listed twice"),
        (bdd, [{"name": "a.jpg", "labels": [{"box2d": {"x1": 1}}]}], r"labels\[0\]: box2d: has no 'y1'"),
        (texts, "a.png STOP", "line 1: 'a.png STOP': must be the name of a picture, a tab"),
        (texts, "a.png\tA\n./a.png\tB", r"'a\.png' is listed twice"),
        (texts, f"{of_text()}\nb.png\tB", "line 2: is not a list of texts and points"),
        (texts, of_text(transcription=5), r"texts\[0\]: transcription = 5: must be a valid string"),
        (texts, of_text(points=[[1, 2]]), r"points = \[\[1, 2\]\]: must have at least 2 items"),
    ],
)  # fmt: skip
def test_the_fault_is_named(folder, read, content, fault):
    file = folder / "labels"
    file.write_text(content if isinstance(content, str) else json.dumps(content))
    with pytest.raises(ValueError, match=rf"^labels = '.*labels': .*{fault}") as caught:
        read(file)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ("0 0.5 0.5 0.5", "must be 'class x y width height' or"),
        ("2 0.5 0.5 0.5 0.5", "class = 2: must be one of the 2"),
        ("0 320 240 50 60", "not pixels"),
    ],
)
def test_a_bad_line_of_yolo_is_named(folder, line, fault):
    (folder / "a.txt").write_text(f"{LINE}\n{line}\n")
    with pytest.raises(ValueError, match=rf"labels = .*a\.txt': line 3: .*{fault}") as caught:
        yolo(folder)
    assert "\n" not in str(caught.value)


def data_yaml(**entries):
    return yaml.safe_dump({"names": ["sign"], **entries})


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        (None, "data.yaml, obj.data or classes.txt"),
        ("names: [", "while parsing"),
        ("!!python/object:os.system {}", "constructor"),
        ("val: images", "has no 'names'"),
        ("names: {zero: sign}", "names: zero: .*must be a valid integer"),
        # which YAML takes for truth values
        ("names: [yes, no]", r"names\[0\] = True: must be a valid string"),
        (data_yaml(val="missing"), "missing': no such folder or list"),
        (data_yaml(val="list.txt"), r"list\.txt': line 1: .*leaves the folder"),
        (data_yaml(val="."), "none of the 1 pictures in .* has a label file"),
        (data_yaml(kpt_shape=[17, 3]), "poses"),
    ],
)
def test_what_is_no_data_set_of_yolo_is_named(folder, content, fault):
    (folder / "list.txt").write_text("../secret.png")
    (folder / "classes.txt").unlink()
    if content is not None:
        (folder / "data.yaml").write_text(content)
    with pytest.raises(ValueError, match=rf"labels = .*{fault}") as caught:
        yolo(folder)
    assert "\n" not in str(caught.value)


def test_files_that_are_none(folder):
    (folder / "binary").write_bytes(b"\xff\xfe\x00\x01")
    os.mkfifo(folder / "pipe")
    faults = {
        "binary": "not UTF-8",
        "nothing": "No such file",
        ".": "is a folder",
        "pipe": "pipe; must be a file",
    }
    for read in (coco, bdd, texts, yolo):
        for name, fault in faults.items():
            if (read, name) != (yolo, "."):
                with pytest.raises(ValueError, match=f"{name.strip('.')}'.*{fault}"):
                    read(folder / name)
    with pytest.raises(ValueError, match="split 'test' = None"):
        yolo(folder, split="test")
