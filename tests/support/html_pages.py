"""Pages as tests read them: tags, text, pictures, and what their scripts draw."""

from __future__ import annotations

import base64
import json
from html.parser import HTMLParser
from typing import Any
from xml.etree import ElementTree

VOID = {"meta", "img", "input", "source", "wbr"}  # tags that are not closed
STRANGE = "<script>alert('$x$')</script> & \"é\"\u2028\x07\ud800"  # a text of users that must be shown


class Page(HTMLParser):
    """Tags that are opened and closed, attributes, and the text of the page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    def pictures(self) -> list[str]:
        """SVGs of the page's images."""
        head = "data:image/svg+xml;base64,"
        sources = [str(attrs["src"]) for tag, attrs in self.seen if tag == "img"]
        assert all(source.startswith(head) for source in sources)
        return [base64.b64decode(source.removeprefix(head), validate=True).decode() for source in sources]

    def figures(self) -> dict[str, Any]:
        """What the page's script draws."""
        scripts = [k for k, (tag, attrs) in enumerate(self.seen) if tag == "script" and attrs.get("id") == "figures"]
        return dict(json.loads(next(w for w in self.words if w.startswith('{"charts"')))) if scripts else {"charts": []}


def words(text: str) -> str:
    """Text of an SVG's labels."""
    return " ".join("".join(e.itertext()) for e in ElementTree.fromstring(text).iter() if e.tag.endswith("}text"))
