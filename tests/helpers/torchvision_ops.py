"""torchvision beside another build of torch: the two operators that its detectors need, in Python."""

import importlib

import pytest
import torch
from kornia.geometry.bbox import nms
from torch.nn import functional

_NMS = "nms(Tensor dets, Tensor scores, float iou_threshold) -> Tensor"
_POOL = "roi_align(Tensor x, Tensor rois, float scale, SymInt rows, SymInt columns, int samples, bool how) -> Tensor"
_UNUSED = ("qnms", "qroi_align", "deform_conv2d", "roi_pool", "ps_roi_align", "ps_roi_pool")
_kept: list[torch.library.Library] = []


def detectors():
    """torchvision.models.detection. Skips where torchvision is not installed."""
    try:
        pytest.importorskip("torchvision")
    except RuntimeError:  # its compiled operators have not been loaded
        library = torch.library.Library("torchvision", "DEF")
        backward = [f"_{name}_backward" for name in (*_UNUSED, "roi_align")]
        for signature in (_NMS, _POOL, *(f"{name}(Tensor x) -> Tensor" for name in (*_UNUSED, *backward))):
            library.define(signature)
        library.impl("nms", nms, "CPU")
        library.impl("roi_align", _roi_align, "CPU")
        _kept.append(library)
        for name in ("boxes", "roi_align"):
            using = importlib.import_module(f"torchvision.ops.{name}")
            using._has_ops = using._assert_has_ops = _are_here
    return importlib.import_module("torchvision.models.detection")


def _are_here():
    return True


def _roi_align(planes, regions, scale, rows, columns, samples, aligned):
    """Means of ``samples`` squared bilinear samples in each of (rows, columns) parts of a region."""
    pooled = [planes.new_zeros((0, planes.shape[1], rows, columns))]
    for number, *edges in regions.tolist():
        x0, y0, x1, y1 = (scale * edge for edge in edges)
        plane = planes[int(number)]
        along = [
            (low + (torch.arange(count * samples) + 0.5) * max(high - low, 1.0) / (count * samples)) * 2 / (size - 1)
            for low, high, count, size in ((x0, x1, columns, plane.shape[2]), (y0, y1, rows, plane.shape[1]))
        ]  # fmt: skip
        grid = torch.stack(torch.meshgrid(*along, indexing="xy"), -1) - 1
        seen = functional.grid_sample(plane[None], grid[None], padding_mode="border", align_corners=True)
        pooled.append(functional.avg_pool2d(seen, samples))
    return torch.cat(pooled)
