"""A run as a FiftyOne data set: its samples are the run's cells, and FiftyOne loads it where it is installed."""

import json
from collections import Counter

import cv2
import numpy as np
import pandas as pd
import pytest
from blurnoise_eval.report import fiftyone_export
from blurnoise_eval.run.run import Run
from squares_seen import SIZE_PX, squares_run

FOUND = 0.25


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    done = squares_run(tmp_path_factory.mktemp("squares"))
    done.report()
    return done


@pytest.fixture(scope="module")
def dataset(run):
    folder = run.folder.parent / "dataset"
    assert run.write_fiftyone(folder) == "21 samples of 3 of 3 pictures"
    return folder


@pytest.fixture(scope="module")
def samples(dataset):
    return json.loads((dataset / "samples.json").read_text())["samples"]


@pytest.fixture(scope="module")
def targets(run):
    return pd.read_csv(run.folder / "targets.csv")


def test_samples_are_the_cells_with_the_pictures_that_the_model_saw(run, dataset, samples):
    cells = pd.read_csv(run.folder / "results.csv").set_index("cell_id")
    assert sorted(sample["cell_id"] for sample in samples) == sorted(cells.index)
    kept = cells["example"].dropna()
    assert len(kept) > 10
    for sample in samples:
        cell = cells.loc[sample["cell_id"]]
        assert sample["picture"] == cell["image"]
        assert (sample["exposure_s"] or 0) == pytest.approx(0 if cell["clean"] else cell["exposure_s"])
        assert (sample["illuminance_lux"] or 200) == 200
        assert ("original" in sample["tags"]) == cell["clean"]
        if sample["cell_id"] in kept:
            pictures = [
                cv2.imread(str(path)) for path in (run.folder / cell["example"], dataset / sample["filepath"])
            ]
            np.testing.assert_array_equal(*pictures)
        assert (dataset / sample["filepath"]).stat().st_size == sample["metadata"]["size_bytes"]


def test_truth_is_every_target_with_where_it_is_and_from_when_to_when_it_is_found(samples, targets):
    exposed = targets[~targets["clean"].astype(bool)]
    found = exposed[exposed["confidence"] >= FOUND]
    key = ["image", "target_id", "velocity_x_px_s"]
    ends = found.groupby(key)["exposure_s"].agg(["min", "max"])
    told = {(row["cell_id"], row["target_id"]): row for _, row in targets.iterrows()}
    seen = {
        (each["cell_id"], row["target_id"]): row
        for each in samples
        for row in each["ground_truth"]["detections"]
    }
    assert seen.keys() == told.keys()
    for place, row in seen.items():
        expected = told[place]
        box = np.array([expected[["x0", "y0"]], expected[["width_px", "height_px"]]], float) / SIZE_PX
        assert row["bounding_box"] == pytest.approx(box.ravel())
        assert row["label"] == expected["label"]
        assert row["confidence_sure_of_light"] == expected["confidence"]
        assert row["found_sure_of_light"] == (expected["confidence"] >= FOUND)
        at = tuple(expected[key])
        limits = tuple(ends.loc[at]) if at in ends.index else (None, None)
        assert (row["found_from_s_sure_of_light"], row["found_to_s_sure_of_light"]) == limits
    assert (ends["min"].nunique(), ends["max"].nunique()) > (1, 1)


def test_predictions_are_all_that_was_found_false_ones_too(run, samples):
    cells = pd.read_csv(run.folder / "results.csv").set_index("cell_id")
    for sample in samples:
        rows = sample["predictions_sure_of_light"]["detections"]
        corner = [
            row
            for row in rows
            if row["bounding_box"] == pytest.approx([0, 0, 8 / SIZE_PX[0], 8 / SIZE_PX[1]])
        ]
        assert [(row["label"], row["confidence"]) for row in corner] == [("bright", 0.5)]
        assert len(rows) <= cells.loc[sample["cell_id"], "n_detections"]
        assert all(row["confidence"] >= fiftyone_export.LEAST_SCORE for row in rows)


