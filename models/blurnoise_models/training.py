"""Training of the sign detector on rendered scenes, under one of the augmentations to be compared.

The clean scenes are drawn once into a pool, one file, that every training reads; what differs between two
trainings is the arm (what happens to the pictures on their way in) and the seed (weights, order, augmentation).
"""

from __future__ import annotations

import errno
import io
import os
import shutil
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from itertools import islice
from multiprocessing import get_context, parent_process
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.utils.rnn import pad_sequence
from torch.optim.swa_utils import AveragedModel

from blurnoise._core.files import write_whole, written_whole
from blurnoise_models.checkpoints import Checkpoint
from blurnoise_models.mixes import Arm, mix, mix_facts
from blurnoise_models.network import SIDE_MULTIPLE_PX, SignNet, loss
from blurnoise_models.scenes import scene

POOL_SEED = 1
"""Seed of the training scenes; held-out scenes have another."""
BATCH = 16
FEWEST_PICTURES = 20 * BATCH
"""In fewer, the learning rate has no time to rise and fall."""
MOST_PICTURES = 10**9
_PEAK_RATE = 3e-3
_WEIGHT_DECAY = 0.01
_STEEPEST = 10.0  # gradient norm; a rare batch of odd boxes shall not throw the weights away
_MEMORY = 0.998  # of the moving average of the weights, per step
_KEPT_EVERY = 100  # steps, about half a minute of one core
_KEPT_EVERY_S = 10.0  # s, where steps are slow: one that is stopped again and again goes on all the same
_CHUNK = 64  # scenes that a worker draws at a time


@dataclass(frozen=True)
class Pool:
    """Rendered scenes: pictures (N, H, W, 3) 8-bit sRGB RGB, boxes (N, M, 4) xyxy px, padded with zeros."""

    pictures: NDArray[np.uint8]
    boxes_xyxy: NDArray[np.float32]


@dataclass(frozen=True)
class Step:
    """One step of a training: how many pictures it has seen, and the loss of this step."""

    pictures: int
    loss: float


def pool(
    folder: Path, count: int, *, size_px: int = 320, progress: Callable[[int], None] = lambda n: None
) -> Pool:
    """The first ``count`` training scenes of ``size_px``, drawn on all cores into ``folder``, once.

    Takes 3 size_px² bytes per scene on disk (0.3 MB at 320 px). ``progress`` is told how many scenes are
    ready. Raises ``ValueError`` for a count or size that is not positive or a size no multiple of 32 px,
    ``OSError`` for less space than that, ``ChildProcessError`` where a process that draws dies.
    """
    _whole("count", count)
    _whole("size_px", size_px)
    if size_px < SIDE_MULTIPLE_PX or size_px % SIDE_MULTIPLE_PX:
        raise ValueError(f"size_px = {size_px!r}: must be a multiple of {SIDE_MULTIPLE_PX}")
    pictures, boxes = (folder / f"{what}-{count}x{size_px}.npy" for what in ("pictures", "boxes"))
    if boxes.is_file():  # written last
        progress(count)
        return Pool(np.load(pictures, mmap_mode="r"), np.load(boxes))
    _enough_space(folder, 3 * size_px**2 * count)
    folder.mkdir(parents=True, exist_ok=True)
    with written_whole(pictures) as unfinished:
        found = _drawn_into(unfinished, count, size_px, progress)
    padded = pad_sequence([*found, torch.zeros(1, 4)], batch_first=True)[:-1]  # one row at least
    content = io.BytesIO()
    np.save(content, padded.numpy())
    write_whole(boxes, content.getvalue())
    return pool(folder, count, size_px=size_px)


