"""Read ROS 1 bags and folders of ROS 2 bags by the package rosbags."""

import bz2
import io
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from tse.library.errors import UserError
from tse.readers.recording import Collector, ReadOptions, Recording, import_optional, list_names

OP_CHUNK, OP_CONNECTION, OP_MESSAGE, OP_HEADER = 5, 7, 2, 3  # field `op`: kind of a record of a ROS 1 bag
# [bytes] largest header or data of a record, and largest unpacked chunk. A larger one is
# taken as damaged: the tool rosbag writes chunks of 0.8 MB
MAX_RECORD_BYTES = 1 << 30
DAMAGE_ERRORS = (struct.error, EOFError, KeyError, ValueError, OSError, IndexError)


def _is_closed(path: Path) -> bool:
    """Return whether a ROS 1 bag has an index, which is written when the bag is closed.

    The first record states the position of the index. The position is 0 if the bag was
    not closed, and beyond the end of the file if the file is cut off. If the first record
    cannot be read, return True, so that the package rosbags reports the damage."""
    try:
        with open(path, "rb") as file:
            file.readline()
            op, fields, _ = _read_record(file)
        return op != OP_HEADER or 0 < struct.unpack("<Q", fields[b"index_pos"])[0] < path.stat().st_size
    except DAMAGE_ERRORS:
        return True


def _read_record(file: BinaryIO) -> tuple[int, dict[bytes, bytes], bytes]:
    """Return kind (field `op`), header fields and data of a record.

    Raises
    ------
    EOFError
        The record is incomplete, or its header or data exceed MAX_RECORD_BYTES.
    """

    def read_part() -> bytes:
        head = file.read(4)
        size = struct.unpack("<I", head)[0] if len(head) == 4 else -1
        data = file.read(size) if 0 <= size <= MAX_RECORD_BYTES else b""
        if len(data) != size:
            raise EOFError
        return data

    fields, data = _split_fields(read_part()), read_part()
    return fields[b"op"][0], fields, data


def _unpack_chunk(compression: bytes, data: bytes) -> bytes:
    """Return the unpacked records of a chunk."""
    if compression == b"none":
        return data
    if compression == b"bz2":
        work: Any = bz2.BZ2Decompressor()
    else:
        work = import_optional("lz4.frame", "ros", "the bag").LZ4FrameDecompressor()
    plain = work.decompress(data, MAX_RECORD_BYTES)
    if len(plain) >= MAX_RECORD_BYTES:
        raise ValueError("a chunk is larger than 1 GB")
    return plain


def _read_from_front(path: Path, typesys: Any) -> Iterator[tuple[str, float, Any, str]]:
    """Yield topic, time [s], message and type of all messages of a bag without an index.

    The ROS 1 bag is read from its beginning up to the last complete chunk."""
    store = typesys.get_typestore(typesys.Stores.EMPTY)
    known: dict[int, tuple[str, str]] = {}
    with open(path, "rb") as file:
        file.readline()
        while True:
            try:
                op, fields, data = _read_record(file)
                if op != OP_CHUNK:
                    continue
                inner = io.BytesIO(_unpack_chunk(fields[b"compression"], data))
            except DAMAGE_ERRORS:
                return
            while inner.tell() < len(inner.getbuffer()):
                try:
                    op, fields, data = _read_record(inner)
                except DAMAGE_ERRORS:
                    break
                if op == OP_CONNECTION:
                    number, said = struct.unpack("<I", fields[b"conn"])[0], _split_fields(data)
                    kind = said[b"type"].decode().replace("/", "/msg/")
                    if number not in known:
                        store.register(typesys.get_types_from_msg(said[b"message_definition"].decode(), kind))
                        known[number] = fields[b"topic"].decode(), kind
                elif op == OP_MESSAGE:
                    topic, kind = known.get(struct.unpack("<I", fields[b"conn"])[0], ("", ""))
                    seconds, rest = struct.unpack("<II", fields[b"time"])
                    if topic:
                        yield topic, seconds + 1e-9 * rest, store.deserialize_ros1(data, kind), kind


def _split_fields(data: bytes) -> dict[bytes, bytes]:
    """Return the values of the fields in the header of a record, by name."""
    found, at = {}, 0
    while at < len(data):
        size = struct.unpack_from("<I", data, at)[0]
        name, _, value = data[at + 4 : at + 4 + size].partition(b"=")
        found[name] = value
        at += 4 + size
    return found


def _find_bag(path: Path) -> Path:
    """Return the path that rosbags reads: a ROS 1 file, or the folder of a ROS 2 bag."""
    if not path.is_file() or path.suffix.lower() == ".bag":
        return path
    if (path.parent / "metadata.yaml").exists():
        return path.parent
    with open(path, "rb") as file:
        has_frames = b"arbitration_id" in file.read(1 << 16)  # a column that python-can writes
    if has_frames:
        raise UserError(
            f"{path}: is no ROS 2 bag, but an SQLite file with frames of a bus, written by python-can: "
            f"convert it to BLF: python -m can.logconvert {path.name} {path.stem}.blf"
        )
    raise UserError(
        f"{path}: is one file of a ROS 2 bag, but its folder has no metadata.yaml: "
        "give the folder of the complete bag"
    )


def read(path: Path, how: ReadOptions) -> Recording:
    """Read the fields of all messages as channels.

    A channel is named TOPIC.PATH, with the path of its field in the message."""
    highlevel = import_optional("rosbags.highlevel", "ros", str(path))
    typesys = import_optional("rosbags.typesys", "ros", str(path))
    bag = _find_bag(path)
    collect, notes = Collector(path, how.wanted), []
    count = 0
    strange: dict[str, str] = {}
    try:
        if bag.is_file() and not _is_closed(bag):
            notes.append("the bag was not closed, or its end is missing: the part before is used")
            for topic, time, message, kind in _read_from_front(bag, typesys):
                collect.add(topic, time, message, kind)
                count += 1
            if count:
                return Recording(path, "ROS bag", collect.channels(), notes)
        store = typesys.get_typestore(typesys.Stores.LATEST)
        with highlevel.AnyReader([bag], default_typestore=store) as reader:
            for connection, time, raw in reader.messages():
                if connection.topic in strange:
                    continue
                try:
                    message = reader.deserialize(raw, connection.msgtype)
                except KeyError as error:
                    strange[connection.topic] = str(error)
                    continue
                collect.add(connection.topic, 1e-9 * time, message, connection.msgtype)
                count += 1
    except (UserError, MemoryError):
        raise
    except Exception as error:  # a parser may raise any error
        if not count:
            raise UserError(
                f"{path}: is damaged or cut off: {type(error).__name__} {str(error)[:100]}; copy it again"
            ) from None
        notes.append(
            f"the bag is damaged after {count} messages ({str(error)[:60]}): the part before is used"
        )
    if strange:
        notes.append(f"not read, because the bag does not define their message types: {list_names(strange)}")
    if not count:
        unknown = f" (types unknown: {list_names(strange.values())})" if strange else ""
        raise UserError(f"{path}: has no message that can be read{unknown}")
    return Recording(path, "ROS bag", collect.channels(), notes)
