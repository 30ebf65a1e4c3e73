"""The network's geometry against closed forms: cells, who answers for what, boxes there and back, the loss."""

import math

import pytest
import torch
from blurnoise_models.network import STRIDE_PX, Decoded, SignNet, cell_centres, cells, loss, responsible


def answers_for(boxes_xyxy, rows, columns, logit):
    """Raw answers (B, 5, rows, columns) in which every responsible cell gives its box, with ``logit``."""
    centres = cell_centres(rows, columns)
    which = responsible(centres, boxes_xyxy)
    wanted = torch.gather(boxes_xyxy, 1, which.clamp(min=0)[..., None].expand(-1, -1, 4))
    sides = torch.cat([centres - wanted[..., :2], wanted[..., 2:] - centres], dim=2)
    raw = torch.cat([torch.full_like(sides[..., :1], -logit), (sides.clamp(min=1) / STRIDE_PX).log()], dim=2)
    raw[..., 0] = torch.where(which >= 0, logit, -logit)
    return raw.transpose(1, 2).reshape(-1, 5, rows, columns)


SIGNS = torch.tensor(
    [[[20.0, 30.0, 61.0, 83.0], [70.0, 8.0, 86.0, 25.0]], [[5.5, 4.0, 120.0, 90.0], [0.0] * 4]]
)


def test_cell_centres_run_row_by_row():
    assert cell_centres(2, 3).tolist() == [[4, 4], [12, 4], [20, 4], [4, 12], [12, 12], [20, 12]]


def test_perfect_answers_decode_to_the_boxes():
    logits, boxes = cells(answers_for(SIGNS, 12, 16, 8.0))
    which = responsible(cell_centres(12, 16), SIGNS)
    assert boxes.shape == (2, 192, 4)
    for item in range(2):
        for sign in which[item].unique().tolist():
            if sign >= 0:
                found = boxes[item][which[item] == sign]
                torch.testing.assert_close(found, SIGNS[item, sign].expand_as(found), atol=1e-3, rtol=0)
    assert ((logits > 0) == (which >= 0)).all()


def test_a_cell_answers_for_the_smallest_box_around_it_and_never_for_padding():
    nested = torch.tensor([[[0.0, 0.0, 96.0, 96.0], [40.0, 40.0, 56.0, 56.0], [0.0, 0.0, 0.0, 0.0]]])
    which = responsible(cell_centres(12, 12), nested)[0]
    inner = ((cell_centres(12, 12) > 40) & (cell_centres(12, 12) < 56)).all(dim=1)
    assert (which[inner] == 1).all()
    near = ((cell_centres(12, 12) - 48).abs() <= 12).all(dim=1)
    assert (which[near & ~inner] == 0).all()
    assert (which[~near] == -1).all()


def test_loss_of_perfect_answers_is_nothing():
    assert loss(answers_for(SIGNS, 12, 16, 12.0), SIGNS) < 1e-3


def test_loss_of_shifted_boxes_is_their_distance_iou_and_the_score_their_iou():
    wanted = torch.tensor([[[30.0, 20.0, 70.0, 60.0]]])
    shifted = wanted - torch.tensor([10.0, 0.0, 10.0, 0.0])
    centres = cell_centres(12, 12)
    sides = torch.cat([centres - shifted[0, 0, :2], shifted[0, 0, 2:] - centres], dim=1)
    logits = torch.linspace(-2, 2, 144)
    answers = torch.cat([logits[:, None], (sides.clamp(min=1e-3) / STRIDE_PX).log()], dim=1).T
    fit, apart = 30 / 50, 100 / (50**2 + 40**2)  # 10 px apart in a frame of 50 x 40
    which = responsible(centres, wanted)[0] >= 0
    target = torch.where(which, fit, 0.0)
    scores = (target - logits.sigmoid()) ** 2 * _bce(logits, target)
    expected = scores.sum() / which.sum() + 2 * (1 - fit + apart)
    got = loss(answers.reshape(1, 5, 12, 12), wanted)
    assert math.isclose(float(got), float(expected), rel_tol=1e-4)


def _bce(logits, target):
    return torch.nn.functional.binary_cross_entropy_with_logits(logits, target, reduction="none")


def test_loss_without_signs_asks_for_silence_alone():
    answers = torch.zeros(2, 5, 4, 4)
    answers[:, 1:] = torch.randn(2, 4, 4, 4, generator=torch.Generator().manual_seed(1))
    value = loss(answers, torch.zeros(2, 3, 4))
    assert math.isclose(float(value), 32 * 0.25 * math.log(2), rel_tol=1e-5)


@pytest.mark.parametrize(("height", "width"), [(64, 96), (128, 32)])
def test_output_is_yolov8s(height, width):
    network = SignNet().eval()
    with torch.no_grad():
        out = Decoded(network)(torch.rand(2, 3, height, width))
        logits, boxes = cells(network(torch.zeros(1, 3, height, width)))
    assert out.shape == (2, 5, height * width // STRIDE_PX**2)
    assert ((out[:, 4] > 0) & (out[:, 4] < 0.2)).all(), "a fresh network is silent"
    assert (out[:, 2:4] > 0).all()
    assert logits.shape == (1, out.shape[2])
    assert boxes.shape == (1, out.shape[2], 4)