def _drawn_into(pictures: Path, count: int, size_px: int, progress: Callable[[int], None]) -> list[Tensor]:
    """Draw the scenes into the file ``pictures``; returns their boxes."""
    drawn = np.lib.format.open_memmap(pictures, mode="w+", dtype=np.uint8, shape=(count, size_px, size_px, 3))
    found: list[Tensor] = []
    starts = range(0, count, _CHUNK)
    workers = ProcessPoolExecutor(None, get_context("spawn"), _begin_drawing)
    try:
        drawing = workers.map(partial(_draw, count=count, size_px=size_px), starts)
        for start, (part, of_part) in zip(starts, drawing, strict=True):
            drawn[start : start + len(part)] = part
            found += [torch.from_numpy(each) for each in of_part]
            progress(len(part))
    except BrokenProcessPool:
        raise ChildProcessError("a process that drew scenes died (killed, or out of memory)") from None
    finally:
        workers.shutdown(wait=True, cancel_futures=True)
    drawn.flush()
    return found


def _enough_space(folder: Path, needed: int) -> None:
    """Raise ``OSError`` for a disk with less space than that: writing to a mapped file would end the process."""
    there = next(each for each in (folder.absolute(), *folder.absolute().parents) if each.is_dir())
    free = shutil.disk_usage(there).free
    if needed > free:
        raise OSError(
            errno.ENOSPC,
            f"the scenes take {needed / 1e9:.3g} GB, and {free / 1e9:.3g} GB are free",
            str(folder),
        )


def end_with_parent() -> None:
    """Call first in a worker: ignore interrupts, and end as soon as the parent process has ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()

    def wait() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


def _begin_drawing() -> None:
    end_with_parent()
    cv2.setNumThreads(1)


def _draw(start: int, *, count: int, size_px: int) -> tuple[NDArray[np.uint8], list[NDArray[np.float32]]]:
    scenes = [scene(POOL_SEED, index, size_px=size_px) for index in range(start, min(start + _CHUNK, count))]
    return np.stack([each.picture for each in scenes]), [each.boxes_xyxy for each in scenes]


def train(
    scenes: Pool,
    arm: Arm = "exposure",
    *,
    pictures: int,
    seed: int = 0,
    threads: int | None = None,
    checkpoint: Path | None = None,
    progress: Callable[[Step], None] = lambda step: None,
) -> SignNet:
    """Train a network on ``pictures`` pictures drawn from ``scenes`` under ``arm``; returns it in eval mode.

    AdamW with one cycle of the learning rate, batches of 16; the result holds the moving average of the
    weights. On processors with bfloat16 arithmetic the convolutions use it, which halves the time. The same
    arguments, machine and number of threads give the same network. The global generator, which Kornia draws
    from, is seeded inside and left as it was.

    checkpoint: the file that keeps a training that is not done; where it stands, that training goes on, to the same
    bits as one that was never stopped, and ``progress`` is told of its earlier steps, too. It is left for the caller
    to remove once the network is safe.
    Raises ``ValueError`` for an unknown arm, fewer than 320 pictures, a seed outside [0, 2^63), or the checkpoint of
    another training.
    """
    check(pictures, seed)
    change = mix(arm)
    before = torch.get_num_threads()
    if threads is not None:
        torch.set_num_threads(threads)
    try:
        with torch.random.fork_rng(devices=[]):
            torch.default_generator.manual_seed(seed)
            size_px = scenes.pictures.shape[1]
            recipe = {"arm": arm, "seed": seed, "pictures": pictures}
            recipe |= {"scenes": len(scenes.pictures), "size_px": size_px, **mix_facts(arm)}
            return _train(scenes, change, pictures // BATCH, seed, (checkpoint, recipe), progress)
    finally:
        torch.set_num_threads(before)


def check(pictures: int, seed: int) -> None:
    """Raise ``ValueError`` for fewer than 320 pictures, more than 1e9, or a seed outside [0, 2^63)."""
    if not 0 <= seed < 2**63:
        raise ValueError(f"seed = {seed!r}: must be an integer in [0, 2^63)")
    if not FEWEST_PICTURES <= pictures <= MOST_PICTURES:
        raise ValueError(f"pictures = {pictures!r}: must be >= {FEWEST_PICTURES} and <= {MOST_PICTURES}")


def _train(
    scenes: Pool,
    change: Callable[[Tensor, float], Tensor],
    steps: int,
    seed: int,
    kept: tuple[Path | None, dict[str, Any]],
    progress: Callable[[Step], None],
) -> SignNet:
    network, optimiser = beginner()
    average = AveragedModel(network, avg_fn=_follow, use_buffers=True)
    cycle = torch.optim.lr_scheduler.OneCycleLR(optimiser, _PEAK_RATE, total_steps=steps, pct_start=0.1)
    parts: dict[str, Any] = {"network": network, "optimiser": optimiser, "average": average, "cycle": cycle}
    checkpoint = Checkpoint(*kept, parts)
    checkpoint.resume()
    for step, value in enumerate(checkpoint.losses, start=1):
        progress(Step(step * BATCH, value))
    done = len(checkpoint.losses)
    next_kept = time.monotonic() + _KEPT_EVERY_S
    for step, chosen in enumerate(islice(_batches(len(scenes.pictures), seed), done, steps), start=done + 1):
        seen, boxes = batch(scenes, chosen)
        seen = change(seen, (step - 1) / steps)
        value = learn(network, optimiser, seen, boxes, bfloat16=has_bfloat16())
        cycle.step()
        average.update_parameters(network)
        checkpoint.losses.append(value)
        if step % _KEPT_EVERY == 0 or time.monotonic() >= next_kept:
            checkpoint.keep()
            next_kept = time.monotonic() + _KEPT_EVERY_S
        progress(Step(step * BATCH, value))
    return average.module.eval()  # type: ignore[return-value]


def _follow(average: Tensor, current: Tensor, updates: Tensor | int) -> Tensor:
    """The moving average's next value; a young one forgets faster, so that the first weights do not stay."""
    if not average.is_floating_point():  # counters
        return current
    return torch.lerp(average, current, max(1.0 - _MEMORY, 10.0 / (10.0 + int(updates))))


