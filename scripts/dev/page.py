#!/usr/bin/env python3
"""Build the web page that runs the simulator and the filter in the browser.

    .venv/bin/python scripts/dev/page.py
        write the page to one file, build/site/try.html
    .venv/bin/python scripts/dev/page.py --out FILE
        write the page to a different file
    .venv/bin/python scripts/dev/page.py --without-npm
        build the page as on a machine without npm: it reads CSV logs, but no Parquet logs
        and no vehicle files, and displays a message if the user opens such a file
    .venv/bin/python scripts/dev/page.py --ship
        write the page to docs/try.html. This file is in git, so that users need no
        compiler
    .venv/bin/python scripts/dev/page.py --check
        fail if the sources of the page have changed since docs/try.html was built

clang and wasm-ld compile the library to WebAssembly. If they are missing, zig compiles it
(scripts/setup.sh platforms). The names, units and rules with which the page reads and
checks logs are copied from the Python sources of tselab. Settings, ranges and structs are
read from the library when the page opens. `npm ci` fetches a reader of Parquet and a
reader of TOML. docs/page/package-lock.json has the hashes of both, and the page contains
their licences. The same sources and compiler give the same bytes.
"""

import argparse
import base64
import hashlib
import importlib.util
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ROOT / "docs" / "page"
SHARED = ROOT / "scripts" / "tse" / "report" / "templates"  # files of the page of `tselab live`
BUILD = ROOT / "build" / "page"
PAGE = ROOT / "build" / "site" / "try.html"
SHIPPED = ROOT / "docs" / "try.html"
# scripts of the page, in the order in which they run
SCRIPTS = ("core.js", "text.js", "map.js", "check.js", "run.js", "draw.js", "log.js", "drive.js", "start.js")
FLAGS = (
    "-std=c99",
    "-O2",
    "-nostdlib",
    "-ffp-contract=off",
    "-mbulk-memory",
    "-Wall",
    "-Wextra",
    "-Werror",
    "-DTSE_REAL_DOUBLE",
    "-DTSE_NO_PARTICLES",
)
# Linker options. The stack of the WebAssembly program has 262144 bytes, of which the
# filter needs only 5 kB.
LINK = ("-Wl,--no-entry", "-Wl,--strip-all", "-Wl,-z,stack-size=262144")
# Built-in example: a drive of SECONDS [s] with double lane changes. ROAD is (time [s],
# factor): from 30 s on, the stiffness of all tyres is 0.7 times the nominal one.
DRIVE = "double-lane-change"
SECONDS = 60.0
ROAD = (30.0, 0.7)
SEED = 1


# Max number of rows in which the page searches for channels that contradict each other:
# 22 minutes at 100 Hz. There is a limit because the page does not respond meanwhile.
MAX_CHECKED_ROWS = 1 << 17


class Failed(Exception):
    """The page cannot be built. The message is the reason."""


def run_command(command: list[str], **more: Any) -> str:
    """Run a command. Return its output. `more`: arguments of subprocess.run().

    Raises
    ------
    Failed
        The exit code is not 0.
    """
    done = subprocess.run(command, capture_output=True, text=True, check=False, **more)
    if done.returncode:
        raise Failed(f"{Path(command[0]).name} failed:\n{(done.stderr + done.stdout).strip()[-2000:]}")
    return done.stdout


def find_compilers() -> list[list[str]]:
    """Return the installed compilers from C to WebAssembly: commands with options.

    Raises
    ------
    Failed
        No such compiler is installed.
    """
    found = []
    if shutil.which("clang") and shutil.which("wasm-ld"):
        found.append(["clang", "--target=wasm32"])
    if importlib.util.find_spec("ziglang"):
        found.append(
            [sys.executable, "-m", "ziglang", "cc", "-target", "wasm32-freestanding", "-Wl,--export-memory"]
        )
    if found:
        return found
    raise Failed(
        "no compiler for WebAssembly is installed: install clang and lld, or run "
        "scripts/setup.sh platforms (zig)"
    )


def write_library() -> Path:
    """Write the C library as the two files tse.h and tse.c. Return their folder."""
    BUILD.mkdir(parents=True, exist_ok=True)
    run_command(
        [sys.executable, str(ROOT / "scripts" / "dev" / "amalgamate.py"), "--out", str(BUILD / "src")]
    )
    return BUILD / "src"


