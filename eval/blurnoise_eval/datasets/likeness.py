"""Likeness of pictures: which of them show the same scene.

Domain: perceptual hashes of 64 bits, 16 hexadecimal digits. A hash is made of the signs of a small grey picture's low
cosine frequencies about their median (Zauner, Implementation and Benchmarking of Perceptual Image Hash Functions,
2010), so noise, another exposure or a shift by a fiftieth of the width turn few bits; unrelated pictures differ in
half. Of 35 unrelated photographs no two came closer than 18 bits; 90 % of the same ones shifted by up to 8 of 640 px,
at half to 1.6 times the light and with 4 to 8 % noise stay within 8.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.datasets.images import eight_bit
from blurnoise_eval.datasets.records import Image

NEAR = 10
"""Bits by which hashes of one scene differ at most."""
MOST = 2000
"""Pictures that are compared, each with each: 0.1 s, 50 MB. Of more, as many are taken evenly."""
_SIDE, _FREQUENCIES = 32, 8
_ENOUGH = 256  # px of the shorter side, of which the small picture is made: 64 each of its values
_STRUCTURE = 2.0  # DN of 255: standard deviation of the small picture below which there is nothing to compare


def perceptual_hash(picture: Image) -> str:
    """The hash of a picture, (H, W) or (H, W, 3), 8 or 16 bit or light; empty for one without structure."""
    if picture.dtype == np.float32:
        picture = eight_bit(picture)
    step = max(1, min(picture.shape[:2]) // _ENOUGH)
    sampled = np.ascontiguousarray(picture[::step, ::step])
    small = cv2.resize(sampled, (_SIDE, _SIDE), interpolation=cv2.INTER_AREA).astype(np.float32)
    grey = small.mean(axis=2) if small.ndim == 3 else small
    grey *= 255 / (255 if picture.dtype == np.uint8 else 65535)
    if grey.std() < _STRUCTURE:
        return ""
    low = cv2.dct(grey)[:_FREQUENCIES, :_FREQUENCIES].ravel()[1:]  # the mean is exposure
    bits = np.concatenate([[False], low > np.median(low)])
    return np.packbits(bits).tobytes().hex()


def scenes(looks: Sequence[str], clusters: Sequence[str] = ()) -> NDArray[np.int64]:
    """The scene of each picture, (N,) numbered from 0: pictures within ``NEAR`` bits, or linked by others that are.

    A picture without a hash is a scene of its own. clusters: the name of each one's; pictures of one cluster are one
    scene, too.

    >>> scenes(["f0f0f0f0f0f0f0f0", "f0f0f0f0f0f0f0f1", "", "0f0f0f0f0f0f0f0f"]).tolist()
    [0, 0, 1, 2]
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    there = np.flatnonzero([bool(look) for look in looks])
    hashes = np.array([int(looks[index], 16) for index in there.tolist()], np.uint64)
    alike = there[np.stack(np.nonzero(np.bitwise_count(hashes[:, None] ^ hashes) <= NEAR))]
    first = {name: index for index, name in reversed(list(enumerate(clusters)))}
    of_cluster = np.array([(index, first[name]) for index, name in enumerate(clusters)], np.int64).reshape(
        -1, 2
    )
    one, other = np.concatenate([of_cluster.T, alike], axis=1)
    graph = coo_array((np.ones(len(one), bool), (one, other)), shape=(len(looks), len(looks)))
    _, labels = connected_components(graph, directed=False)
    return np.asarray(labels, np.int64)
