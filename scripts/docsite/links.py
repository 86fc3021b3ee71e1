"""Find the links and anchors of Markdown pages, by the rules of code hosting sites."""

import re
import subprocess
import urllib.parse
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LINK = re.compile(r"\]\(([^)\s]+)\)")
CODE_BLOCK = re.compile(r"^ *```.*?^ *```\s*$|``.+?``|`[^`\n]+`", flags=re.M | re.S)


def list_files(pattern: str = "*") -> list[Path]:
    """Return the existing files that git tracks and whose paths match a pattern of
    `git ls-files`, for example "*.md"."""
    listed = subprocess.run(
        ["git", "ls-files", pattern], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    return [ROOT / name for name in listed.splitlines() if (ROOT / name).exists()]


def make_slug(heading: str) -> str:
    """Return the anchor that code hosting sites make of a heading."""
    words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).replace("`", "").replace("*", "").strip().lower()
    return re.sub(r"[^\w\- ]", "", words).replace(" ", "-")


def list_anchors(text: str) -> set[str]:
    """Return the anchors of a page: one for each heading, and the ids of HTML elements.

    If several headings have the same text, -1, -2 ... is appended to the anchor from the
    second heading on."""
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
    """Return (target file, anchor) for each link in the page `path` that points to a file
    of the repository. The anchor is empty if the link has none."""
    found = []
    for target in LINK.findall(CODE_BLOCK.sub("", path.read_text(encoding="utf-8"))):
        parts = urllib.parse.urlsplit(target)
        if not parts.scheme:
            file = (path.parent / urllib.parse.unquote(parts.path)).resolve() if parts.path else path
            found.append((file, urllib.parse.unquote(parts.fragment)))
    return found
