"""What a loader would find out about a binary, on any machine: read by lief, not run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from tse.impl.errors import UserError

LINKER_MADE = {"_init", "_fini", "_edata", "_end", "__bss_start", "_mh_dylib_header", "__dso_handle"}


@dataclass(frozen=True)
class Binary:
    """A shared library. Machines are named as FMI 3 names architectures."""

    system: str  # linux, windows, darwin
    machines: tuple[str, ...]
    exports: frozenset[str]
    needs: tuple[str, ...]
    glibc: tuple[int, ...] = ()  # the newest version that a symbol is taken from
    executable_stack: bool = False
    signed: bool = True  # macOS on arm64 loads nothing else


def need_lief() -> None:
    try:
        import lief  # noqa: F401
    except ImportError:
        raise UserError(
            "lief, which reads binaries, is not installed: run scripts/setup.sh, or install the extra 'fmu'"
        ) from None


def read_binary(data: bytes) -> Binary | None:
    """None when it is no shared library of a system that FMI knows."""
    import lief

    lief.logging.disable()
    if data[:4] == b"\x7fELF":
        return _elf(lief.ELF.parse(data))
    if data[:2] == b"MZ":
        return _pe(lief.PE.parse(data))
    if data[:4] in (b"\xca\xfe\xba\xbe", b"\xcf\xfa\xed\xfe", b"\xce\xfa\xed\xfe"):
        return _macho(lief.MachO.parse(data))
    return None


def _elf(file: Any) -> Binary | None:
    import lief

    if file is None:
        return None
    arch = lief.ELF.ARCH
    machine = {arch.X86_64: "x86_64", arch.I386: "x86", arch.AARCH64: "aarch64"}.get(file.header.machine_type, "other")
    versions = [
        tuple(int(x) for x in a.name[len("GLIBC_") :].split("."))
        for r in file.symbols_version_requirement
        for a in r.get_auxiliary_symbols()
        if a.name.startswith("GLIBC_") and a.name != "GLIBC_PRIVATE"
    ]
    stack = [s for s in file.segments if s.type == lief.ELF.Segment.TYPE.GNU_STACK]
    executable = not stack or bool(stack[0].flags & lief.ELF.Segment.FLAGS.X)
    exports = {s.name for s in file.dynamic_symbols if s.exported} - LINKER_MADE
    newest = max(versions, default=())
    return Binary("linux", (machine,), frozenset(exports), tuple(file.libraries), newest, executable)


def _pe(file: Any) -> Binary | None:
    import lief

    if file is None:
        return None
    kind = lief.PE.Header.MACHINE_TYPES
    machine = {kind.AMD64: "x86_64", kind.I386: "x86", kind.ARM64: "aarch64"}.get(file.header.machine, "other")
    table = file.get_export()
    exports = {e.name for e in table.entries} if table is not None else set()
    return Binary("windows", (machine,), frozenset(exports), tuple(i.name for i in file.imports))


def _macho(fat: Any) -> Binary | None:
    import lief

    if fat is None or fat.size == 0:
        return None
    slices = [fat.at(i) for i in range(fat.size)]
    cpu = lief.MachO.Header.CPU_TYPE
    names = {cpu.X86_64: "x86_64", cpu.ARM64: "aarch64", cpu.X86: "x86"}
    per_slice = [{s.name.removeprefix("_") for s in b.exported_symbols} - LINKER_MADE for b in slices]
    own = lief.MachO.LoadCommand.TYPE.ID_DYLIB
    needs = {lib.name for b in slices for lib in b.libraries if lib.command != own}
    return Binary(
        "darwin",
        tuple(names.get(b.header.cpu_type, "other") for b in slices),
        frozenset(set.intersection(*per_slice)),  # missing in one slice is missing
        tuple(sorted(needs)),
        signed=all(b.has_code_signature for b in slices if b.header.cpu_type == cpu.ARM64),
    )
