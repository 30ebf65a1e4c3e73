"""Labels as the tools write them: one object, 60 x 60 px at (50, 30) of pictures of 160 x 120 px, in every layout."""

import json
from itertools import chain
from pathlib import Path
from typing import Any

import blurnoise_models
import numpy as np
import pytest
from blurnoise_eval import label_formats
from blurnoise_eval.cli import main
from blurnoise_eval.datasets import PictureSet, rendered_signs, write_picture
from blurnoise_eval.datasets.folder import Listed
from blurnoise_eval.datasets.selection import Selection
from blurnoise_eval.label_formats import LABEL_FORMATS, LabelFormat, format_of
from blurnoise_eval.run.run import Run

BOX = (50.0, 30.0, 110.0, 90.0)
LINE = "0 0.5 0.5 0.375 0.5\n"
PICTURE = None  # as the content of a file


def coco(*names, **annotation):
    """An instances file; annotation: fields of each object's."""
    images = [
        {"id": n, "file_name": name, "width": 160, "height": 120} for n, name in enumerate(names, start=1)
    ]
    own = {"category_id": 1, "bbox": [50, 30, 60, 60], "area": 3600, "iscrowd": 0, **annotation}
    annotations = [{"id": image["id"], "image_id": image["id"], **own} for image in images]
    return json.dumps(
        {"images": images, "annotations": annotations, "categories": [{"id": 1, "name": "ball"}]}
    )


def xml(filename, *, database="Unknown", corners=(50, 30, 110, 90), beside=""):
    """An annotation of one object."""
    sides = "".join(
        f"<{name}>{n}</{name}>" for name, n in zip(("xmin", "ymin", "xmax", "ymax"), corners, strict=True)
    )
    return (
        f"<annotation><folder>x</folder><filename>{filename}</filename><source><database>{database}</database></source>"
        "<size><width>160</width><height>120</height><depth>3</depth></size>"
        f"<object><name>ball</name>{beside}<bndbox>{sides}</bndbox></object></annotation>"
    )


def scalabel(**frame):
    corners = dict(zip(("x1", "y1", "x2", "y2"), BOX, strict=True))
    labels = [{"id": "1", "category": "ball", "box2d": corners}]
    return json.dumps(
        {"frames": [{"name": "a.png", "labels": labels, **frame}], "groups": None, "config": None}
    )


