"""Build the programs of tests/embedded for each machine, and run them.

A machine is a processor with a compiler and, unless it is this computer, an emulator.
scripts/dev/platforms.py checks that all machines give the same estimates in all bits.
scripts/dev/budgets.py measures instructions, flash, RAM and stack.

A program consists of four parts: tse.c, which scripts/dev/amalgamate.py makes of the
library; a file with the test program; a file that implements tests/embedded/port.h
(output, counter of instructions) on the machine; and the recorded drive of tests/replay
as a C table.
qemu-system-arm emulates microcontrollers, qemu-user emulates other processors. A machine
whose tools are not installed is skipped, and the reason is printed.
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

# Flags with which CMakeLists.txt compiles the library. Simple compilers such as tcc do
# not accept them.
FLAGS = ("-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math")
# [s] limit of processor time. The slowest program computes double in software on an
# emulated M3 and needs one minute. A program that is still running after ten minutes is
# taken to be in an endless loop, and is stopped.
MAX_SECONDS = 600


def read_formats() -> list[str]:
    """Return the number formats that CMakeLists.txt allows."""
    row = re.search(
        r"set_property\(CACHE TSE_REAL PROPERTY STRINGS ([\w ]+)\)", (ROOT / "CMakeLists.txt").read_text()
    )
    if not row:
        raise SystemExit("CMakeLists.txt: the list of number formats (STRINGS of TSE_REAL) is missing")
    return row[1].split()


def find_golden_file(real: str) -> Path:
    """Return the file with the golden estimates of a number format.

    Golden estimates are the recorded reference: the filter must reproduce all bits."""
    return ROOT / "tests" / "replay" / f"golden_{real}.csv"


def read_golden(real: str) -> dict[str, str]:
    """Return the hash of all outputs of each run of the filter on the recorded drive.

    Key: name of the run, such as "paper, scheme 2": settings of the filter, and number of
    the method of resampling. tests/replay/update.py has written the hashes to the golden
    file."""
    return {
        name: hash_
        for hash_, name in re.findall(r"^# hash (\w+) (.+)$", find_golden_file(real).read_text(), re.M)
    }


@dataclass(frozen=True)
class Board:
    """A microcontroller that qemu emulates."""

    machine: str  # name of the board in qemu
    flash: int  # address of the flash
    flash_bytes: int
    ram: int  # address of the RAM
    ram_bytes: int
    tick: int  # [0.25 ns] period of SysTick


MB = 1 << 20
M0 = Board("microbit", 0, 256 << 10, 0x20000000, 16 << 10, 250)  # nRF51822 at 16 MHz
M3 = Board("mps2-an385", 0, 4 * MB, 0x20000000, 4 * MB, 160)  # 25 MHz
M4 = Board("mps2-an386", 0, 4 * MB, 0x20000000, 4 * MB, 160)  # 25 MHz
M7 = Board("mps2-an500", 0, 4 * MB, 0x20000000, 4 * MB, 160)  # 25 MHz
# 20 MHz. In a processor with TrustZone, flash and RAM have two addresses each, a secure
# and a non-secure one. The processor starts in the secure state, so these are the secure
# addresses.
M33 = Board("mps2-an505", 0x10000000, 4 * MB, 0x38000000, 2 * MB, 200)


@dataclass(frozen=True)
class Machine:
    """A machine, with the compiler and the command that runs a program on it."""

    name: str
    cc: tuple[str, ...]  # command of the compiler
    flags: tuple[str, ...]  # compiler flags of this machine
    run: tuple[str, ...] = ()  # command that runs a program; (): the program itself
    board: Board | None = None  # None: no microcontroller
    only: tuple[str, ...] = ()  # number formats to run; (): all
    leaves: tuple[str, ...] = ()  # number formats to skip
    port: str = "host.c"  # file of tests/embedded that implements port.h (output etc.)
    link: tuple[str, ...] = ("-lm",)  # flags of the linker
    refused: bool = False  # True: the library must refuse to compile with these flags
    known: tuple[str, ...] = FLAGS  # flags in FLAGS that the compiler accepts
    # number formats that `platforms.py --short` tests on this machine; (): --short leaves
    # this machine out. The machines that --short runs cover both byte orders, several
    # word sizes and several compilers.
    short: tuple[str, ...] = ()

    def find_missing(self) -> str:
        """Return the reason if the machine cannot be used here, otherwise ""."""
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

    def read_version(self) -> str:
        """Return the version of the compiler."""
        return read_version(self.cc)

    def name_compiler(self) -> str:
        """Return the name of the compiler."""
        return "zig cc" if "ziglang" in self.cc else self.cc[0]

    def name_emulator(self) -> str:
        """Return name, version and board of the emulator; "-" if there is no emulator."""
        if not self.run:
            return "-"
        board = f" {self.board.machine}" if self.board else ""
        return f"{self.run[0]} {read_version(self.run[:1])}{board}"


@cache
def read_version(command: tuple[str, ...]) -> str:
    """Return the version of a program, or "?" if it prints none."""
    ask = "-v" if command[0] == "tcc" else "version" if "ziglang" in command else "--version"
    said = subprocess.run(
        [*command[: 3 if "ziglang" in command else 1], ask], capture_output=True, text=True, check=False
    ).stdout
    number = re.search(r"\d+\.\d+(\.\d+)?", said.splitlines()[0] if said else "")
    return number[0] if number else "?"


def make_cortex(
    name: str, board: Board, cpu: str, *fpu: str, level: str = "-O2", short: tuple[str, ...] = ()
) -> Machine:
    """Return an emulated Cortex-M microcontroller, with gcc as the compiler."""
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
    # A processor whose floating-point unit has float but not double computes double in
    # software, as the M3 does. A run in double would test the same code as on the M3, and
    # is therefore skipped.
    leaves = ("double",) if "-mfpu=fpv4-sp-d16" in fpu or "-mfpu=fpv5-sp-d16" in fpu else ()
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


def make_qemu_user(
    name: str,
    triple: str,
    qemu: str,
    *flags: str,
    only: tuple[str, ...] = (),
    refused: bool = False,
    short: tuple[str, ...] = (),
) -> Machine:
    """Return a processor that qemu-user emulates, with gcc as the compiler."""
    compiler, link = (f"{triple}-gcc",), ("-lm", "-static")
    return Machine(
        name, compiler, ("-O2", *flags), (qemu,), only=only, link=link, refused=refused, short=short
    )


def make_zig(name: str, target: str, qemu: str, *flags: str) -> Machine:
    """Return a processor that qemu-user emulates, with zig as the compiler."""
    cc = (sys.executable, "-m", "ziglang", "cc", "-target", target)
    return Machine(name, cc, ("-O2", *flags), (qemu,), link=("-lm", "-static"))


def list_machines() -> list[Machine]:
    """Return all machines, installed or not."""
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
        # The format "fixed" is skipped with tcc: its constants are conditional
        # expressions of real numbers, and tcc does not evaluate such expressions at
        # compile time.
        Machine("x86-64", ("tcc",), (), known=(), leaves=("fixed",)),
        make_qemu_user("i686, SSE2", "i686-linux-gnu", "qemu-i386", "-msse2", "-mfpmath=sse"),
        make_qemu_user(
            "i686, x87", "i686-linux-gnu", "qemu-i386", "-mno-sse", only=("double", "float"), refused=True
        ),
        make_qemu_user("aarch64", "aarch64-linux-gnu", "qemu-aarch64", short=("double",)),
        make_qemu_user("armhf", "arm-linux-gnueabihf", "qemu-arm"),
        make_qemu_user("riscv64", "riscv64-linux-gnu", "qemu-riscv64"),
        make_qemu_user(
            "s390x, big-endian", "s390x-linux-gnu", "qemu-s390x", "-fexcess-precision=fast", short=("float",)
        ),
        make_qemu_user(
            "s390x, big-endian",
            "s390x-linux-gnu",
            "qemu-s390x",
            only=("float",),
            refused=True,
            short=("float",),
        ),
        make_qemu_user("ppc64, big-endian", "powerpc64-linux-gnu", "qemu-ppc64"),
        make_zig("ppc64le", "powerpc64le-linux-musl", "qemu-ppc64le"),
        make_qemu_user("mips, big-endian", "mips-linux-gnu", "qemu-mips"),
        make_qemu_user("sparc64, big-endian", "sparc64-linux-gnu", "qemu-sparc64"),
        make_cortex("Cortex-M0", M0, "cortex-m0", level="-Os", short=("fixed",)),
        make_cortex("Cortex-M0's code on an M3", M3, "cortex-m0"),
        make_cortex("Cortex-M3", M3, "cortex-m3"),
        make_cortex("Cortex-M4F", M4, "cortex-m4", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard", short=("float",)),
        make_cortex("Cortex-M7", M7, "cortex-m7", "-mfpu=fpv5-d16", "-mfloat-abi=hard"),
        make_cortex("Cortex-M33", M33, "cortex-m33", "-mfpu=fpv5-sp-d16", "-mfloat-abi=hard"),
        Machine(
            "WebAssembly",
            ("clang", "--target=wasm32"),
            wasm,
            ("node", str(HERE / "wasm.js")),
            port="wasm.c",
            link=wasm_link,
            short=("double",),
        ),
        Machine(
            "WebAssembly",
            (sys.executable, "-m", "ziglang", "cc", "-target", "wasm32-freestanding"),
            wasm,
            ("node", str(HERE / "wasm.js")),
            port="wasm.c",
            link=(*wasm_link, "-Wl,--export-memory"),
        ),
    ]


# ---- building


def write_rows() -> str:
    """Return the recorded drive as the text of rows.h.

    A row is ROW(dt, channels ..., missing). Bit k of `missing` is 1 if channel k has no
    value in this row. Numbers are copied digit by digit. The compiler converts each to
    the nearest value of its number format.
    """
    out = []
    with DRIVE.open() as file:
        for line in csv.reader(x for x in file if x[0].isdigit()):
            missing = sum(1 << k for k, text in enumerate(line[1:]) if not text)
            out.append(f"ROW({', '.join(text or '0' for text in line)}, {missing})")
    return "\n".join(out) + "\n"


def write_frames() -> str:
    """Return the recorded drive as the text of frames.h, with the CAN frames of each row.

    A line is FRAME(period, identifier, 8 bytes). `period` counts periods of 10 ms from
    the start of the drive. If the drive has no row in a period, the period has no frames.
    scripts/dropin/can/control_loop.h describes the bytes.
    """
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
                raise SystemExit(f"{DRIVE}: a row has no channel; frames need at least one")
            for id_, *numbers in scales:
                if not any(row[at] for at, _ in numbers):
                    continue
                data = [0] * 8
                for k, (at, per) in enumerate(numbers):
                    raw = round(per * float(row[at] or 0))
                    if row[at] and abs(raw / per - float(row[at])) > 1e-12:
                        raise SystemExit(f"{DRIVE}: {row[at]} is no multiple of the resolution, 1/{per}")
                    data[3 * k : 3 * k + 3] = (raw & 0xFFFFFF).to_bytes(3, "little")
                    data[6] |= (not row[at]) << k
                count += 1
                data[7] = count & 0xFF
                out.append(f"FRAME({period}, {id_}, {', '.join(map(str, data))})")
    return "\n".join(out) + "\n"


@dataclass
class Work:
    """A folder for builds. All builds in it use the same copy of the sources."""

    folder: Path
    made: set[str] = field(default_factory=set)  # {"sources"} after write_sources()

    def write_sources(self) -> Path:
        """Write the shared sources at the first call. Return their folder."""
        folder = self.folder / "sources"
        if "sources" not in self.made:
            folder.mkdir(parents=True, exist_ok=True)
            command = [sys.executable, str(ROOT / "scripts" / "dev" / "amalgamate.py"), "--out", str(folder)]
            subprocess.run(command, check=True, capture_output=True)
            (folder / "rows.h").write_text(write_rows())
            (folder / "frames.h").write_text(write_frames())
            self.made.add("sources")
        return folder


class Failed(Exception):
    """A command failed. The message is its output."""


def explain_misfit(text: str) -> str:
    """If a program failed because it is too large, return which memory is too small.

    For any other error, return "".

    `text`: output of the linker or the program."""
    overflow = re.search(r"region `(\w+)' overflowed by (\d+) bytes", text)
    if overflow:
        return f"{overflow[1]} is too small by {int(overflow[2]):,} B"
    return "RAM is too small for the stack" if "no room for the stack" in text else ""


def limit_time() -> None:
    """Limit the processor time of this process.

    Elapsed time is not limited, because it depends on the load of the host."""
    resource.setrlimit(resource.RLIMIT_CPU, (MAX_SECONDS, MAX_SECONDS))


def run_command(command: list[str]) -> str:
    """Run a command, for at most MAX_SECONDS. Return its output."""
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL, preexec_fn=limit_time
    )
    if done.returncode in (-signal.SIGXCPU, -signal.SIGKILL):
        raise Failed(f"stopped by a signal, probably after {MAX_SECONDS} s of processor time")
    if done.returncode:
        raise Failed((done.stdout + done.stderr).strip() or f"ended with exit code {done.returncode}")
    return done.stdout + done.stderr


def write_layout(board: Board, folder: Path, stack: int) -> Path:
    """Write the linker script of a board with `stack` bytes of stack; return its path."""
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


def build_program(
    work: Work,
    machine: Machine,
    real: str,
    main: str,
    name: str,
    *more: str,
    stack: int = 2048,
    beside: Iterable[Path] = (),
) -> Path:
    """Compile and link a program. Return its path.

    Parameters
    ----------
    work : Work
        The folder for builds.
    machine : Machine
        Machine and compiler.
    real : str
        Number format.
    main : str
        File of tests/embedded with main().
    name : str
        Name of the folder for the program.
    *more : str
        Further compiler flags, such as -DTSE_NO_EFFECTS.
    stack : int
        [bytes] Size of the stack on a microcontroller.
    beside : iterable of Path
        Further source files.
    """
    sources = work.write_sources()
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
        link += [f"-T{write_layout(machine.board, folder, stack)}"]
    run_command([*command, *files, "-o", str(program), *link])
    return program


def run_program(machine: Machine, program: Path, *options: str) -> str:
    """Run a program on its machine. Return its output."""
    if machine.board:
        return run_command([*machine.run, *options, "-kernel", str(program)])
    return run_command([*machine.run, str(program)])
