"""Flesch reading ease of the guide's pages: ``python docs/reading_ease.py [PAGE.md ...]``.

206.835 - 1.015 words per sentence - 84.6 syllables per word (Flesch, J. Appl. Psychol. 32, 1948): 60 to 70 is plain
English, below 30 hard. Only running text counts: code blocks, tables, formulas and headings are left out, and code
within a sentence counts as a word of one syllable. Exits with 1 if the mean or a page is below the guide's limits.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

LEAST_MEAN, LEAST_PAGE = 50.0, 40.0
PAGES = Path(__file__).parent / "pages"
_NOT_TEXT = re.compile(
    r"^```.*?^```$|^\$\$.*?^\$\$$|<!--.*?-->|^[ \t]*\|.*?$|^#.*?$|!\[[^\]]*\]\([^)]*\)|^(?:---?8<---?|:::|!!!|<).*?$",
    re.DOTALL | re.MULTILINE,
)
_CODE = re.compile(r"`[^`]+`|\\\(.*?\\\)|(?<!\\)\$[^$\n]+\$")
_LINK = re.compile(r"\[([^\]]*)\]\([^)]*\)")
_WORD = re.compile(r"[A-Za-z][A-Za-z'’]*")
_END = re.compile(r"[.!?](?=\s|$)|\n\s*\n|\n\s*(?:[-*]|\d+\.)\s")


def syllables(word: str) -> int:
    """Groups of vowels, without a silent e at the end; on the guide within 1 % of CMU's dictionary."""
    word = re.sub(r"['’].*", "", word.lower())
    groups = len(
        re.findall(r"[aeiouy]+", re.sub(r"(?<=[^aeiouyl])(?:e|es|ed)$|(?<=[aeiouy]l)es?$", "", word))
    )
    return max(1, groups + len(re.findall(r"(?<=[iu])(?:a|o|um)(?!u)|eo|ism$", word)) * (len(word) > 4))


def reading_ease(markdown: str) -> float:
    """Flesch reading ease of a page; infinite where it has no running text."""
    text = _LINK.sub(r"\1", _CODE.sub(" code ", _NOT_TEXT.sub("\n\n", markdown)))
    words = _WORD.findall(text)
    sentences = sum(bool(_WORD.search(part)) for part in _END.split(text))
    if not words:
        return float("inf")
    return 206.835 - 1.015 * len(words) / sentences - 84.6 * sum(map(syllables, words)) / len(words)


def main(paths: list[str]) -> int:
    """Print each page's figure, the hardest first."""
    found = sorted(
        (reading_ease(page.read_text()), page.name) for page in map(Path, paths or PAGES.rglob("*.md"))
    )
    found = [each for each in found if each[0] < float("inf")]
    for ease, name in found:
        print(f"{ease:5.1f}  {name}")
    mean = sum(ease for ease, _ in found) / len(found)
    print(f"{mean:5.1f}  mean (at least {LEAST_MEAN:g}; no page below {LEAST_PAGE:g})")
    return int(mean < LEAST_MEAN or found[0][0] < LEAST_PAGE)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