OBJ_DATA = {
    "obj.data": "classes = 1\ntrain = data/train.txt\nnames = data/obj.names\nbackup = backup/\n",
    "obj.names": "ball\n", "train.txt": "data/obj_train_data/a.png\n", "obj_train_data/a.txt": LINE,
}  # fmt: skip
TOOLS: dict[str, tuple[dict[str, Any], str]] = {
    "CVAT 2, YOLO 1.1": ({**OBJ_DATA, "obj_train_data/a.png": PICTURE}, "obj.data"),
    "CVAT 2, YOLO 1.1, the folder": ({**OBJ_DATA, "obj_train_data/a.png": PICTURE}, ""),
    "CVAT 2, YOLO 1.1, its list": ({**OBJ_DATA, "obj_train_data/a.png": PICTURE}, "train.txt"),
    "CVAT 2, Ultralytics YOLO": (
        {"data.yaml": "path: .\ntrain: train.txt\nnames: {0: ball}\n", "train.txt": "data/images/train/a.png\n",
         "images/train/a.png": PICTURE, "labels/train/a.txt": LINE}, "data.yaml"),
    "CVAT 2, PASCAL VOC 1.1": (
        {"Annotations/a.xml": xml("a.png", corners=(50.0, 30.0, 110.0, 90.0), beside="<difficult>0</difficult>"),
         "JPEGImages/a.png": PICTURE, "ImageSets/Main/default.txt": "a\n", "labelmap.txt": "ball:::\n"}, ""),
    "CVAT 2, COCO 1.0": ({"annotations/instances_default.json": coco("a.png"), "images/a.png": PICTURE},
                         "annotations/instances_default.json"),
    "Roboflow, YOLOv8, exported": (
        {"data.yaml": "train: ../train/images\nval: ../valid/images\nnc: 1\nnames: ['ball']\n",
         "valid/images/a.png": PICTURE, "valid/labels/a.txt": LINE}, "data.yaml"),
    "Roboflow, YOLOv8, downloaded": (
        {"data.yaml": "train: project-1/train/images\nval: project-1/valid/images\nnames: ['ball']\n",
         "valid/images/a.png": PICTURE, "valid/labels/a.txt": LINE}, "data.yaml"),
    "Roboflow, YOLOv8, from Colab": (
        {"data.yaml": "val: /content/datasets/project-1/valid/images\nnames: ['ball']\n",
         "valid/images/a.png": PICTURE, "valid/labels/a.txt": LINE}, "data.yaml"),
    "Roboflow, Darknet": ({"_darknet.labels": "ball\n", "a.png": PICTURE, "a.txt": LINE}, ""),
    "Roboflow, Pascal VOC": (
        {"valid/a.png": PICTURE, "valid/a.xml": xml("a.png", database="roboflow.com")}, ""),
    "Roboflow, COCO": (
        {"valid/_annotations.coco.json": coco("a.png"), "valid/a.png": PICTURE}, "valid/_annotations.coco.json"),
    "LabelImg 1.8, Pascal VOC": (
        {"a.xml": xml("a.jpg", beside="<pose>Unspecified</pose><difficult>0</difficult>"), "a.png": PICTURE}, ""),
    "LabelImg 1.8, packed by macOS": ({"a.xml": xml("a.png"), "._a.xml": "\0\5", "a.png": PICTURE}, ""),
    "LabelImg 1.8, one file": ({"a.xml": xml("a.png"), "a.png": PICTURE}, "a.xml"),
    "LabelImg 1.8, YOLO": ({"classes.txt": "ball\n", "a.txt": LINE, "a.png": PICTURE}, ""),
    "Label Studio 2, COCO": ({"result.json": coco("images\\a.png"), "images/a.png": PICTURE}, "result.json"),
    "Label Studio 2, YOLO": (
        {"classes.txt": "ball\n", "notes.json": "{}", "images/a.png": PICTURE, "labels/a.txt": LINE}, ""),
    "FiftyOne 1, COCO": ({"labels.json": coco("a.png", iscrowd=0.0), "data/a.png": PICTURE}, "labels.json"),
    "FiftyOne 1, YOLOv5": (
        {"dataset.yaml": "names: {0: ball}\nval: ./images/val/\n", "images/val/a.png": PICTURE,
         "labels/val/a.txt": LINE}, ""),
    "FiftyOne 1, VOC": ({"labels/a.xml": xml("a.png"), "data/a.png": PICTURE}, ""),
    "supervision 0.31, VOC": (
        {"a.xml": xml("a.png", database="roboflow.ai", corners=(51, 31, 110, 90)), "a.png": PICTURE}, ""),
    "the VOC challenge": (
        {"VOC2007/Annotations/a.xml": xml("a.png", database="The VOC2007 Database", corners=(51, 31, 110, 90)),
         "VOC2007/JPEGImages/a.png": PICTURE}, ""),
    "Ultralytics 8, lists": (
        {"data.yaml": "path: ../datasets/set\nval: val.txt\nnames: [ball]\n", "val.txt": "./images/a.png\n",
         "images/a.png": PICTURE, "labels/a.txt": LINE * 2}, "data.yaml"),
    "X-AnyLabeling 4, COCO": ({"a.json": coco("a.png", ignore=0), "a.png": PICTURE}, "a.json"),
    "paths of another Windows": (
        {"a.json": coco("C:\\Users\\ann\\set\\images\\a.png"), "images/a.png": PICTURE}, "a.json"),
    "labelme2coco 0.2": ({"runs.json": coco("work/labelme/a.png"), "labelme/a.png": PICTURE}, "runs.json"),
    "another machine's paths": ({"a.json": coco("/home/ann/set/images/a.png"), "images/a.png": PICTURE}, "a.json"),
    "Scalabel 0.3, tracking": ({"labels.json": scalabel(videoName="v1"), "v1/a.png": PICTURE}, "labels.json"),
    "Scalabel 0.3, tracking, flat": ({"labels.json": scalabel(videoName="v1"), "a.png": PICTURE}, "labels.json"),
    "BDD100K": ({"det.json": scalabel(attributes={"weather": "clear"}), "a.png": PICTURE}, "det.json"),
    "an archive of macOS": (
        {"data.yaml": "val: images\nnames: [ball]\n", "images/a.png": PICTURE, "images/._a.png": "\0\5",
         ".DS_Store": "\0", "labels/a.txt": LINE, "labels/._a.txt": "\0\5", "__MACOSX/._a.png": "\0"}, "data.yaml"),
}  # fmt: skip


def written(folder, files):
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if content is PICTURE:
            write_picture(path, np.full((120, 160, 3), 9, np.uint8))
        else:
            path.write_text(content)
    return folder


def opened(folder, files, labels) -> PictureSet:
    place = written(folder, files) / labels
    found: PictureSet = format_of(place).open(place)
    return found


