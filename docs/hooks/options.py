"""Options in code: no line of the guide ends within one, as browsers would have it at every hyphen."""

from __future__ import annotations

import re
from typing import Any

_CODE = re.compile(r"<code\b[^>]*>.*?</code>", re.DOTALL)
_OPTION = re.compile(r"<[^>]*>|(?<![\w-])(--?[a-z][\w-]*)")


def on_page_content(html: str, **_: Any) -> str:
    """The page with every option in a span that style.css keeps whole."""
    return _CODE.sub(lambda code: _OPTION.sub(_whole, code[0]), html)


def _whole(found: re.Match[str]) -> str:
    return f'<span class="option">{found[1]}</span>' if found[1] else found[0]
