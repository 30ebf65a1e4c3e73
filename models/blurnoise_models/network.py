"""A small anchor-free detector of one class: one grid of cells, each with a score and a box.

Residual stages at strides 4 to 32 px, joined top down at stride 8 (a feature pyramid), and one head there: every
cell says how well a box around it would fit (a score) and how far the box's four sides are from the cell's
centre. About 0.7 M parameters; 0.4 G multiply-adds for a 320x320 picture.

Domain: pictures (B, 3, H, W), sRGB-coded RGB in [0, 1], sides a multiple of 32; boxes (x0, y0, x1, y1) px.
Sources: FCOS (Tian et al. 2019: cells, centre sampling, side distances), quality focal loss (Li et al. 2020,
equation 2: the score is trained towards the box's IoU), distance IoU (Zheng et al. 2020, equation 7).
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits, interpolate

STRIDE_PX = 8
SIDE_MULTIPLE_PX = 32
_CENTRE_PX = 1.5 * STRIDE_PX  # cells this close to a box's centre, on both axes, answer for it
_RARE = 0.01  # a fresh network's score: most cells see no sign
_BOX_WEIGHT = 2.0  # of the boxes' loss beside the scores'


def _conv(inputs: int, outputs: int, kernel: int = 3, stride: int = 1) -> nn.Sequential:
    convolution = nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, bias=False)
    return nn.Sequential(convolution, nn.BatchNorm2d(outputs), nn.ReLU())


class _Residual(nn.Module):
    """A bottleneck of half the channels beside the identity."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.change = nn.Sequential(_conv(channels, channels // 2, 1), _conv(channels // 2, channels))

    def forward(self, features: Tensor) -> Tensor:
        return features + self.change(features)  # type: ignore[no-any-return]


def _stage(inputs: int, outputs: int, blocks: int) -> nn.Sequential:
    return nn.Sequential(_conv(inputs, outputs, 3, 2), *(_Residual(outputs) for _ in range(blocks)))


class SignNet(nn.Module):
    """The network: pictures (B, 3, H, W) to raw answers (B, 5, H / 8, W / 8): score logit and four sides.

    The sides are log distances in units of the stride: left, top, right, bottom.

    >>> network = SignNet().eval()
    >>> with torch.no_grad():
    ...     network(torch.zeros(1, 3, 64, 96)).shape  # cells of 8 px
    torch.Size([1, 5, 8, 12])
    """

    def __init__(self) -> None:
        super().__init__()
        self.stride4 = nn.Sequential(_conv(3, 16, 3, 2), _stage(16, 32, 1))
        self.stride8 = _stage(32, 64, 2)
        self.stride16 = _stage(64, 96, 2)
        self.stride32 = _stage(96, 128, 3)
        self.down32 = _conv(128, 96, 1)
        self.join16 = _Residual(96)
        self.down16 = _conv(96, 64, 1)
        self.join8 = _Residual(64)
        answer = nn.Conv2d(64, 5, 1)
        nn.init.ones_(answer.bias)  # type: ignore[arg-type]
        answer.bias.data[0] = math.log(_RARE / (1 - _RARE))  # type: ignore[union-attr]
        self.head = nn.Sequential(_conv(64, 64), answer)

    def forward(self, pictures: Tensor) -> Tensor:
        """Raw answers (B, 5, H / 8, W / 8) for ``pictures`` (B, 3, H, W)."""
        fine = self.stride8(self.stride4(pictures))
        middle = self.stride16(fine)
        coarse = self.stride32(middle)
        middle = self.join16(middle + interpolate(self.down32(coarse), scale_factor=2.0))
        fine = self.join8(fine + interpolate(self.down16(middle), scale_factor=2.0))
        return self.head(fine)  # type: ignore[no-any-return]


class Decoded(nn.Module):
    """A network with its answers as YOLOv8 gives them: (B, 5, A), boxes (centre x, y, width, height) px, score.

    >>> with torch.no_grad():
    ...     answers = Decoded(SignNet().eval())(torch.zeros(1, 3, 64, 96))
    >>> answers.shape, bool((answers[:, 4] < 0.05).all())  # 8 x 12 cells, none of which sees a sign yet
    (torch.Size([1, 5, 96]), True)
    """

    def __init__(self, network: SignNet) -> None:
        super().__init__()
        self.network = network

    def forward(self, pictures: Tensor) -> Tensor:
        """Boxes and scores (B, 5, A) for ``pictures`` (B, 3, H, W)."""
        logits, boxes = cells(self.network(pictures))
        corners, far = boxes[..., :2], boxes[..., 2:]
        answers = torch.cat([(corners + far) / 2, far - corners, logits.sigmoid()[..., None]], dim=2)
        return answers.transpose(1, 2)


