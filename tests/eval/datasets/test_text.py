"""PP-OCR's text labels: whole pictures to be read, and texts with their places."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from blurnoise_eval.datasets import UnreadablePicture, texts, write_picture

CORNERS = [[10, 20], [50, 22], [50, 40], [10, 38]]


def write(path: Path, *lines: str) -> Path:
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
    return path


def test_whole_pictures_are_read(tmp_path: Path) -> None:
    for name, height in (("a.png", 15), ("sub/b.png", 16), ("c.png", 63), ("d.png", 64)):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        write_picture(tmp_path / name, np.zeros((height, 200), np.uint8))
    found = texts(
        write(
            tmp_path / "gt.txt", "a.png\tSTOP", "sub/b.png\tzwei Wörter\tund <b>", "", "c.png\t", "d.png\t[1]"
        )
    )
    assert (found.kind, found.categories, found.notes) == ("text", {"text": 1}, ())
    targets = [target for picture in found for target in picture.targets or ()]
    assert [target.text for target in targets] == ["STOP", "zwei Wörter\tund <b>", "", "[1]"]
    assert [target.group for target in targets] == [
        "text, height < 16 px", "text, height 16-32 px", "text, height 32-64 px", "text, height > 64 px",
    ]  # fmt: skip
    assert targets[0].box_xyxy == (0.0, 0.0, 200.0, 15.0)
    assert {target.label for target in targets} == {"text"}
    assert [picture.image_id for picture in found] == [1, 2, 3, 4]
    assert found.pictures[1].load().shape == (16, 200, 3)


def test_places_are_boxes_around_their_points(tmp_path: Path) -> None:
    listed = [
        {"transcription": "STOP", "points": CORNERS, "difficult": False},
        {"transcription": "###", "points": CORNERS},
        {"transcription": "*", "points": CORNERS},
        {"transcription": "flat", "points": [[1, 1], [5, 1], [9, 1], [4, 1]]},
        {"transcription": "lost", "points": [[1, 1], [float("nan"), 1], [9, 9], [4, 5]]},
    ]
    found = texts(write(tmp_path / "gt.txt", f"a.png\t{json.dumps(listed)}", "b.png\t[]"))
    stop, *unreadable = found.pictures[0].targets or ()
    assert (stop.text, stop.box_xyxy, stop.crowd) == ("STOP", (10.0, 20.0, 50.0, 40.0), False)
    assert stop.group == "text, height 16-32 px"
    assert stop.annotation == {"points": CORNERS, "difficult": False}
    assert [target.crowd for target in unreadable] == [True, True]
    assert found.pictures[1].targets == ()
    assert found.notes == ("1 box of no area left out", "1 box with numbers that are not finite left out")


def test_pictures_may_lie_elsewhere_or_be_missing(tmp_path: Path) -> None:
    (tmp_path / "pictures").mkdir()
    write_picture(tmp_path / "pictures" / "a.png", np.zeros((20, 30), np.uint8))
    found = texts(write(tmp_path / "gt.txt", "a.png\tSTOP", "b.png\tSTOP"), images=tmp_path / "pictures")
    assert found.pictures[0].load().shape == (20, 30, 3)
    assert found.pictures[1].targets == ()
    with pytest.raises(UnreadablePicture, match=r"b\.png"):
        found.pictures[1].load()


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ("a.png STOP", "must be a picture's name, a tab and its text"),
        ("../a.png\tSTOP", "leaves the folder"),
        ("\tSTOP", "leaves the folder"),
        ("C:\\a.png\tSTOP", "leaves the folder"),
        ('a.png\t[{"transcription": "STOP"', "not a list of texts and points"),
        ("a.png\t[{" + "[" * 9_000, "not a list"),
        ('a.png\t[{"points": []}]', r"texts\[0\]: has no 'transcription'"),
        ('a.png\t[{"transcription": 5, "points": []}]', "transcription = 5"),
        ('a.png\t[{"transcription": "STOP"}]', "has no 'points'"),
        ('a.png\t[{"transcription": "STOP", "points": [[1, 2]]}]', "points = "),
        ('a.png\t[{"transcription": "STOP", "points": [[1, 2], [3]]}]', r"points\[1\] = \[3\]"),
        (
            'a.png\t[{"transcription": "STOP", "points": [[1, 2], [3, "4"]]}]',
            r"points\[1\]\[1\] = '4': must be a number",
        ),
    ],
)
def test_bad_line_is_named(tmp_path: Path, line: str, fault: str) -> None:
    with pytest.raises(ValueError, match=rf"text = '.*gt\.txt': line 2: .*{fault}"):
        texts(write(tmp_path / "gt.txt", "" if "\t[{" in line else "b.png\tSTOP", line))


def test_either_all_lines_have_places_or_none(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="line 2: not a list of texts and points"):
        texts(
            write(
                tmp_path / "gt.txt", 'a.png\t[{"transcription": "A", "points": [[1, 2], [3, 4]]}]', "b.png\tB"
            )
        )


def test_empty_repeated_missing_and_binary(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="lists no pictures"):
        texts(write(tmp_path / "gt.txt", ""))
    with pytest.raises(ValueError, match=r"lists 'a\.png' twice"):
        texts(write(tmp_path / "gt.txt", "a.png\tA", "./a.png\tB"))
    with pytest.raises(ValueError, match=r"nothing\.txt': No such file"):
        texts(tmp_path / "nothing.txt")
    (tmp_path / "gt.txt").write_bytes("a.png\tStraße".encode("latin-1"))
    with pytest.raises(ValueError, match="not UTF-8"):
        texts(tmp_path / "gt.txt")


def test_file_may_begin_with_a_byte_order_mark(tmp_path: Path) -> None:
    (tmp_path / "gt.txt").write_text("a.png\tA\r\n", encoding="utf-8-sig")
    write_picture(tmp_path / "a.png", np.zeros((4, 4), np.uint8))
    (picture,) = texts(tmp_path / "gt.txt")
    assert (picture.name, [target.text for target in picture.targets or ()]) == ("a.png", ["A"])