def compute_digest() -> str:
    """Return a hash of the sources of the page.

    It depends neither on the compiler nor on the contents of the npm packages."""
    files = [
        *sorted(write_library().iterdir()),
        *(SOURCES / name for name in ("page.c", "page.html", "vendor.js", "package-lock.json")),
    ]
    files += [(SHARED if name == "draw.js" else SOURCES) / name for name in SCRIPTS] + [SHARED / "page.css"]
    made = hashlib.sha256(json.dumps([FLAGS, LINK, collect_names(), make_example()]).encode())
    for file in files:
        made.update(file.read_bytes())
    return made.hexdigest()[:16]


def read_shipped_digest() -> str:
    """Return the hash of sources in docs/try.html; "" if the file or hash is missing."""
    found = (
        re.search(r'<meta name="sources" content="(\w+)">', SHIPPED.read_text(encoding="utf-8"))
        if SHIPPED.is_file()
        else None
    )
    return found[1] if found else ""


def compile_wasm(cc: list[str] | None = None) -> bytes:
    """Compile the library to WebAssembly, unless the binary is up to date. Return it.

    `cc`: compiler and its options; None: the first of find_compilers()."""
    write_library()
    out, mark = BUILD / "tse.wasm", BUILD / "tse.wasm.of"
    cc = cc or find_compilers()[0]
    libc = ROOT / "tests" / "embedded" / "wasm"  # string.h: memcpy() etc., which the library calls
    of = [
        repr((cc, FLAGS, LINK)).encode(),
        run_command([*cc, "--version"]).encode(),
        (SOURCES / "page.c").read_bytes(),
    ]
    of += [(libc / "string.h").read_bytes()]
    of += [f.read_bytes() for f in sorted((BUILD / "src").iterdir()) if f.is_file()]
    wanted = hashlib.sha256(b"".join(of)).hexdigest()
    if out.exists() and mark.exists() and mark.read_text() == wanted:
        return out.read_bytes()
    places = [f"-I{BUILD / 'src'}", f"-I{ROOT / 'include'}", f"-I{libc}"]
    run_command(
        [*cc, *FLAGS, *places, str(BUILD / "src" / "tse.c"), str(SOURCES / "page.c"), "-o", str(out), *LINK]
    )
    mark.write_text(wanted)
    return out.read_bytes()


def bundle_npm() -> tuple[str, str]:
    """Return the npm packages as one script, and the text of their licences.

    Raises
    ------
    Failed
        npm is not installed, or cannot fetch the packages.
    """
    for program in ("node", "npm"):
        if not shutil.which(program):
            raise Failed(f"{program} is not installed")
    install_modules()
    folder = BUILD / "npm"
    shutil.copy(SOURCES / "vendor.js", folder / "vendor.js")
    run_command(
        [
            str(folder / "node_modules" / ".bin" / "esbuild"),
            "vendor.js",
            "--bundle",
            "--minify",
            "--format=iife",
            "--target=es2022",
            "--global-name=vendor",
            "--legal-comments=none",
            "--outfile=bundle.js",
            "--metafile=bundle.json",
        ],
        cwd=folder,
    )
    inputs = json.loads((folder / "bundle.json").read_text())["inputs"]
    names = sorted({found[1] for x in inputs if (found := re.match(r"node_modules/((?:@[^/]+/)?[^/]+)/", x))})
    return (folder / "bundle.js").read_text(), "\n".join(
        read_licence(folder / "node_modules" / name) for name in names
    )


def install_modules() -> Path:
    """Install the npm packages of docs/page/package-lock.json. Return node_modules."""
    folder, files = BUILD / "npm", [SOURCES / "package.json", SOURCES / "package-lock.json"]
    wanted = hashlib.sha256(b"".join(f.read_bytes() for f in files)).hexdigest()
    mark = folder / "installed"
    if not mark.exists() or mark.read_text() != wanted:
        folder.mkdir(parents=True, exist_ok=True)
        for file in files:
            shutil.copy(file, folder)
        run_command(["npm", "ci", "--ignore-scripts", "--no-audit", "--no-fund"], cwd=folder)
        mark.write_text(wanted)
    return folder / "node_modules"


