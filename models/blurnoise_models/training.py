"""Training of the sign detector on rendered scenes, each of which is drawn once."""

from __future__ import annotations

import io
import pickle
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.utils.rnn import pad_sequence
from torch.optim.swa_utils import AveragedModel

from blurnoise._core.writing import write_whole
from blurnoise_models.network import SIDE_MULTIPLE_PX, SignNet, loss
from blurnoise_models.scenes import scene

Augmentation = Callable[[Tensor, Tensor, float], Tensor]
"""Pictures (B, 3, H, W) in [0, 1], what in them retroreflects (B, 1, H, W), and how much of the training is done,
0 to 1, to pictures of the same shape."""
SCENES_SEED = 1
"""Seed of the training scenes; held-out scenes have another."""
BATCH = 16
FEWEST_PICTURES = 20 * BATCH
"""In fewer, the learning rate has no time to rise and fall."""
_PEAK_RATE = 3e-3
_WEIGHT_DECAY = 0.01
_LARGEST_GRADIENT = 10.0  # norm; a rare batch of odd boxes must not throw the weights away
_MEMORY = 0.998  # of the moving average of the weights, per step
_SAVED_EVERY_S = 10.0


def train(
    augmentation: Augmentation | None = None,
    *,
    pictures: int,
    size_px: int = 320,
    seed: int = 0,
    threads: int | None = None,
    facts: dict[str, Any] | None = None,
    checkpoint: Path | None = None,
    progress: Callable[[int, float], None] = lambda pictures, loss: None,
) -> SignNet:
    """Train a network on the first ``pictures`` training scenes of ``size_px``, augmented; returns it in eval mode.

    AdamW with one cycle of the learning rate, batches of 16; the result holds the moving average of the
    weights. On processors with bfloat16 arithmetic the convolutions use it, which halves the time. The same
    arguments, machine and number of threads give the same network. The global generator, which Kornia draws
    from, is seeded inside and left as it was.

    checkpoint: a file that holds an unfinished training; if it exists, that training goes on, to the same bits as one
    that was never stopped. The caller removes it once the network is safe. progress: gets the number of pictures so
    far and the loss before each step, of earlier steps too. facts: what tells this training from others.
    Raises ``ValueError`` for fewer than 320 pictures, a seed outside [0, 2^63), a size that is no multiple of 32 px,
    or the checkpoint of another training.

    >>> train(pictures=100)
    Traceback (most recent call last):
        ...
    ValueError: pictures = 100: must be >= 320 and <= 1e9
    """
    if not 0 <= seed < 2**63:
        raise ValueError(f"seed = {seed!r}: must be an integer in [0, 2^63)")
    if not FEWEST_PICTURES <= pictures <= 10**9:
        raise ValueError(f"pictures = {pictures!r}: must be >= {FEWEST_PICTURES} and <= 1e9")
    if size_px < SIDE_MULTIPLE_PX or size_px % SIDE_MULTIPLE_PX:
        raise ValueError(f"size_px = {size_px!r}: must be a positive multiple of {SIDE_MULTIPLE_PX}")
    threads_before = torch.get_num_threads()
    if threads is not None:
        torch.set_num_threads(threads)
    try:
        with torch.random.fork_rng(devices=[]):
            torch.default_generator.manual_seed(seed)
            recipe = {"seed": seed, "pictures": pictures, "size_px": size_px, **(facts or {})}
            run = Training(pictures // BATCH, recipe, checkpoint)
            run.resume()
            for step, value in enumerate(run.losses, start=1):
                progress(step * BATCH, value)
            return run.go_on(augmentation, size_px, progress)
    finally:
        torch.set_num_threads(threads_before)


class Training:
    """Everything that the next step of a training depends on; its checkpoint holds the same, and appears whole.

    >>> training = Training(steps=20, recipe={"seed": 0}, checkpoint=None)
    >>> loss_before = training.learn(torch.rand(1, 3, 64, 64), torch.tensor([[[8.0, 8.0, 40.0, 40.0]]]))
    >>> loss_before > 0
    True
    """

    def __init__(self, steps: int, recipe: dict[str, Any], checkpoint: Path | None) -> None:
        self.steps, self.recipe, self.checkpoint = steps, recipe, checkpoint
        self.losses: list[float] = []
        self.network = SignNet().to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.optimiser = torch.optim.AdamW(
            self.network.parameters(), lr=_PEAK_RATE, weight_decay=_WEIGHT_DECAY
        )
        self.average = AveragedModel(self.network, avg_fn=_follow, use_buffers=True)
        self.cycle = torch.optim.lr_scheduler.OneCycleLR(
            self.optimiser, _PEAK_RATE, total_steps=steps, pct_start=0.1
        )
        self.parts: list[Any] = [self.network, self.optimiser, self.average, self.cycle]

    def go_on(
        self, augmentation: Augmentation | None, size_px: int, progress: Callable[[int, float], None]
    ) -> SignNet:
        """Take the steps that are left; returns the network with averaged weights."""
        saved = time.monotonic()
        done = len(self.losses)
        for step, (seen, returns, boxes) in enumerate(_batches(done, self.steps, size_px), start=done):
            if augmentation is not None:
                seen = augmentation(seen, returns, step / self.steps)
            self.losses.append(self.learn(seen, boxes))
            self.cycle.step()
            self.average.update_parameters(self.network)
            if time.monotonic() >= saved + _SAVED_EVERY_S:
                self.save()
                saved = time.monotonic()
            progress((step + 1) * BATCH, self.losses[-1])
        return self.average.module.eval()  # type: ignore[return-value]

    def learn(self, seen: Tensor, boxes: Tensor) -> float:
        """One step on pictures (B, 3, H, W) and their boxes (B, M, 4); returns the loss before it."""
        with torch.autocast("cpu", torch.bfloat16, enabled=has_bfloat16()):
            answers = self.network(seen.contiguous(memory_format=torch.channels_last))
        value = loss(answers, boxes)
        self.optimiser.zero_grad()
        value.backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(self.network.parameters(), _LARGEST_GRADIENT)
        self.optimiser.step()
        return float(value.detach())

    def resume(self) -> None:
        """Go on where the checkpoint ends, if there is one. Raises ``ValueError`` for another training's."""
        if self.checkpoint is None or not self.checkpoint.is_file():
            return
        given = f"checkpoint = {str(self.checkpoint)!r}: remove it, or choose another folder; it "
        try:
            held = torch.load(self.checkpoint, weights_only=True)
            recipe, losses, states, generator = map(held.get, ("recipe", "losses", "states", "generator"))
        except (RuntimeError, EOFError, AttributeError, pickle.UnpicklingError):
            raise ValueError(f"{given}is no checkpoint of a training") from None
        if recipe != self.recipe:
            raise ValueError(f"{given}was begun with {recipe}, not with {self.recipe}")
        for part, state in zip(self.parts, states, strict=True):
            part.load_state_dict(state)
        torch.set_rng_state(generator)
        self.losses = losses

    def save(self) -> None:
        """Write the checkpoint. Raises ``OSError``."""
        if self.checkpoint is None:
            return
        self.checkpoint.parent.mkdir(parents=True, exist_ok=True)
        held = {"recipe": self.recipe, "losses": self.losses, "generator": torch.get_rng_state()}
        content = io.BytesIO()
        torch.save({**held, "states": [part.state_dict() for part in self.parts]}, content)
        write_whole(self.checkpoint, content.getvalue())


def _follow(average: Tensor, current: Tensor, updates: Tensor | int) -> Tensor:
    """The moving average's next value; a young one forgets faster, so that the first weights do not stay."""
    if not average.is_floating_point():  # counters
        return current
    return torch.lerp(average, current, max(1.0 - _MEMORY, 10.0 / (10.0 + int(updates))))


def batch(first: int, count: int = BATCH, *, size_px: int = 320) -> tuple[Tensor, Tensor, Tensor]:
    """Training scenes ``first``, ``first`` + 1, ...: pictures (B, 3, H, W) in [0, 1], what in them retroreflects
    (B, 1, H, W), boxes (B, M, 4) xyxy px.

    Rows of boxes are padded with zeros.

    >>> pictures, returns, boxes = batch(0, 2, size_px=64)
    >>> pictures.shape, boxes.shape[2]
    (torch.Size([2, 3, 64, 64]), 4)
    """
    drawn = [scene(SCENES_SEED, index, size_px=size_px) for index in range(first, first + count)]
    pictures = torch.from_numpy(np.stack([each.picture for each in drawn])).permute(0, 3, 1, 2)
    boxes = [torch.from_numpy(each.boxes_xyxy) for each in drawn]
    padded = pad_sequence([*boxes, torch.zeros(1, 4)], batch_first=True)[:-1]  # one row at least
    returns = torch.from_numpy(np.stack([each.retroreflects for each in drawn]))[:, None]
    return pictures.contiguous().float() / 255.0, returns, padded


def _batches(first: int, last: int, size_px: int) -> Iterator[tuple[Tensor, Tensor, Tensor]]:
    """Batches ``first`` to ``last`` - 1; each is drawn while the one before it is learnt."""
    with ThreadPoolExecutor(1) as artist:
        coming = artist.submit(batch, first * BATCH, size_px=size_px)
        for number in range(first + 1, last + 1):
            ready = coming.result()
            coming = artist.submit(batch, number * BATCH, size_px=size_px)
            yield ready


def has_bfloat16() -> bool:
    """Whether this processor computes in bfloat16 (elsewhere torch emulates it, slowly).

    >>> has_bfloat16() in (True, False)  # by the processor
    True
    """
    capabilities: dict[str, Any] = getattr(torch.cpu, "get_capabilities", dict)()
    return bool(capabilities.get("avx512_bf16") or capabilities.get("amx_bf16"))
