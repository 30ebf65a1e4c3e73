"""Signs that labels mean something else than is read, in files that no reader could refuse by their form."""

import json

import numpy as np
import pytest
from blurnoise_eval.datasets import bdd, coco, voc, write_picture, yolo

SIZE = (160, 120)
BOXES = [(20, 30, 50, 90), (100, 40, 150, 110), (60, 20, 90, 50)]  # corners
SHARES = [tuple(np.divide(box, SIZE * 2).tolist()) for box in BOXES]


def xywh(box):
    return [box[0], box[1], box[2] - box[0], box[3] - box[1]]


def centred(box):
    return [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2, box[2] - box[0], box[3] - box[1]]


def turned(box):
    return [box[1], box[0], box[3], box[2]]


def of_coco(folder, boxes, size=SIZE, **annotation):
    sized = {} if size is None else {"width": size[0], "height": size[1]}
    entries = [{"image_id": 1, "category_id": 1, "bbox": list(box), **annotation} for box in boxes]
    document = {
        "images": [{"id": 1, "file_name": "a.png", **sized}],
        "categories": [{"id": 1, "name": "x"}],
        "annotations": entries,
    }
    (folder / "coco.json").write_text(json.dumps(document))
    return coco(folder / "coco.json")


def of_yolo(folder, boxes):
    (folder / "classes.txt").write_text("x\n")
    (folder / "a.txt").write_text("".join(f"0 {' '.join(map(str, box))}\n" for box in boxes))
    return yolo(folder)


def of_bdd(folder, boxes):
    labels = [
        {"category": "x", "box2d": dict(zip(("x1", "y1", "x2", "y2"), box, strict=True))} for box in boxes
    ]
    (folder / "bdd.json").write_text(json.dumps([{"name": "a.png", "labels": labels}]))
    return bdd(folder / "bdd.json")


def of_voc(folder, boxes):
    rows = [
        "".join(
            f"<{name}>{side}</{name}>"
            for name, side in zip(("xmin", "ymin", "xmax", "ymax"), box, strict=True)
        )
        for box in boxes
    ]
    objects = "".join(f"<object><name>x</name><bndbox>{row}</bndbox></object>" for row in rows)
    (folder / "a.xml").write_text(f"<annotation><filename>a.png</filename>{objects}</annotation>")
    return voc(folder / "a.xml")


@pytest.fixture
def folder(tmp_path):
    """With a picture: the sizes of the labels say nothing, or are the picture's."""
    write_picture(tmp_path / "a.png", np.zeros((*SIZE[::-1], 3), np.uint8))
    return tmp_path


def doubts(found):
    return [
        note.removeprefix("doubtful labels: ") for note in found.notes if note.startswith("doubtful labels: ")
    ]


RIGHT = ((of_coco, xywh), (of_bdd, list), (of_voc, list))


@pytest.mark.parametrize(("read", "form"), RIGHT)
def test_right_boxes_are_not_doubted(folder, read, form):
    found = read(folder, map(form, BOXES))
    assert [target.box_xyxy for target in found.pictures[0].targets or ()] == BOXES
    assert doubts(found) == []
    assert doubts(of_yolo(folder, map(centred, SHARES))) == []


@pytest.mark.parametrize(("read", "form"), RIGHT)
def test_shares_are_refused(folder, read, form):
    """All of them; some are doubted."""
    with pytest.raises(
        ValueError, match=r"^labels = .*: all 3 boxes are below 1 px: shares of the picture's size\?"
    ):
        read(folder, map(form, SHARES))
    found = read(folder, map(form, [*BOXES, *SHARES[:1]]))
    assert doubts(found)[0] == "1 of 4 boxes are below 1 px: shares of the picture's size?"


@pytest.mark.parametrize("size", [SIZE, None])
@pytest.mark.parametrize(
    ("form", "meant"),
    [
        (list, "corners x0, y0, x1, y1"),
        (centred, "centre x, y, width, height"),
        (lambda box: turned(xywh(box)), "y before x"),
        (lambda box: np.multiply(xywh(box), 3).tolist(), "another size of the pictures"),
    ],
)
def test_other_layouts_are_doubted(folder, size, form, meant):
    """Also where the file does not say the size, by the picture's own."""
    (doubt,) = doubts(of_coco(folder, map(form, BOXES), size))
    assert f"boxes end outside of their picture: {meant}? They are read as x, y, width, height" in doubt


def test_other_layouts_of_yolo_and_corners_are_doubted(folder):
    (doubt,) = doubts(of_yolo(folder, SHARES))
    assert (
        "outside of their picture: corners x0, y0, x1, y1? They are read as centre x, y, width, height"
        in doubt
    )
    (doubt,) = doubts(of_yolo(folder, map(xywh, [*SHARES, (0.0, 0.1, 0.4, 0.9)])))
    assert "outside of their picture: x, y, width, height?" in doubt
    for read in (of_bdd, of_voc):
        (doubt,) = doubts(read(folder, [xywh(box) for box in (*BOXES, (10, 20, 90, 90))]))
        assert "of their picture or have no area: x, y, width, height? They are read as corners" in doubt


