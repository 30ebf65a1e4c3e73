"""RandomExposure in Ultralytics' trainer: its batches are exposed after its own augmentation, validation is not.

Needs the package ultralytics (AGPL-3.0): python examples/others/train_ultralytics.py data.yaml --model yolov8n.yaml
"""

import argparse
from typing import Any

from ultralytics.models.yolo.detect import DetectionTrainer

from blurnoise import RandomExposure

EXPOSE = RandomExposure(["imx250c", "ar0237"], exposure_s=(1e-3, 60e-3), illuminance_lux=(5, 500), p=0.5)


class ExposedTrainer(DetectionTrainer):
    """Ultralytics' trainer of detectors, whose training pictures a camera takes."""

    def preprocess_batch(self, batch: dict[str, Any]) -> dict[str, Any]:
        """The batch as Ultralytics prepares it, (B, 3, H, W) RGB in [0, 1] on its device, exposed."""
        batch = super().preprocess_batch(batch)
        batch["img"] = EXPOSE(batch["img"].float())
        return batch


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", help="Ultralytics' data.yaml")
    parser.add_argument(
        "--model", default="yolov8n.pt", help="weights to go on from, or a .yaml to begin anew"
    )
    parser.add_argument("--epochs", type=int, default=50)
    parser.add_argument("--size", type=int, default=640, help="of pictures, px")
    options = parser.parse_args()
    given = {"data": options.data, "model": options.model, "epochs": options.epochs, "imgsz": options.size}
    ExposedTrainer(overrides=given).train()