def cells(answers: Tensor) -> tuple[Tensor, Tensor]:
    """Score logits (B, A) and boxes xyxy in px (B, A, 4) of raw ``answers`` (B, 5, rows, columns), row by row.

    >>> logits, boxes = cells(torch.zeros(1, 5, 1, 2))  # exp(0) = 1 stride to each side of the centres
    >>> boxes[0].tolist()
    [[-4.0, -4.0, 12.0, 12.0], [4.0, -4.0, 20.0, 12.0]]
    """
    flat = answers.flatten(2).transpose(1, 2)
    sides = STRIDE_PX * flat[..., 1:].clamp(max=6.0).exp()
    centres = cell_centres(answers.shape[2], answers.shape[3]).to(answers)
    return flat[..., 0], torch.cat([centres - sides[..., :2], centres + sides[..., 2:]], dim=2)


def cell_centres(rows: int, columns: int) -> Tensor:
    """Centres (x, y) of the cells in px, (rows * columns, 2), row by row.

    >>> cell_centres(1, 2).tolist()
    [[4.0, 4.0], [12.0, 4.0]]
    """
    y, x = torch.meshgrid(torch.arange(rows), torch.arange(columns), indexing="ij")
    return (torch.stack([x, y], dim=2).reshape(-1, 2) + 0.5) * STRIDE_PX


def responsible(centres: Tensor, boxes_xyxy: Tensor) -> Tensor:
    """Which box each cell answers for: (B, A) indices, -1 for none.

    centres: (A, 2); boxes_xyxy: (B, N, 4), N >= 1, rows without area are padding. A cell answers for the smallest box
    that holds its centre and whose own centre is near it (1.5 cells, on both axes).

    >>> box = torch.tensor([[[0.0, 0.0, 40.0, 40.0]]])
    >>> responsible(torch.tensor([[20.0, 20.0], [4.0, 4.0]]), box).tolist()  # its centre, and its corner
    [[0, -1]]
    """
    low, high = boxes_xyxy[:, None, :, :2], boxes_xyxy[:, None, :, 2:]
    at = centres[None, :, None, :]
    inside = ((at > low) & (at < high) & ((at - (low + high) / 2).abs() <= _CENTRE_PX)).all(dim=3)
    area = (high - low).prod(dim=3).expand(inside.shape)
    smallest, which = torch.where(inside, area, torch.inf).min(dim=2)
    return torch.where(smallest.isfinite(), which, -1)


def loss(answers: Tensor, boxes_xyxy: Tensor) -> Tensor:
    """Training loss of raw ``answers`` (B, 5, rows, columns) against boxes (B, N, 4), per responsible cell.

    The quality focal loss of all scores, towards the IoU of the cell's box (0 where no sign is), plus twice
    the distance-IoU loss of the responsible cells' boxes. Rows of ``boxes_xyxy`` without area are padding.

    >>> wrong, box = torch.zeros(1, 5, 4, 4), torch.tensor([[[4.0, 4.0, 28.0, 28.0]]])
    >>> right = wrong.clone()
    >>> right[:, 1:] = math.log(1.5)  # 12 px to each side
    >>> bool(loss(right, box) < loss(wrong, box))
    True
    """
    logits, boxes = cells(answers.float())
    which = responsible(cell_centres(*answers.shape[2:]).to(boxes_xyxy), boxes_xyxy)
    answering = which >= 0
    wanted = torch.gather(boxes_xyxy, 1, which.clamp(min=0)[..., None].expand(-1, -1, 4))[answering]
    fit, distance = _fit(boxes[answering], wanted)
    quality = torch.zeros_like(logits)
    quality[answering] = fit.detach()
    scores = (quality - logits.sigmoid()).abs().square() * binary_cross_entropy_with_logits(
        logits, quality, reduction="none"
    )
    return (scores.sum() + _BOX_WEIGHT * distance.sum()) / max(len(wanted), 1)


def _fit(boxes: Tensor, wanted: Tensor) -> tuple[Tensor, Tensor]:
    """IoU and distance-IoU loss of boxes (P, 4) and those wanted (P, 4)."""
    low, high = torch.maximum(boxes[:, :2], wanted[:, :2]), torch.minimum(boxes[:, 2:], wanted[:, 2:])
    overlap = (high - low).clamp(min=0).prod(dim=1)
    areas = [(each[:, 2:] - each[:, :2]).prod(dim=1) for each in (boxes, wanted)]
    fit = overlap / (areas[0] + areas[1] - overlap)
    around = torch.maximum(boxes[:, 2:], wanted[:, 2:]) - torch.minimum(boxes[:, :2], wanted[:, :2])
    apart = (boxes[:, :2] + boxes[:, 2:] - wanted[:, :2] - wanted[:, 2:]) / 2
    return fit, 1 - fit + apart.square().sum(dim=1) / around.square().sum(dim=1)