def test_areas_of_corners_are_doubted(folder):
    """A box that ends at the picture's sides either way; areas of masks say nothing."""
    (doubt,) = doubts(of_coco(folder, [(50, 30, 110, 90)], area=3600.0))
    assert doubt.startswith(
        "1 of 1 areas are those of corners x0, y0, x1, y1: are the boxes corners? They are read as x, y"
    )
    for area in (9900.0, 3000.0, None):
        assert doubts(of_coco(folder, [(50, 30, 110, 90)], area=area)) == []


def test_per_cent_is_doubted(folder):
    write_picture(folder / "a.png", np.zeros((480, 640, 3), np.uint8))
    boxes = [(10 + n, 20, 30 + n, 55 + n) for n in range(9)]
    (doubt,) = doubts(of_coco(folder, map(xywh, boxes), (640, 480)))
    assert doubt == "all 9 boxes end within 100 px of the corner: per cent of the picture's size?"
    assert doubts(of_coco(folder, map(xywh, [*boxes, (300, 300, 400, 400)]), (640, 480))) == []


def test_boxes_that_occur_twice(folder):
    """COCO's tools count them, Ultralytics does not: other digits of the same single-precision number, too."""
    found = of_coco(folder, map(xywh, [*BOXES, BOXES[0]]))
    assert len(found.pictures[0].targets or ()) == 4
    (doubt,) = doubts(found)
    assert doubt.startswith("1 of 4 boxes occur before, with the same class and corners")
    rows = "0.5 0.5 0.25 0.25", "0.50 0.500 .25 2.5e-1", "0.5 0.5 0.25 0.250000001", "0.5 0.5 0.25 0.26"
    found = of_yolo(folder, map(str.split, rows))
    assert len(found.pictures[0].targets or ()) == 2
    assert found.notes == ("rows that occur before in their file, left out as Ultralytics does: 2",)


def test_ignored_annotations_count_as_for_coco(folder):
    found = of_coco(folder, map(xywh, BOXES), ignore="1")
    assert found.notes == ('annotations with "ignore", used as any other, as COCO\'s tools do: 3',)


def test_pixels_counted_from_one(folder):
    """Boxes that touch 1, and none 0; of the VOC challenge they are read so."""
    (doubt,) = doubts(of_voc(folder, [(1, 1, 30, 40), (5, 5, 20, 20)]))
    assert doubt.startswith("1 of 2 boxes begin at 1 px and none at 0: do pixels count from 1")
    assert doubts(of_voc(folder, [(1, 1, 30, 40), (0, 5, 20, 20)])) == []


def test_pictures_without_a_target(folder):
    for name in "bcd":
        write_picture(folder / f"{name}.png", np.zeros((9, 9), np.uint8))
    document = json.loads((folder / "coco.json").read_text()) if of_coco(folder, map(xywh, BOXES)) else {}
    document["images"] += [{"id": n, "file_name": f"{name}.png"} for n, name in enumerate("bcd", start=2)]
    (folder / "coco.json").write_text(json.dumps(document))
    assert doubts(coco(folder / "coco.json")) == ["3 of 4 pictures have no target"]


# --- rows of YOLO that are more than boxes ---


@pytest.mark.parametrize("beside", [" 0.3 0.4", " 0.9 1", " 0.3 0.4 2 0.2 0.3 1"])
def test_poses_and_tracks_are_no_polygons(folder, beside):
    rows = [f"0 {' '.join(map(str, centred(box)))}{beside}\n" for box in SHARES]
    (folder / "classes.txt").write_text("x\n")
    (folder / "a.txt").write_text("".join(rows))
    corners = 2 + len(beside.split()) // 2
    assert doubts(yolo(folder))[0].startswith(
        f"all 3 rows are polygons of {corners} corners, and each begins"
    )


@pytest.mark.parametrize("count", [3, 4, 12])
def test_polygons_are_not_doubted(folder, count):
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    outline = np.stack([0.1 * np.cos(angles), 0.1 * np.sin(angles)], axis=1)
    places = [(0.2, 0.2), (0.8, 0.3), (0.5, 0.85), (0.85, 0.85)]
    rows = [f"0 {' '.join(f'{n:.4f}' for n in (outline + place).ravel())}\n" for place in places]
    (folder / "classes.txt").write_text("x\n")
    (folder / "a.txt").write_text("".join(rows))
    assert doubts(yolo(folder)) == []


def test_an_empty_line_among_the_names_of_classes_is_refused(folder):
    (folder / "classes.txt").write_text("car\n\nbus\n")
    (folder / "a.txt").write_text("1 0.5 0.5 0.2 0.2\n")
    with pytest.raises(ValueError, match=r"classes\.txt, line 2: is empty; each line must name a class"):
        yolo(folder)


def test_classes_of_one_name_are_noted(folder):
    of_yolo(folder, [centred(SHARES[0])])
    (folder / "classes.txt").write_text("x\ny\nx\n")
    noted = "2 classes are named 'x', and count as one"
    assert noted in yolo(folder).notes
    of_coco(folder, [xywh(BOXES[0])])
    document = json.loads((folder / "coco.json").read_text())
    document["categories"].append({"id": 2, "name": "x"})
    (folder / "coco.json").write_text(json.dumps(document))
    assert noted in coco(folder / "coco.json").notes
