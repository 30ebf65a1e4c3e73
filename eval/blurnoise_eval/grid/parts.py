"""Parts of a set of pictures, told by the pictures' names alone: the same on every machine."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass


@dataclass(frozen=True)
class Part:
    """The ``number``th of ``count`` parts, from 1 on."""

    number: int
    count: int

    @classmethod
    def parse(cls, text: str) -> Part:
        """Of "1/4". Raises ``ValueError`` for anything else."""
        found = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text)
        if not found or not 1 <= int(found[1]) <= int(found[2]):
            raise ValueError(f"part = {text!r}: must be K/N with 1 <= K <= N, such as 1/4")
        return cls(int(found[1]), int(found[2]))

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    def has(self, picture: str) -> bool:
        """Whether a picture of this name belongs to it, by the name's hash."""
        digest = hashlib.blake2b(picture.encode("utf-8", "surrogatepass"), digest_size=8).digest()
        return int.from_bytes(digest, "little") % self.count == self.number - 1
