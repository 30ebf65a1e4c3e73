"""Pages of reports, read back as a browser would: words, tags, addresses, scripts."""

import json
from html.parser import HTMLParser


class Page(HTMLParser):
    """Visible text, tags and the addresses that a browser would fetch or follow."""

    def __init__(self, page):
        super().__init__()
        self.tags: list[str] = []
        self.addresses: list[str] = []
        self.scripts: list[str] = []
        self.words: list[str] = []
        self.feed(page.read_text(encoding="utf-8"))
        self.text = " ".join(" ".join(self.words).split())

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.addresses += [
            value or "" for name, value in attrs if name in ("src", "href", "srcset", "action")
        ]
        assert not any(name.startswith("on") for name, _ in attrs)

    def handle_data(self, data):
        inside = self.tags[-1] if self.tags else ""
        (self.scripts if inside == "script" else self.words).append(data)

    @property
    def numbers(self):
        """What the page's script draws, its tables as lists of records."""
        found = next(json.loads(text) for text in self.scripts if text.startswith("{"))
        return {name: records(value) for name, value in found.items()}


def records(value):
    """Of columns and rows a dictionary a row; anything else as it is."""
    if not isinstance(value, dict) or set(value) != {"columns", "rows"}:
        return value
    return [dict(zip(value["columns"], row, strict=True)) for row in value["rows"]]
