"""Outputs in the guide: ``<!-- output of: COMMAND -->`` fills the ``text`` block below it in the build.

All commands of a build run in one temporary folder. ``python docs/hooks/outputs.py`` writes the blocks of the
pages themselves, for people who read them in the repository.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
_BLOCK = re.compile(r"(<!-- output of: (.+?) -->\n+```text\n).*?(?=^```$)", re.DOTALL | re.MULTILINE)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """The page with the output of every such command."""
    return _BLOCK.sub(lambda found: found[1] + _output(found[2]), markdown)


@cache
def _folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory()


@cache
def _output(command: str) -> str:
    """Standard output, without the temporary folder's name. Raises ``RuntimeError`` if the command fails."""
    first, *words = shlex.split(command)
    words = (
        ["-m", "blurnoise_eval.cli", *words] if first == "blurnoise" else [str(ROOT / words[0]), *words[1:]]
    )
    done = subprocess.run(
        [sys.executable, *words], cwd=_folder().name, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise RuntimeError(f"{command}: {done.stderr}")
    return re.sub(rf"\S*{re.escape(_folder().name)}/", "", done.stdout)


if __name__ == "__main__":
    for page in sorted((ROOT / "docs/pages").rglob("*.md")):
        text = page.read_text(encoding="utf-8")
        if (written := on_page_markdown(text)) != text:
            page.write_text(written, encoding="utf-8")
            print(page.relative_to(ROOT))
