"""Find the links and anchors of Markdown pages, by the rules of code hosting sites."""

import re
import subprocess
import urllib.parse
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LINK = re.compile(r"\]\(([^)\s]+)\)")
CODE_BLOCK = re.compile(r"^ *```.*?^ *```\s*$|``.+?``|`[^`\n]+`", flags=re.M | re.S)


def list_files(pattern: str = "*") -> list[Path]:
    """Return the files in git whose names match a pattern."""
    listed = subprocess.run(
        ["git", "ls-files", pattern], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    return [ROOT / name for name in listed.splitlines() if (ROOT / name).exists()]


def make_slug(heading: str) -> str:
    """Return the anchor that code hosting sites make of a heading."""
    words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).replace("`", "").replace("*", "").strip().lower()
    return re.sub(r"[^\w\- ]", "", words).replace(" ", "-")


def list_anchors(text: str) -> set[str]:
    """Return the anchors of a page: those of its headings, and ids in HTML.

    If a heading occurs again, its anchor ends with a number."""
    prose = re.sub(r"^ *```.*?^ *```\s*$", "", text, flags=re.M | re.S)
    found: set[str] = set()
    for heading in re.findall(r"^#+ (.*)$", prose, flags=re.M):
        base = name = make_slug(heading)
        n = 0
        while name in found:
            n += 1
            name = f"{base}-{n}"
        found.add(name)
    return found | set(re.findall(r'\bid="([^"]+)"', prose))


def list_local_links(path: Path) -> list[tuple[Path, str]]:
    """Return target file and anchor of each link of a page to a file of the
    repository."""
    found = []
    for target in LINK.findall(CODE_BLOCK.sub("", path.read_text(encoding="utf-8"))):
        parts = urllib.parse.urlsplit(target)
        if not parts.scheme:
            file = (path.parent / urllib.parse.unquote(parts.path)).resolve() if parts.path else path
            found.append((file, urllib.parse.unquote(parts.fragment)))
    return found