def beginner() -> tuple[SignNet, torch.optim.Optimizer]:
    """A network that has learnt nothing, and its optimiser."""
    network: SignNet = SignNet().to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    return network, torch.optim.AdamW(network.parameters(), lr=_PEAK_RATE, weight_decay=_WEIGHT_DECAY)


def learn(
    network: SignNet, optimiser: torch.optim.Optimizer, seen: Tensor, boxes: Tensor, *, bfloat16: bool
) -> float:
    """One step on pictures (B, 3, H, W) and their boxes (B, M, 4); returns the loss before it."""
    with torch.autocast("cpu", torch.bfloat16, enabled=bfloat16):
        answers = network(seen.contiguous(memory_format=torch.channels_last))
    value = loss(answers, boxes)
    optimiser.zero_grad()
    value.backward()  # type: ignore[no-untyped-call]
    nn.utils.clip_grad_norm_(network.parameters(), _STEEPEST)
    optimiser.step()
    return float(value.detach())


def batch(scenes: Pool, chosen: NDArray[np.int64]) -> tuple[Tensor, Tensor]:
    """Pictures (B, 3, H, W) in [0, 1] and boxes (B, M, 4) of the ``chosen`` scenes."""
    pictures = torch.from_numpy(scenes.pictures[chosen]).permute(0, 3, 1, 2).contiguous()
    return pictures.float() / 255.0, torch.from_numpy(scenes.boxes_xyxy[chosen])


def _batches(count: int, seed: int) -> Iterator[NDArray[np.int64]]:
    """Indices of batches: every scene once, in an order of the seed's, and again in another."""
    order = np.random.default_rng(seed)
    waiting = np.empty(0, np.int64)
    while True:
        while len(waiting) < BATCH:
            waiting = np.concatenate([waiting, order.permutation(count)])
        yield np.sort(waiting[:BATCH])  # sorted: the file is read in one direction
        waiting = waiting[BATCH:]


def has_bfloat16() -> bool:
    """Whether this processor computes in bfloat16 (elsewhere torch emulates it, slowly)."""
    capabilities: dict[str, Any] = getattr(torch.cpu, "get_capabilities", dict)()
    return bool(capabilities.get("avx512_bf16") or capabilities.get("amx_bf16"))


def _whole(name: str, value: int) -> None:
    if not isinstance(value, int) or value < 1:
        raise ValueError(f"{name} = {value!r}: must be an integer >= 1")
