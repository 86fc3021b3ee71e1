"""The machines that the filter is replayed and measured on: how a program of tests/embedded is built for each and run. Used by
scripts/dev/platforms.py (the same bits) and scripts/dev/budgets.py (instructions, code, memory).

A program is tse.c of scripts/dev/amalgamate.py, one main, one port, and the recorded drive as a table. Microcontrollers are emulated by
qemu-system-arm, other processors by qemu-user; what is not installed is left out, with the reason.
"""

import csv
import importlib.util
import re
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
HERE = ROOT / "tests" / "embedded"
DRIVE = ROOT / "tests" / "replay" / "drive.csv"

# As CMakeLists.txt compiles the library; tcc and the like know none of it, and need none.
FLAGS = ("-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math")
LONGEST = 600  # s of processor time: what takes longer has got stuck (the slowest, double in software on an M3: one minute)


def formats() -> list[str]:
    """The number formats, as CMakeLists.txt has them."""
    row = re.search(
        r"set_property\(CACHE TSE_REAL PROPERTY STRINGS ([\w ]+)\)", (ROOT / "CMakeLists.txt").read_text()
    )
    if not row:
        raise SystemExit("CMakeLists.txt: which number formats there are is not where this script looks")
    return row[1].split()


def golden_file(real: str) -> Path:
    return ROOT / "tests" / "replay" / f"golden_{real}.csv"


def golden(real: str) -> dict[str, str]:
    """Hash by form and way of resampling, as tests/replay/update.py wrote them."""
    return {
        name: hash_ for hash_, name in re.findall(r"^# hash (\w+) (.+)$", golden_file(real).read_text(), re.M)
    }


@dataclass(frozen=True)
class Board:
    """A microcontroller that qemu emulates: where its memories are, and its clock, which SysTick counts."""

    machine: str
    flash: int
    flash_bytes: int
    ram: int
    ram_bytes: int
    tick: int  # quarters of a nanosecond


MB = 1 << 20
M0 = Board("microbit", 0, 256 << 10, 0x20000000, 16 << 10, 250)  # nRF51822 at 16 MHz
M3 = Board("mps2-an385", 0, 4 * MB, 0x20000000, 4 * MB, 160)  # 25 MHz, as the next two
M4 = Board("mps2-an386", 0, 4 * MB, 0x20000000, 4 * MB, 160)
M7 = Board("mps2-an500", 0, 4 * MB, 0x20000000, 4 * MB, 160)
M33 = Board("mps2-an505", 0x10000000, 4 * MB, 0x38000000, 2 * MB, 200)  # 20 MHz; secure memories


@dataclass(frozen=True)
class Machine:
    """One compiler for one machine. run: what a program is started with; only: formats that are asked of it."""

    name: str
    cc: tuple[str, ...]
    flags: tuple[str, ...]
    run: tuple[str, ...] = ()
    board: Board | None = None
    only: tuple[str, ...] = ()
    leaves: tuple[str, ...] = ()  # formats that are not asked of it
    port: str = "host.c"
    link: tuple[str, ...] = ("-lm",)
    refused: bool = False  # it is an error to compile with these flags, and has to be one
    known: tuple[str, ...] = FLAGS
    short: tuple[
        str, ...
    ] = ()  # formats for which the short run takes it, too: different in byte order, width, compiler

    def missing(self) -> str:
        """Why it cannot be had here; empty: it can."""
        for program in (self.cc[0], *self.run[:1]):
            if not shutil.which(program):
                return f"{program} is not installed"
        if "ziglang" in self.cc and importlib.util.find_spec("ziglang") is None:
            return "ziglang is not installed (scripts/setup.sh platforms)"
        if "-mavx2" in self.flags and not re.search(
            r"^flags.* avx2 ", Path("/proc/cpuinfo").read_text(), re.M
        ):
            return "this processor has no AVX2"
        return (
            "wasm-ld is not installed"
            if self.port == "wasm.c" and self.cc[0] == "clang" and not shutil.which("wasm-ld")
            else ""
        )

    def version(self) -> str:
        return version_of(self.cc)

    def compiler(self) -> str:
        return "zig cc" if "ziglang" in self.cc else self.cc[0]

    def emulator(self) -> str:
        if not self.run:
            return "-"
        board = f" {self.board.machine}" if self.board else ""
        return f"{self.run[0]} {version_of(self.run[:1])}{board}"


@cache
def version_of(command: tuple[str, ...]) -> str:
    ask = "-v" if command[0] == "tcc" else "version" if "ziglang" in command else "--version"
    said = subprocess.run(
        [*command[: 3 if "ziglang" in command else 1], ask], capture_output=True, text=True, check=False
    ).stdout
    number = re.search(r"\d+\.\d+(\.\d+)?", said.splitlines()[0] if said else "")
    return number[0] if number else "?"


