"""Detectors of squares, as many exporters write them: a network that finds them, and what comes behind it."""

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F

SIZE_PX, SQUARE_PX, STRIDE = (96, 128), 24, 8
COLOURS = {2: (0.8, 0.2, 0.2), 11: (0.1, 0.1, 0.7)}  # by number of class: red cars, blue stop signs
ROWS = 40
Outputs = tuple[Tensor, ...]


def pictures(count=6, seed=1):
    """Pictures of three squares each on grey noise, RGB, and their (boxes, classes)."""
    random, made = np.random.default_rng(seed), []
    for _ in range(count):
        image = random.integers(150, 200, (*SIZE_PX, 1)).repeat(3, axis=2).astype(np.uint8)
        boxes, classes = [], []
        for left, top in ((8, 8), (72, 16), (40, 56)):
            x, y = np.add((left, top), 8 * random.integers(0, 3, 2))
            number = list(COLOURS)[int(random.integers(2))]
            image[y : y + SQUARE_PX, x : x + SQUARE_PX] = np.round(np.multiply(COLOURS[number], 255))
            boxes.append((x, y, x + SQUARE_PX, y + SQUARE_PX))
            classes.append(number)
        made.append((image, np.array(boxes, np.float32), np.array(classes)))
    return made


class Squares(nn.Module):
    """Boxes (ROWS, 4) = (left, top, right, bottom) px and scores (ROWS, classes) of pictures 0-1, RGB; no doubles."""

    def __init__(self, classes: int, grey: bool = False) -> None:
        super().__init__()
        colours = torch.zeros(classes, 3) - 9  # which nothing is of
        for number, colour in COLOURS.items():
            if number < classes:
                colours[number] = torch.tensor(colour)
        self.register_buffer(
            "colours", colours @ torch.tensor([[0.299], [0.587], [0.114]]) if grey else colours
        )
        rows, columns = (torch.arange(0, side - SQUARE_PX + 1, STRIDE) for side in SIZE_PX)
        y, x = torch.meshgrid(rows, columns, indexing="ij")
        corner = torch.stack([x.flatten(), y.flatten()], dim=1).float()
        self.register_buffer("boxes", torch.cat([corner, corner + SQUARE_PX], dim=1))

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        away = (image[:, None] - self.colours[None, :, :, None, None]).abs().sum(2)
        alike = (1 - 5 * away).clamp(0, 1)
        found = 0.97 * F.avg_pool2d(alike, SQUARE_PX, STRIDE)
        found = torch.where(
            found < F.max_pool2d(found, 3, 1, 1), 0.1 * found, found
        )  # no second one of a square
        scores = 0.003 + found.flatten(2)[0].T
        order = scores.max(dim=1).values.topk(ROWS).indices
        return self.boxes[order], scores[order]


class Exported(nn.Module):
    """The network behind what its input is, before what an exporter writes."""

    def __init__(
        self, network: nn.Module, write: Callable[[Tensor, Tensor], Outputs], fed: dict[str, Any]
    ) -> None:
        super().__init__()
        self.network, self.write, self.fed = network, write, fed

    def forward(self, images: Tensor) -> Outputs:
        x = images.float()
        if self.fed.get("nhwc"):
            x = x.permute(0, 3, 1, 2)
        if self.fed.get("mean"):
            mean, std = (torch.tensor(self.fed[name]).reshape(1, -1, 1, 1) for name in ("mean", "std"))
            x = x * std + mean
        if self.fed.get("value_range") == "0-255":
            x = x / 255
        if self.fed.get("colour") == "bgr":
            x = x.flip(1)
        return self.write(*self.network(x))


def exported(path, write, names, *, classes=80, dtype=torch.float32, **fed):
    """Write such a detector; names: of its outputs. fed: fields of a contract, and nhwc."""
    network = Squares(classes, fed.get("colour") == "grey")
    channels = 1 if fed.get("colour") == "grey" else 3
    shape = (1, *SIZE_PX, channels) if fed.get("nhwc") else (1, channels, *SIZE_PX)
    model = Exported(network, write, fed)
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore"
        )  # of the tracer, which takes what follows from the size of the input as fixed
        torch.onnx.export(
            model, (torch.zeros(shape, dtype=dtype),), path, dynamo=False, opset_version=17,
            input_names=["images"], output_names=list(names),
        )  # fmt: skip
    return path
