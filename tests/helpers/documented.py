"""What README and the guide show: their blocks of commands and of Python, and what of it is not run as it stands."""

import re
import shlex
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGES = ("README.md", *sorted(str(path.relative_to(ROOT)) for path in (ROOT / "docs/pages").rglob("*.md")))
_BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NO_COMMAND_OF_OURS = (
    "python3 -m venv",  # CI runs these in fresh environments
    ".venv/bin/pip install",
    "pip install --no-deps rapidocr",
    "pip install -c constraints.txt --no-deps albumentations",
    "export AWS_PROFILE",
)
LONG = {
    "blurnoise train": "under an hour; tests/models has a short one",
    "blurnoise explore": "serves a page for as long as it is wanted; tests/eval/explorer has it",
    "blurnoise measure -o": "minutes; tests/eval/measure has it",
}
SUBSTITUTES = (
    ("--engine ray --plan cluster.yaml", "--engine processes"),  # tests/eval/sweep has Ray's
    ("--count 100", "--count 2"),
    ("--images DIR", "--images photos/"),
    ("s3://bucket", "file://{folder}/bucket"),  # tests/eval/system has S3's
    ("--model trained/stop_sign.onnx", "--model m.onnx"),
    ("-o run # decide", "--lux 1,1000 --dx 0,1000 -o run"),  # in place of a minute
)


def blocks(page, language):
    """The blocks of a page in a language, without the examples, which are files of their own."""
    text = (ROOT / page).read_text(encoding="utf-8")
    return [found[2] for found in _BLOCK.finditer(text) if found[1] == language and "--8<--" not in found[2]]


def commands(page):
    """The words of every command of a page, without its remark."""
    for block in blocks(page, "bash"):
        for line in block.replace("\\\n", " ").splitlines():
            if words := shlex.split(line, comments=True):
                yield words


def settings(page):
    """Files of settings that a page shows, by the name in their first line."""
    return {
        text.splitlines()[0].removeprefix("# "): text
        for text in blocks(page, "yaml")
        if text.startswith("# ")
    }


def ours(page):
    """The words behind "blurnoise" of those commands that are ours."""
    return [words[1:] for words in commands(page) if words[0] == "blurnoise"]


def substituted(words, folder):
    """The words with made-up files and machines in place of those that a test does not have."""
    text = shlex.join(words) + (" # decide" if words[0] == "decide" else "")
    for stated, taken in SUBSTITUTES:
        text = text.replace(stated, taken.format(folder=folder))
    return shlex.split(text, comments=True)


def is_long(words):
    if words[0] == "explore" and "-o" in words:  # writes a picture and ends
        return False
    return any(["blurnoise", *words][: len(long.split())] == long.split() for long in LONG)