def cortex(
    name: str, board: Board, cpu: str, *fpu: str, level: str = "-O2", short: tuple[str, ...] = ()
) -> Machine:
    qemu = ("qemu-system-arm", "-M", board.machine, "-display", "none", "-monitor", "none", "-serial", "none",
            "-semihosting-config", "enable=on,target=native")  # fmt: skip
    flags = (
        f"-mcpu={cpu}",
        "-mthumb",
        *(fpu or ("-mfloat-abi=soft",)),
        "-ffunction-sections",
        "-fdata-sections",
        level,
    )
    link = ("-nostartfiles", "-Wl,--gc-sections", "--specs=nosys.specs", "-lm", "-Wl,--no-warn-rwx-segments")
    leaves = (
        ("double",) if "-mfpu=fpv4-sp-d16" in fpu or "-mfpu=fpv5-sp-d16" in fpu else ()
    )  # by software, which is the M3's
    return Machine(
        name,
        ("arm-none-eabi-gcc",),
        flags,
        qemu,
        board,
        leaves=leaves,
        port="cortex_m.c",
        link=link,
        short=short,
    )


def user(
    name: str,
    triple: str,
    qemu: str,
    *flags: str,
    only: tuple[str, ...] = (),
    refused: bool = False,
    short: tuple[str, ...] = (),
) -> Machine:
    compiler, link = (f"{triple}-gcc",), ("-lm", "-static")
    return Machine(
        name, compiler, ("-O2", *flags), (qemu,), only=only, link=link, refused=refused, short=short
    )


def zig(name: str, target: str, qemu: str, *flags: str) -> Machine:
    cc = (sys.executable, "-m", "ziglang", "cc", "-target", target)
    return Machine(name, cc, ("-O2", *flags), (qemu,), link=("-lm", "-static"))


def machines() -> list[Machine]:
    native = [
        Machine("x86-64", (cc,), flags)
        for cc in ("gcc", "clang")
        for flags in (("-O0",), ("-O2",), ("-O3",), ("-O3", "-mavx2", "-mfma"), ("-Os",))
    ]
    wasm = ("-O2", "-nostdlib", f"-I{HERE / 'wasm'}", "-fno-builtin-memset", "-fno-builtin-memcpy")
    wasm_link = ("-Wl,--no-entry",)
    return [
        *native,
        Machine("x86-64, denormals flushed", ("gcc",), ("-O2", "-DFLUSH_DENORMALS")),
        Machine("x86-64", ("tcc",), (), known=(), leaves=("fixed",)),  # it has no constants of reals with a condition
        user("i686, SSE2", "i686-linux-gnu", "qemu-i386", "-msse2", "-mfpmath=sse"),
        user("i686, x87", "i686-linux-gnu", "qemu-i386", "-mno-sse", only=("double", "float"), refused=True),
        user("aarch64", "aarch64-linux-gnu", "qemu-aarch64", short=("double",)),
        user("armhf", "arm-linux-gnueabihf", "qemu-arm"),
        user("riscv64", "riscv64-linux-gnu", "qemu-riscv64"),
        user("s390x, big-endian", "s390x-linux-gnu", "qemu-s390x", "-fexcess-precision=fast", short=("float",)),
        user("s390x, big-endian", "s390x-linux-gnu", "qemu-s390x", only=("float",), refused=True, short=("float",)),
        user("ppc64, big-endian", "powerpc64-linux-gnu", "qemu-ppc64"),
        zig("ppc64le", "powerpc64le-linux-musl", "qemu-ppc64le"),
        user("mips, big-endian", "mips-linux-gnu", "qemu-mips"),
        user("sparc64, big-endian", "sparc64-linux-gnu", "qemu-sparc64"),
        cortex("Cortex-M0", M0, "cortex-m0", level="-Os", short=("fixed",)),
        cortex("Cortex-M0's code on an M3", M3, "cortex-m0"),
        cortex("Cortex-M3", M3, "cortex-m3"),
        cortex("Cortex-M4F", M4, "cortex-m4", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard", short=("float",)),
        cortex("Cortex-M7", M7, "cortex-m7", "-mfpu=fpv5-d16", "-mfloat-abi=hard"),
        cortex("Cortex-M33", M33, "cortex-m33", "-mfpu=fpv5-sp-d16", "-mfloat-abi=hard"),
        Machine("WebAssembly", ("clang", "--target=wasm32"), wasm, ("node", str(HERE / "wasm.js")), port="wasm.c", link=wasm_link,
                short=("double",)),
        Machine("WebAssembly", (sys.executable, "-m", "ziglang", "cc", "-target", "wasm32-freestanding"), wasm,
                ("node", str(HERE / "wasm.js")), port="wasm.c", link=(*wasm_link, "-Wl,--export-memory")),
    ]  # fmt: skip


# ---- building


def rows() -> str:
    """The recorded drive as rows.h: numbers as written, so that the compiler makes of each the nearest one there is."""
    out = []
    with DRIVE.open() as file:
        for line in csv.reader(x for x in file if x[0].isdigit()):
            missing = sum(1 << k for k, text in enumerate(line[1:]) if not text)
            out.append(f"ROW({', '.join(text or '0' for text in line)}, {missing})")
    return "\n".join(out) + "\n"


def frames() -> str:
    """The recorded drive as frames.h: what a CAN bus brings in each period of 10 ms (scripts/dropin/can/control_loop.h). A row that
    was lost brings nothing."""
    out, period, count = [], 0, 0
    scales = (
        (0x0C1, (1, 100_000)),
        (0x0C2, (2, 1000), (3, 1000)),
        (0x0C3, (4, 1000), (5, 1000)),
        (0x0C4, (6, 100_000)),
    )
    with DRIVE.open() as file:
        for row in csv.reader(x for x in file if x[0].isdigit()):
            period += round(100 * float(row[0]))
            if not any(row[1:]):
                raise SystemExit(f"{DRIVE}: a row without any channel would be no frame")
            for id_, *numbers in scales:
                if not any(row[at] for at, _ in numbers):
                    continue
                data = [0] * 8
                for k, (at, per) in enumerate(numbers):
                    raw = round(per * float(row[at] or 0))
                    if row[at] and abs(raw / per - float(row[at])) > 1e-12:
                        raise SystemExit(f"{DRIVE}: {row[at]} is finer than the bus")
                    data[3 * k : 3 * k + 3] = (raw & 0xFFFFFF).to_bytes(3, "little")
                    data[6] |= (not row[at]) << k
                count += 1
                data[7] = count & 0xFF
                out.append(f"FRAME({period}, {id_}, {', '.join(map(str, data))})")
    return "\n".join(out) + "\n"


@dataclass
class Work:
    """A folder with what all builds share."""

    folder: Path
    made: set[str] = field(default_factory=set)

    def sources(self) -> Path:
        folder = self.folder / "sources"
        if "sources" not in self.made:
            folder.mkdir(parents=True, exist_ok=True)
            command = [sys.executable, str(ROOT / "scripts" / "dev" / "amalgamate.py"), "--out", str(folder)]
            subprocess.run(command, check=True, capture_output=True)
            (folder / "rows.h").write_text(rows())
            (folder / "frames.h").write_text(frames())
            self.made.add("sources")
        return folder


class Failed(Exception):
    """A command that ended badly; its text."""


def does_not_fit(text: str) -> str:
    """What the linker said, when a program is larger than a board's memories; empty: something else was wrong."""
    overflow = re.search(r"region `(\w+)' overflowed by (\d+) bytes", text)
    if overflow:
        return f"{int(overflow[2]):,} B more than its {overflow[1]}"
    return "too little of its RAM is left for the stack" if "no room for the stack" in text else ""


def limited() -> None:
    """Of the processor's time, because on a busy machine everything takes long."""
    resource.setrlimit(resource.RLIMIT_CPU, (LONGEST, LONGEST))


def call(command: list[str]) -> str:
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL, preexec_fn=limited
    )
    if done.returncode in (-signal.SIGXCPU, -signal.SIGKILL):
        raise Failed(f"it was ended after {LONGEST} s of processor time, or by somebody")
    if done.returncode:
        raise Failed((done.stdout + done.stderr).strip() or f"ended with {done.returncode}")
    return done.stdout + done.stderr


