"""FMUs of strangers: what fills the disk or leaves its folder is refused before a byte of it is unpacked."""

from __future__ import annotations

import io
import stat
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import tselab_here
from tse.impl.errors import UserError
from tselab.fmu import archive

DESCRIPTION = ("modelDescription.xml", b"<fmiModelDescription/>")
Make = Callable[[zipfile.ZipFile], None]


def member(name: str, content: bytes = b"x", mode: int = 0o100644) -> Make:
    def make(file: zipfile.ZipFile) -> None:
        info = zipfile.ZipInfo(name)
        info.create_system, info.external_attr = 3, mode << 16
        info.compress_type = zipfile.ZIP_DEFLATED
        file.writestr(info, content)

    return make


def many(file: zipfile.ZipFile) -> None:
    for k in range(archive.MOST_FILES):
        file.writestr(f"resources/{k}", b"")


def twice(file: zipfile.ZipFile) -> None:
    member("resources/a")(file)
    with pytest.warns(UserWarning, match="Duplicate"):
        member("resources/a", b"y")(file)


HOSTILE: dict[str, tuple[Make, list[str]]] = {
    "up": (member("../up.txt"), ["'../up.txt'", "leads out"]),
    "up inside": (member("resources/../../up.txt"), ["leads out"]),
    "up of windows": (member("resources\\..\\..\\up.txt"), ["leads out"]),
    "absolute": (member("/tmp/up.txt"), ["'/tmp/up.txt'", "leads out"]),
    "drive": (member("C:/up.txt"), ["leads out"]),
    "link": (member("resources/link", b"/etc/passwd", stat.S_IFLNK | 0o777), ["'resources/link'", "a link"]),
    "twice": (twice, ["'resources/a' is in it twice"]),
    "many": (many, ["10001 files", "up to 10000"]),
    "bomb": (
        member("resources/zeros", bytes(archive.SMALL * 8)),
        ["'resources/zeros'", "times larger", "up to 200 times"],
    ),
}


def made(path: Path, make: Make) -> Path:
    with zipfile.ZipFile(path, "w") as file:
        file.writestr(*DESCRIPTION)
        make(file)
    return path


@pytest.mark.parametrize("name", HOSTILE)
@pytest.mark.parametrize("command", [["validate"], ["run"]])
def test_a_hostile_archive_is_refused_with_its_reason(name, command, tmp_path):
    make, words = HOSTILE[name]
    made(tmp_path / "bad.fmu", make)
    (tmp_path / "in.csv").write_text("time\n0\n1\n")
    more = ["in.csv", "--vehicle", "car.toml"] if command == ["run"] else []
    done = tselab_here("fmu", *command, "bad.fmu", *more, cwd=tmp_path)
    assert done.code == 2, done.out + done.err
    assert "Traceback" not in done.err
    for word in ["bad.fmu", *words]:
        assert word in done.err
    with pytest.raises(UserError), archive.unpacked(tmp_path / "bad.fmu"):
        pass
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bad.fmu", "in.csv"]


def test_many_files_that_are_not_packed_are_counted_together(tmp_path, monkeypatch):
    monkeypatch.setattr(archive, "MOST_BYTES", 1000)
    path = made(tmp_path / "bad.fmu", lambda f: [member(f"resources/{k}", bytes(100))(f) for k in range(20)])
    with pytest.raises(UserError, match="unpacked; allowed: up to"):
        archive.open_archive(path)


def test_sizes_that_are_not_told_truly_are_refused(tmp_path):
    """A directory that says less than there is: nobody gets more than it says, and the checksum differs."""
    path = made(tmp_path / "bad.fmu", member("resources/zeros", bytes(archive.SMALL * 8)))
    content = bytearray(path.read_bytes())
    with zipfile.ZipFile(io.BytesIO(bytes(content))) as file:
        start = file.start_dir
    at = content.index(b"PK\x01\x02", start + 4)  # the second entry of the directory
    content[at + 24 : at + 28] = struct.pack("<I", 1000)
    path.write_bytes(content)
    with pytest.raises(UserError, match="is damaged: the checksum of resources/zeros differs"):
        archive.open_archive(path)


def test_no_damaged_byte_is_a_fault_of_ours(tmp_path):
    path = made(tmp_path / "bad.fmu", member("resources/text", b"some text, not all of one letter" * 3))
    good = path.read_bytes()
    for k in range(len(good)):
        path.write_bytes(good[:k] + bytes([good[k] ^ 0x55]) + good[k + 1 :])
        try:
            archive.open_archive(path)
        except UserError as error:
            assert str(path) in str(error)


def test_an_ordinary_archive_is_opened_and_unpacked(tmp_path):
    path = made(
        tmp_path / "good.fmu", member("resources/table.txt", b"0,0\n" * 200000)
    )  # packed well, yet less than a MB
    assert archive.open_archive(path).names == ("modelDescription.xml", "resources/table.txt")
    with archive.unpacked(path) as folder:
        assert (folder / "resources" / "table.txt").stat().st_size == 800000
