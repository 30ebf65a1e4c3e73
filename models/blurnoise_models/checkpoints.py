"""Checkpoints of a training: all that its next steps depend on, so that it goes on with the bits of an unbroken one.

A file holds weights, optimiser, moving average, learning rate, torch's generator and the losses so far; the order of
the pictures follows from the seed and the number of steps. It appears whole or not at all.
"""

from __future__ import annotations

import io
import pickle
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import torch

from blurnoise._core.files import write_whole


class Part(Protocol):
    """A piece of a training that has a state."""

    def state_dict(self) -> Any:
        """The state, of tensors and plain values."""
        ...

    def load_state_dict(self, state_dict: Any, /) -> Any:
        """Take over a state."""
        ...


@dataclass
class Checkpoint:
    """Where a training is kept, and how far it is.

    path: None: it is not kept. recipe: what the training is; a file of another one is refused. parts: whose states
    are kept, by name. losses: of the steps so far.
    """

    path: Path | None
    recipe: Mapping[str, Any]
    parts: Mapping[str, Part]
    losses: list[float] = field(default_factory=list)

    def resume(self) -> None:
        """Take over what the file holds, if there is one. Raises ``ValueError`` for another training's."""
        if self.path is None or not self.path.is_file():
            return
        try:
            held = torch.load(self.path, weights_only=True)
            recipe, losses, generator = held["recipe"], held["losses"], held["generator"]
            states = [(part, held["parts"][name]) for name, part in self.parts.items()]
        except (RuntimeError, EOFError, KeyError, TypeError, pickle.UnpicklingError):
            raise ValueError(f"checkpoint = {str(self.path)!r}: is none; remove it to begin anew") from None
        if recipe != self.recipe:
            raise ValueError(
                f"checkpoint = {str(self.path)!r}: was begun with {recipe}, not with {dict(self.recipe)}; choose "
                "another folder, repeat the command that it comes from, or remove it"
            )
        for part, state in states:
            part.load_state_dict(state)
        torch.set_rng_state(generator)
        self.losses = losses

    def keep(self) -> None:
        """Write the file. Raises ``OSError``."""
        if self.path is None:
            return
        self.path.parent.mkdir(parents=True, exist_ok=True)
        states = {name: part.state_dict() for name, part in self.parts.items()}
        content = io.BytesIO()
        torch.save(
            {
                "recipe": dict(self.recipe),
                "parts": states,
                "generator": torch.get_rng_state(),
                "losses": self.losses,
            },
            content,
        )
        write_whole(self.path, content.getvalue())