def layout(board: Board, folder: Path, stack: int) -> Path:
    text = (HERE / "cortex_m.ld").read_text()
    sizes = {
        "FLASH": board.flash,
        "FLASH_BYTES": board.flash_bytes,
        "RAM": board.ram,
        "RAM_BYTES": board.ram_bytes,
    }
    sizes["STACK_BYTES"] = stack
    for name, value in sizes.items():
        text = text.replace(f"@{name}@", str(value))
    path = folder / "board.ld"
    path.write_text(text)
    return path


def build(
    work: Work,
    machine: Machine,
    real: str,
    main: str,
    name: str,
    *more: str,
    stack: int = 2048,
    beside: Iterable[Path] = (),
) -> Path:
    """Compile and link one program.   more: further flags, such as -DTSE_NO_EFFECTS; beside: more files of it"""
    sources = work.sources()
    folder = work.folder / re.sub(r"[^\w]+", "-", f"{name}-{real}")
    folder.mkdir(parents=True, exist_ok=True)
    program = folder / (f"{Path(main).stem}.wasm" if machine.port == "wasm.c" else f"{Path(main).stem}.elf")
    places = [f"-I{sources}", f"-I{HERE}", f"-I{ROOT / 'tests' / 'replay'}", f"-I{ROOT / 'include'}"]
    files = [str(sources / "tse.c"), str(HERE / main), str(HERE / machine.port), *(str(x) for x in beside)]
    command = [
        *machine.cc,
        "-std=c99",
        *machine.flags,
        *machine.known,
        f"-DTSE_REAL_{real.upper()}",
        *more,
        *places,
    ]
    link = list(machine.link)
    if machine.board:
        command.append(f"-DNS_OF_TICK={machine.board.tick}u")
        link += [f"-T{layout(machine.board, folder, stack)}"]
    call([*command, *files, "-o", str(program), *link])
    return program


def run(machine: Machine, program: Path, *options: str) -> str:
    if machine.board:
        return call([*machine.run, *options, "-kernel", str(program)])
    return call([*machine.run, str(program)])