@pytest.mark.parametrize("tool", TOOLS)
def test_each_tool_is_read(tmp_path, tool):
    found = opened(tmp_path, *TOOLS[tool])
    (picture,) = found
    assert picture.load().shape == (120, 160, 3)
    (target,) = picture.targets or ()
    assert target.label == "ball"
    assert not target.crowd
    assert target.box_xyxy == pytest.approx(BOX)
    assert not [note for note in found.notes if note.startswith("doubtful")]


def test_cvat_without_its_pictures(tmp_path):
    """Exported alone; the pictures are elsewhere."""
    place = written(tmp_path / "set", OBJ_DATA) / "obj.data"
    (picture,) = format_of(place).open(place, images=written(tmp_path / "photos", {"a.png": PICTURE}))
    assert [target.box_xyxy for target in picture.targets or ()] == [BOX]


@pytest.mark.parametrize(
    ("line", "count"),
    [("a.png\t[]", 0), ("a.png\t [{}]", 1), ("a.png\t[ {}]", 1), ("images\\a.png\t[{}]", 1)],
)
def test_ocr_lists_are_known_by_their_json(tmp_path, line, count):
    """Also after a space, where no picture has a text, and with paths of Windows."""
    points = '{"transcription": "GO", "points": [[50, 30], [110, 30], [110, 90], [50, 90]]}'
    text = f"{line.replace('{}', points)}\n"
    files = {"Label.txt": text, "a.png": PICTURE, "images/a.png": PICTURE}
    found = opened(tmp_path, files, "Label.txt")
    assert [target.box_xyxy for target in found.pictures[0].targets or ()] == [BOX] * count
    assert found.pictures[0].load().shape == (120, 160, 3)


@pytest.mark.parametrize(
    "name", ["../secret.png", "C:\\secret.png", "/etc/secret.png", "..\\..\\secret.png", "/x/a.png"]
)
def test_nothing_leaves_the_folder(tmp_path, name):
    """Not even where the picture is there; and a path with two ends in the folder is none."""
    files = {"secret.png": PICTURE, "set/x/a.png": PICTURE, "set/a.png": PICTURE, "set/coco.json": coco(name)}
    with pytest.raises(ValueError, match="leaves the folder"):
        opened(tmp_path, files, "set/coco.json")


def test_absolute_paths_into_the_own_folder(tmp_path):
    listed = coco(f"{tmp_path}/images/a.png", "/old/images/b.png", "/old/images/c.png")
    files = {"coco.json": listed, "images/a.png": PICTURE, "images/b.png": PICTURE}
    found = opened(tmp_path, files, "coco.json")
    # the last is missing
    assert [picture.name for picture in found] == ["images/a.png", "images/b.png", "images/c.png"]
    assert "paths of another folder, whose ends are files of this one and are read: 1" in found.notes


@pytest.mark.parametrize(
    ("value", "crowd"),
    [
        ("0", False),
        ("false", False),
        (0.0, False),
        (None, False),
        ("1", True),
        ("True", True),
        (1.0, True),
        (True, True),
    ],
)
def test_flags_are_read_as_they_say(tmp_path, value, crowd):
    """Of every format that has some; what is no flag is an error of one line."""
    marks = {"attributes": {"crowd": value, "ignored": None, "occluded": "maybe"}}
    label = {"category": "ball", "box2d": dict(zip(("x1", "y1", "x2", "y2"), BOX, strict=True)), **marks}
    difficult = "" if value is None else f"<difficult>{str(value).lower()}</difficult>"
    for name, files in {
        "coco.json": {"coco.json": coco("a.png", iscrowd=value)},
        "bdd.json": {"bdd.json": json.dumps([{"name": "a.png", "labels": [label]}])},
        "a.xml": {"a.xml": xml("a.png", beside=difficult)},
    }.items():
        found = opened(tmp_path, {**files, "a.png": PICTURE}, name)
        (target,) = found.pictures[0].targets or ()
        assert target.crowd is crowd, name
        doubt = "doubtful labels: 1 of 1 targets are crowds, which are neither missed nor wrong"
        assert (doubt in found.notes) is crowd


@pytest.mark.parametrize("value", ["maybe", 2, [], {}, "", float("nan")])
def test_what_is_no_flag_is_named(tmp_path, value):
    with pytest.raises(ValueError, match=r"annotations\[0\]: iscrowd"):
        opened(tmp_path, {"coco.json": coco("a.png", iscrowd=value)}, "coco.json")


