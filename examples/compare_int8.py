"""fp32 against int8 of one model: quantised here by ONNX Runtime, then both before the same pictures and noise."""

import logging
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from blurnoise_eval import STOP_SIGN, Detector, Question, SweepPlan, datasets, evaluate
from blurnoise_models.scenes import write_coco
from onnxruntime.quantization import CalibrationDataReader, QuantType, quantize_static

logging.getLogger().setLevel(logging.ERROR)  # the quantiser's advice on preprocessing


class CleanPictures(CalibrationDataReader):
    """What the quantiser takes its ranges from: pictures as the detector prepares them."""

    def __init__(self, detector: Detector, pictures: datasets.PictureSet) -> None:
        name = detector.session.get_inputs()[0].name
        self.feeds: Iterator[dict[str, Any]] = (
            {name: detector.prepare(each.load())[0].copy()} for each in pictures
        )

    def get_next(self) -> dict[str, Any] | None:
        """The next input, None after the last."""
        return next(self.feeds, None)


plan = SweepPlan(
    {"exposure_s": (0.005, 0.02), "illuminance_lux": (0.5, 20.0), "velocity_x_px_s": (0.0, 400.0)}
)
with tempfile.TemporaryDirectory() as name:
    folder = Path(name)
    pictures = datasets.coco(write_coco(folder / "scenes", seed=2, count=24))
    fp32 = Detector(STOP_SIGN)
    # Convolutions alone: one scale for an output of boxes, in px, and scores would round every score to 0.
    # Unsigned activations: of the default, signed ones, ONNX Runtime computes 12 of the 29 convolutions in fp32.
    quantize_static(
        STOP_SIGN,
        folder / "int8.onnx",
        CleanPictures(fp32, pictures),
        op_types_to_quantize=["Conv"],
        activation_type=QuantType.QUInt8,
    )
    int8 = Detector(folder / "int8.onnx", contract=fp32.contract)
    done = evaluate([fp32, int8], pictures, plan=plan, output=folder / "run", question=Question(score="ap50"))
    models, answers = done.models, done.answers

for model in models:
    print(f"{model['model']}: AP {model['p']:.3f} clean, {model['mpc']:.3f} over all conditions")
for answer in answers:
    if answer["group"] == "all":
        light, speed = answer["illuminance_lux"], answer["velocity_x_px_s"]
        print(
            f"{answer['model']}, {light:g} lux, {speed:g} px/s: keeps {answer['best_score']:.2f} of its AP50"
        )
