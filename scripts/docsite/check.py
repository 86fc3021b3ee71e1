"""What a built site must be: every link and anchor leads somewhere, images exist, nothing is taken from the net.

.venv/bin/python -m docsite.check build/site
"""

from __future__ import annotations

import sys
import urllib.parse
from html.parser import HTMLParser
from pathlib import Path

LOADS = {
    "script": "src",
    "img": "src",
    "link": "href",
    "iframe": "src",
    "source": "src",
    "object": "data",
}  # what a browser fetches by itself


class Page(HTMLParser):
    """Ids, links and what is loaded, of one page."""

    def __init__(self, text: str):
        super().__init__()
        self.ids: set[str] = set()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        a = dict(attrs)
        if a.get("id"):
            self.ids.add(a["id"] or "")
        if tag == "a" and a.get("name"):
            self.ids.add(a["name"] or "")
        if tag == "a" and a.get("href"):
            self.links.append(a["href"] or "")
        if tag in LOADS and a.get(LOADS[tag]) and a.get("rel") not in ("canonical", "prev", "next", "alternate"):
            self.loads.append(a[LOADS[tag]] or "")


def wrong(site: Path) -> list[str]:
    """Sentences about what is not as it should be."""
    pages = {p: Page(p.read_text(encoding="utf-8")) for p in sorted(site.rglob("*.html")) if "examples" not in p.parts}
    found = []
    for path, page in pages.items():
        name = path.relative_to(site).as_posix()
        if name == "404.html":  # its addresses are absolute, for servers
            continue
        for target in page.loads:
            if urllib.parse.urlsplit(target).scheme not in ("", "data") or target.startswith("//"):
                found.append(f"{name}: loads {target} from the net")
            elif (
                not target.startswith("data:")
                and not (path.parent / urllib.parse.unquote(target.partition("#")[0].partition("?")[0])).is_file()
            ):
                found.append(f"{name}: {target} does not exist")
        for target in page.links:
            parts = urllib.parse.urlsplit(target)
            if parts.scheme or target.startswith("//"):
                continue
            there = (path.parent / urllib.parse.unquote(parts.path)).resolve() if parts.path else path
            if there.is_dir():
                there = there / "index.html"
            if not there.is_file():
                found.append(f"{name}: the link {target} leads nowhere")
            elif parts.fragment and there in pages and urllib.parse.unquote(parts.fragment) not in pages[there].ids:
                found.append(f"{name}: the link {target}: there is no such anchor")
    return found


def main() -> int:
    site = Path(sys.argv[1] if len(sys.argv) > 1 else "build/site").resolve()
    if not (site / "index.html").is_file():
        print(f"{site}: is no built site; scripts/docs.sh builds it", file=sys.stderr)
        return 2
    for sentence in (found := wrong(site)):
        print(f"docs: {sentence}", file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
