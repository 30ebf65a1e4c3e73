"""Signature of a graph, read from its session; where shapes are dynamic, measured on a grey picture."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.detectors.formats.candidates import FloatArray
from blurnoise_eval.detectors.formats.placement import blob_shape
from blurnoise_eval.detectors.formats.signature import (
    DTYPES,
    Shape,
    Signature,
    TensorInfo,
    check_input,
    extra_feeds,
)
from blurnoise_eval.detectors.session import Session


def read_signature(session: Session, metadata: Mapping[str, str], size_px: tuple[int, int]) -> Signature:
    """Return the graph's signature.

    ``size_px``: the picture's (height, width) where the graph leaves it open. Raises :class:`ModelError` for
    a graph that leaves it open and fails at that size.
    """
    inputs = sorted(
        (_info(entry) for entry in session.bare.get_inputs()), key=lambda entry: entry.axes is None
    )
    outputs = tuple(_info(entry) for entry in session.bare.get_outputs())
    axes = inputs[0].axes if inputs else None
    if axes is None:
        return Signature(tuple(inputs), outputs, metadata, None)
    shape = inputs[0].shape
    stated = shape[1:3] if axes == "nhwc" else shape[-2:]
    height, width = (
        known if isinstance(known, int) else usual for known, usual in zip(stated, size_px, strict=True)
    )
    batch = shape[0] if len(shape) == 4 and isinstance(shape[0], int) else 1
    check_input("the graph", batch, height, width)
    extras = extra_feeds(inputs[1:], (height, width), batch)
    if extras is None:
        return Signature(tuple(inputs), outputs, metadata, None)
    grey = np.full(blob_shape(axes, (height, width)), 0.5, np.float32)
    answer = partial(_answer, session, inputs[0], batch, extras)
    fixed = stated == (height, width)
    if not fixed or not all(o.shape and all(isinstance(n, int) for n in o.shape[1:]) for o in outputs):
        try:
            measured: list[Shape] = [value.shape for value in answer(grey)]
        except ModelError as error:
            raise ModelError(
                f"the graph claims a dynamic size but fails on a picture of {height} x {width} px; "
                f"state input_size_px in its contract ({' '.join(str(error).split())[:200]})"
            ) from None
        outputs = tuple(TensorInfo(o.name, s, o.type) for o, s in zip(outputs, measured, strict=True))
    return Signature(tuple(inputs), outputs, metadata, (height, width), answer)


def _info(entry: Any) -> TensorInfo:
    return TensorInfo(entry.name, tuple(entry.shape), entry.type)


def _answer(
    session: Session, image: TensorInfo, batch: int, extras: dict[str, Any], blob: FloatArray
) -> list[FloatArray]:
    feed = np.repeat(blob, batch, axis=0) if batch > 1 else blob
    found = session.run(None, {image.name: np.ascontiguousarray(feed, DTYPES[image.type]), **extras})
    return [np.asarray(value) for value in found]
