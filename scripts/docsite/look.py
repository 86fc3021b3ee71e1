"""Pictures of pages as readers see them - light, dark, phone, print - into build/site-look, by a headless browser.

.venv/bin/python -m docsite.look [PAGE.html ...]     of the site by default; also reports of tselab
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SITE, OUT = ROOT / "build" / "site", ROOT / "build" / "site-look"
PAGES = (
    "index.html",
    "results/peers.html",
    "results/index.html",
    "method/model.html",
    "method/ten-minutes.html",
    "reference/python.html",
    "reference/config.html",
    "gap/effects/body_roll.html",
    "help/troubleshooting.html",
    "examples/report.html",
)
WIDE, PHONE, HEIGHT = 1400, 390, 1300  # CSS px; a phone's viewport
PATIENCE = 20_000  # ms of the page's own clock: plots draw themselves


def browser() -> str | None:
    return next(
        (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None
    )


def take(page: Path, out: Path, name: str) -> list[Path]:
    """NAME-light.png, -dark.png, -phone.png and -print.pdf of a page."""
    program = browser()
    if program is None:
        raise FileNotFoundError("chromium")
    out.mkdir(parents=True, exist_ok=True)
    phone = out / f"{name}-phone.html"  # the window of a browser has a least width; a frame has not
    phone.write_text(
        f'<body style="margin:0"><iframe src="{page.as_uri()}" style="border:0;width:{PHONE}px;height:{HEIGHT}px"></iframe>',
        encoding="utf-8",
    )
    usual = [
        program,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--hide-scrollbars",
        "--allow-file-access-from-files",
        f"--virtual-time-budget={PATIENCE}",
    ]
    dark = "--blink-settings=preferredColorScheme=0"
    made = []
    for kind, address, width, more in (
        ("light", page.as_uri(), WIDE, ["--blink-settings=preferredColorScheme=1"]),
        ("dark", page.as_uri(), WIDE, [dark]),
        ("phone", phone.as_uri(), 520, ["--blink-settings=preferredColorScheme=1"]),
        ("print", page.as_uri(), WIDE, []),
    ):
        target = out / f"{name}-{kind}.{'pdf' if kind == 'print' else 'png'}"
        shot = f"--print-to-pdf={target}" if kind == "print" else f"--screenshot={target}"
        done = subprocess.run(
            [*usual, *more, f"--window-size={width},{HEIGHT}", shot, address],
            capture_output=True,
            text=True,
            timeout=120,
        )
        if not target.is_file():
            raise RuntimeError(f"{program} made no picture of {page}: {done.stderr[-500:]}")
        made.append(target)
    phone.unlink()
    return made


def main() -> int:
    if browser() is None:
        print("docs: no chromium: no pictures (Debian and Ubuntu: the package chromium)", file=sys.stderr)
        return 1
    pages = [Path(a).resolve() for a in sys.argv[1:]] or [SITE / p for p in PAGES if (SITE / p).is_file()]
    for page in pages:
        name = (
            (page.relative_to(SITE) if page.is_relative_to(SITE) else Path(page.name))
            .with_suffix("")
            .as_posix()
            .replace("/", "-")
        )
        for path in take(page, OUT, name):
            print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