def test_every_id_is_there_once_and_every_value_is_declared(dataset, samples):
    labels = [
        row
        for sample in samples
        for name in ("ground_truth", "predictions_sure_of_light")
        for row in sample[name]["detections"]
    ]
    ids = [each["_id"]["$oid"] for each in (*samples, *labels)]
    assert all(len(bytes.fromhex(each)) == 12 for each in ids)
    assert max(Counter(ids).values()) == 1
    fields = json.loads((dataset / "metadata.json").read_text())["sample_fields"]
    declared = {field["db_field"]: field for field in fields}
    for sample in samples:
        assert sample.keys() <= declared.keys()
        (inside,) = declared["ground_truth"]["fields"]
        for row in sample["ground_truth"]["detections"]:
            assert row.keys() - {"_cls", "attributes"} <= {field["db_field"] for field in inside["fields"]}


def test_limits_keep_the_recommended_exposure_and_say_so(run, tmp_path, monkeypatch):
    monkeypatch.setattr(fiftyone_export, "MOST_SAMPLES", 10)
    assert run.write_fiftyone(tmp_path) == "10 samples of 2 of 3 pictures (21 cells in the run)"
    samples = json.loads((tmp_path / "samples.json").read_text())["samples"]
    recommended = run.tables.recommendations[0].exposure_s
    exposures = (0.0005, 0.002, 0.008)
    nearest = min(exposures, key=lambda each: abs(np.log(each / recommended)))
    marked = [sample["exposure_s"] for sample in samples if "recommended" in sample["tags"]]
    assert marked == [nearest] * 4
    assert len(samples) == 10


def test_without_labels_each_model_has_targets_of_its_own(run, tmp_path):
    data = run.tables.manifest["images"]
    labelled, data["labelled"] = data["labelled"], False
    try:
        run.write_fiftyone(tmp_path)
    finally:
        data["labelled"] = labelled
    sample = json.loads((tmp_path / "samples.json").read_text())["samples"][0]
    assert len(sample["ground_truth_sure_of_light"]["detections"]) == 2


def test_no_picture_at_hand_is_an_error_that_says_where_they_were(run, tmp_path):
    moved = Run.open(run.folder, progress=False, images=tmp_path / "gone")
    with pytest.raises(ValueError, match=r"images = .*gone.*: must be a folder"):
        moved.write_fiftyone(tmp_path / "dataset")
    assert not (tmp_path / "dataset").exists()


@pytest.mark.slow
def test_fiftyone_loads_it(dataset, targets):
    fo = pytest.importorskip("fiftyone", reason="fiftyone is not installed here")
    name = f"blurnoise-test-{dataset.parent.name}"
    loaded = fo.Dataset.from_dir(
        str(dataset), dataset_type=fo.types.FiftyOneDataset, name=name, overwrite=True
    )
    try:
        assert loaded.count() == 21
        assert loaded.count_sample_tags()["original"] == 3
        assert loaded.count("ground_truth.detections") == len(targets)
        found = loaded.count_values("ground_truth.detections.found_sure_of_light")
        assert found[True] == (targets["confidence"] >= FOUND).sum()
        assert loaded.bounds("exposure_s") == (0.0005, 0.008)
        assert loaded.bounds("ground_truth.detections.found_from_s_sure_of_light")[0] >= 0.0005
        assert len(loaded.group_by("picture", order_by="exposure_s")) == 3
        missed = fo.ViewField("found_sure_of_light") == False  # noqa: E712
        view = loaded.match(fo.ViewField("exposure_s") == 0.0005).filter_labels("ground_truth", missed)
        dark = targets[(targets["exposure_s"] == 0.0005) & (targets["confidence"] < FOUND)]
        assert view.count("ground_truth.detections") == len(dark)
        original = loaded.match_tags("original")
        original.evaluate_detections("predictions_sure_of_light", gt_field="ground_truth", eval_key="at_rest")
        assert original.sum("at_rest_fp") == 3
        loaded.compute_metadata(overwrite=True)
        assert loaded.distinct("metadata.width") == [SIZE_PX[0]]
    finally:
        loaded.delete()