def read_licence(package: Path) -> str:
    """Return name and version of an npm package, and the text of its licence.

    Raises
    ------
    Failed
        The package has no text of a licence. The page must not contain such a package.
    """
    about = json.loads((package / "package.json").read_text())
    text = next(
        (f.read_text() for f in sorted(package.iterdir()) if f.name.lower().startswith("licen")), None
    )
    if text is None:
        raise Failed(f"{package.name}: the package has no text of a licence, so the page must not contain it")
    return f"{about['name']} {about['version']} ({about['license']})\n\n{text.strip()}\n"


def make_example() -> dict[str, Any]:
    """Return the built-in example: inputs of the driver, settings, road, number of rows.

    The page simulates the car with these inputs. The result is the log of the example."""
    import numpy as np

    from tse.library.core import Config
    from tse.simulation import maneuvers

    config = Config.exact()
    plan = maneuvers.build(DRIVE, config, sample_time=config.sample_time, duration=SECONDS, road=[ROAD])
    rows, step = len(plan.time), config.sample_time
    if not np.array_equal(plan.time, np.rint(np.arange(rows) * step * 1e9) / 1e9):
        raise Failed(f"{DRIVE}: its times differ from those that docs/page/run.js computes")
    if plan.target_speed is not None or plan.wheel_torque_rear.any() or plan.brake_torque_front is not None:
        raise Failed(f"{DRIVE}: has inputs that docs/page/run.js lacks; allowed: steering and front torque")
    changes = [0, *(np.flatnonzero(np.diff(plan.road_level)) + 1)]
    inputs = {
        name: getattr(plan, name).astype("<f8").tobytes() for name in ("steer_angle", "wheel_torque_front")
    }
    return {
        "rows": rows, "step": step, "settings": {"speed": plan.speed, "seed": SEED},
        "road": [[int(i), float(plan.road_level[i])] for i in changes],
        **{name: base64.b64encode(values).decode() for name, values in inputs.items()},
    }  # fmt: skip


def collect_names() -> dict[str, Any]:
    """Return names, units and rules of tselab, as data for the scripts of the page.

    The page thus reads and checks logs in the same way as tselab."""
    from tse.car import config, vehicle
    from tse.channels import agree, physics, scales, vocabulary
    from tse.estimation import estimate, verdict
    from tse.log import rows, units
    from tse.readers.table import _AT_END
    from tse.simulation import simulate

    factors: dict[str, dict[str, float]] = {}
    for si in ("s", "rad", "rad/s", "m/s", "m/s2"):
        found = {spelling: units.unit_factor(spelling, si) for spelling in units.SPELLINGS if spelling}
        factors[si] = {spelling: value for spelling, value in found.items() if value is not None}
    return {
        "spelt": units.SPELLINGS,
        "factors": factors,
        "atEnd": _AT_END,
        "roles": vocabulary.ROLE_WORDS,
        "not": vocabulary.NOT_ROLE_WORDS,
        "places": vocabulary.PLACE_WORDS,
        "names": verdict.NAMES,
        "wheel": vocabulary.WHEEL_WORDS.pattern,
        "noWheel": vocabulary.NO_WHEEL_WORDS.pattern,
        "rules": {
            "required": vehicle.REQUIRED,
            "descriptive": [*vehicle.DESCRIPTIVE, *vehicle.HINT_ONLY],
            "gapInSamples": config.GAP_IN_SAMPLES,
            "speedGain": simulate.SPEED_GAIN,
            "brakeFront": simulate.BRAKE_FRONT,
            "holdTorque": simulate.HOLD_TORQUE,
            "rolling": config.ROLLING,
            "many": config.MANY,
            "sameRatio": config.SAME_RATIO,
            "oneSpeed": config.ONE_SPEED,
        },
        "double": estimate.DOUBLE,
        "check": {
            "causes": agree.CAUSES,
            "wheelCauses": agree.WHEEL_CAUSES,
            "figures": agree.FIGURES,
            "sd": agree.FIGURE_SD,
            "unknownTrack": agree.UNKNOWN_TRACK,
            "unknownTrackSd": agree.UNKNOWN_TRACK_SD,
            "price": agree.CAUSE_PRICE,
            "wrongSign": agree.SIGN_PRICE,
            "vanished": agree.LOST_FIGURE_PRICE,
            "enough": agree.MIN_FIT,
            "slack": agree.FIT_SLACK,
            "odd": agree.FREE_FACTOR_PRICE,
            "well": agree.EXPLAINED,
            "far": agree.MAX_UNEXPLAINED,
            "handling": agree.MAX_HANDLING,
            "usualRatio": agree.USUAL_STEERING_RATIO,
            "unsaid": scales.OTHER_UNIT_COST,
            "turned": agree.MIN_IMU_TURN,
            "aside": agree.SIDE_LEVER,
            "asideShare": agree.MIN_SIDE_SHARE,
            "rate": physics.COMPARISON_RATE,
            "smooth": physics.MEAN_TIME,
            "moving": physics.MOVING_SPEED,
            "fewest": physics.MIN_ROWS,
            "mostRows": MAX_CHECKED_ROWS,
            "understeer": physics.UNDERSTEER,
            "understeerSd": physics.UNDERSTEER_SD,
            "turnShown": rows.MIN_TURN_SHARE,
        },
    }


