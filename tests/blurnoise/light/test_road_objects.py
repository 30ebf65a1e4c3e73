"""The table of road objects: classes by their names, and what is allowed in one."""

import pytest

from blurnoise.light.road_objects import RoadObject, plain_name, road_object, road_objects, sheeting_of
from blurnoise.light.sheeting import SHEETINGS


@pytest.mark.parametrize("label", ["stop sign", "stop_sign", "Stop-Sign", "STOP  SIGN", "stop"])
def test_names_differ_in_capitals_and_separators(label):
    assert road_object(label) == RoadObject(0.762, 0.762, 1.8, "III")


@pytest.mark.parametrize(
    "label",  # of COCO and BDD100K
    ["person", "bicycle", "car", "motorcycle", "bus", "truck", "pedestrian", "rider", "bike", "motor"],
)
def test_classes_of_data_sets_are_known(label):
    assert road_object(label) is not None


def test_unknown_class_has_no_size():
    assert road_object("pizza") is None


def test_own_class_comes_before_the_table():
    own = {"stop sign": RoadObject(0.9, sheeting="XI")}
    assert road_object("Stop_sign", own).width_m == 0.9


def test_clothes_are_matt_and_signs_are_not():
    assert road_object("person").material is None
    assert road_object("stop sign").material == SHEETINGS["III"]


def test_every_row_says_where_its_figures_come_from():
    import csv
    from importlib import resources

    text = (resources.files("blurnoise.light") / "data" / "road_objects.csv").read_text("utf-8")
    rows = list(csv.DictReader(text.splitlines()))
    assert all(row["source"].strip() for row in rows)
    assert sum(len(row["names"].split(";")) for row in rows) == len(road_objects())  # no name stands twice


def test_three_numbers_are_a_sheeting():
    assert sheeting_of("150,60,4").at([0.2, 0.5, 2.0]).tolist() == pytest.approx([150, 60, 4])


@pytest.mark.parametrize("text", ["IV", "1,2", "1,2,3,4", "0,1,2", "nan,1,2", "1,2,-3", ""])
def test_other_sheetings_are_refused(text):
    with pytest.raises(
        ValueError, match=r"sheeting = .*must be I, III, XI, vest, worn, none, or three numbers"
    ):
        sheeting_of(text)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({}, "needs width_m or height_m"),
        ({"base_m": 1.0}, "needs width_m or height_m"),
        ({"width_m": 0.0}, "width_m = 0.0: must be finite and > 0"),
        ({"height_m": 1.0, "base_m": -1.0}, "base_m = -1.0: must be finite and >= 0"),
        ({"height_m": 1.0, "sheeting": "IV"}, "sheeting = 'IV'"),
    ],
)
def test_faults_are_one_line(fields, message):
    with pytest.raises(ValueError, match=message):
        RoadObject(**fields)


def test_plain_name():
    assert plain_name(" Licence_PLATE ") == "licence plate"