NOT_READ: dict[str, tuple[str, str, str]] = {
    "CVAT": (
        "a.xml",
        '<?xml version="1.0"?>\n<annotations><version>1.1</version></annotations>',
        "CVAT's own XML",
    ),
    "labelme": (
        "a.json",
        '{"version": "6.0.0", "flags": {}, "shapes": [], "imagePath": "a.png"}',
        "labelme's JSON",
    ),
    "VIA": ("via.json", '{"_via_settings": {}, "_via_img_metadata": {}}', "VIA's JSON"),
    "Label Studio": (
        "p.json",
        '[{"id": 1, "annotations": [], "data": {"image": "/a.png"}}]',
        "Label Studio's JSON",
    ),
    "Supervisely": (
        "a.json",
        '{"description": "", "size": {}, "objects": [{"classTitle": "x"}]}',
        "Supervisely's JSON",
    ),
    "CreateML": ("a.json", '[{"image": "a.png", "annotations": [{"label": "x"}]}]', "CreateML's JSON"),
    "detections": (
        "d.json",
        '[{"image_id": 1, "category_id": 1, "bbox": [1, 2, 3, 4], "score": 0.5}]',
        "detections",
    ),
    "Kaggle": ("train.csv", "image_id,width,height,bbox\na,1,2,3\n", "a table"),
    "a document type": ("a.xml", '<!DOCTYPE a [<!ENTITY b "c">]><annotation>&b;</annotation>', "<!DOCTYPE"),
    "a folder of labelme": (
        "set/a.json",
        '{"version": "6.0.0", "flags": {}, "shapes": []}',
        "set/a.json.*labelme's JSON",
    ),
    "a folder of JSON": (
        "set/a.json",
        coco("a.png"),
        "is a folder with JSON files; pass one, such as a.json",
    ),
    "another XML": ("a.xml", "<html></html>", "must begin with <annotation>"),
    "poses": ("data.yaml", "kpt_shape: [17, 3]\nnames: [x]\n", "poses"),
    "detections in YOLO": ("a.txt", LINE.strip() + " 0.9\n", "a sixth number is a score"),
    "classes from 1": ("a.txt", "1 0.5 0.5 0.1 0.1\n", "class = 1: .* the first is 0"),
}


@pytest.mark.parametrize("tool", NOT_READ)
def test_what_is_not_read_says_so(tmp_path, tool):
    name, content, fault = NOT_READ[tool]
    yolo = {"classes.txt": "ball\n", "a.png": PICTURE} if name == "a.txt" else {}
    with pytest.raises(ValueError, match=rf"^labels = .*{fault}") as caught:
        opened(tmp_path, {name: content, **yolo}, "" if yolo else name.removesuffix("/a.json"))
    assert "\n" not in str(caught.value)


def boxes_of(file, **options):
    """A made-up reader: lines file,x0,y0,x1,y1,class of one picture."""
    selection = Selection("table", file, **options)
    rows = [line.split(",") for line in file.read_text().splitlines()[1:]]
    (name,) = selection.names([rows[0][0]])
    targets = [selection.target(row[5], tuple(map(float, row[1:5])), picture=name) for row in rows]
    return selection.picture_set([Listed(name, tuple(chain(*targets)))])


def test_a_new_format_is_one_entry(tmp_path, monkeypatch):
    """Although such tables are refused: it is recognised, probed, swept, and its pictures are found again."""
    monkeypatch.chdir(tmp_path)
    picture = rendered_signs().pictures[0]
    boxes = [target.box_xyxy for target in picture.targets]
    write_picture("a.png", picture.load())
    lines = ["file,x0,y0,x1,y1,class", *(f"a.png,{','.join(map(str, box))},stop sign" for box in boxes)]
    Path("a.csv").write_text("\n".join(lines) + "\n")
    table = LabelFormat(
        "table", "a table", lambda labels: labels.head.startswith("file,x0,"), boxes_of, (".csv",)
    )
    monkeypatch.setattr(label_formats, "LABEL_FORMATS", (table, *LABEL_FORMATS))
    model = Path(blurnoise_models.__file__).parent / "stop_sign.onnx"
    assert main(["inspect", str(model), "--probe", "a.csv"]) == 0
    assert (
        main(["sweep", *["--labels", "a.csv", "--exposure-ms", "5", "--lux", "10", "--dx", "0", "-o", "run"]])
        == 0
    )
    with Run.open("run") as run:
        assert run.setup.manifest["images"]["kind"] == "table"
        assert [target.box_xyxy for target in run.picture("a.png").targets] == boxes
    assert "data:image" in Path("run/failures.html").read_text(encoding="utf-8")


def test_the_help_names_what_is_read():
    read = [entry.help for entry in LABEL_FORMATS if not entry.instead]
    assert all(text and text in label_formats.HELP for text in read)