def build(out: Path, npm: bool = True) -> list[str]:
    """Write the page to the file `out`. Return messages for the user.

    `npm`: False builds the page without npm packages; it then reads CSV only."""
    said, bundle, notices = [], "const vendor = { parquet: null, tomlReader: null };\n", ""
    if npm:
        try:
            bundle, notices = bundle_npm()
        except Failed as error:
            npm = False
            said.append(f"the page is built without Parquet and vehicle files: {error}")
    else:
        said.append("the page is built without Parquet and vehicle files, because of --without-npm")
    facts = {
        "parquet": npm,
        "toml": npm,
        **collect_names(),
        "example": make_example(),
        "wasm": base64.b64encode(compile_wasm()).decode(),
    }
    scripts = "".join(
        f"\n{((SHARED if name == 'draw.js' else SOURCES) / name).read_text()}" for name in SCRIPTS
    )
    head = (
        f"const {{ parquet, tomlReader }} = vendor;\nconst PAGE = {json.dumps(facts, ensure_ascii=False)};\n"
    )
    script = f'{bundle}"use strict";\n(() => {{\n{head}{scripts}}})();\n'
    if "</script" in script or "<!--" in script or "-->" in notices:
        raise Failed("a script contains </script, <!-- or -->, which would end it in HTML")
    text = (SOURCES / "page.html").read_text()
    own = (
        f"tse, {(ROOT / 'LICENSE').read_text().strip().splitlines()[0].strip()}; in this file, too:\n\n"
        if notices
        else ""
    )
    for mark, value in (
        ("<!-- @notices@ -->", f"<!--\n{own}{notices}-->" if notices else ""),
        ("<!-- @sources@ -->", f'<meta name="sources" content="{compute_digest()}">'),
        ("/* @style@ */", (SHARED / "page.css").read_text()),
        ("/* @script@ */", script),
    ):
        if text.count(mark) != 1:
            raise Failed(f"docs/page/page.html contains {mark} {text.count(mark)} times; needed: once")
        text = text.replace(mark, value)
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(text, encoding="utf-8")
    said.append(f"{out}: {len(text.encode()) // 1000} kB")
    return said


def main() -> int:
    """Build the page, or check that docs/try.html was built from the present sources."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=PAGE)
    parser.add_argument("--without-npm", action="store_true")
    parser.add_argument("--ship", action="store_true")
    parser.add_argument("--check", action="store_true")
    options = parser.parse_args()
    try:
        if options.check:
            if read_shipped_digest() == compute_digest():
                return 0
            raise Failed(
                f"{SHIPPED.relative_to(ROOT)} was built from different sources: run "
                "scripts/dev/page.py --ship"
            )
        if options.ship:
            if options.without_npm or not shutil.which("npm"):
                raise Failed("--ship needs npm: docs/try.html reads Parquet and vehicle files")
            options.out = SHIPPED
        said = build(options.out, not options.without_npm)
        for line in said:
            print(f"page: {line}")
        if options.ship and len(said) > 1:
            raise Failed(f"{SHIPPED.relative_to(ROOT)} must not be committed: npm packages are missing in it")
    except (Failed, ImportError) as error:
        hint = (
            ": run it with .venv/bin/python, after scripts/setup.sh" if isinstance(error, ImportError) else ""
        )
        print(f"page: {error}{hint}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
