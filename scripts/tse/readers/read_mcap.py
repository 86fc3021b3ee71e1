"""Read MCAP: messages of ROS 1, ROS 2, JSON and protobuf, by the schemas in the file."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from tse.library.errors import UserError
from tse.readers.recording import Collector, ReadOptions, Recording, import_optional, list_names


def read(path: Path, how: ReadOptions) -> Recording:
    """Read the fields of all messages as channels.

    A channel is named TOPIC.PATH, with the path of its field in the message."""
    mcap = import_optional("mcap.reader", "ros", str(path))
    collect, notes = Collector(path, how.wanted), []
    decoders: dict[int, Any] = {}
    strange: dict[str, str] = {}
    count = 0
    try:
        with open(path, "rb") as file:
            for schema, channel, message in _read_messages(mcap, file, notes):
                if channel.id not in decoders:
                    decoders[channel.id] = _find_decoder(path, channel, schema, strange)
                decoder = decoders[channel.id]
                if decoder is not None:
                    kind = schema.name if schema else ""
                    collect.add(channel.topic, 1e-9 * message.log_time, decoder(message.data), kind)
                    count += 1
    except (UserError, MemoryError):
        raise
    except Exception as error:  # a parser may raise any error
        if not count:
            raise UserError(
                f"{path}: is damaged or cut off: {type(error).__name__} {str(error)[:100]}; copy it again"
            ) from None
        notes.append(
            f"the file is damaged after {count} messages ({type(error).__name__} {str(error)[:60]}): "
            "the part before is used"
        )
    unread = list_names(f"{t} ({e})" for t, e in strange.items())
    if strange and not count:
        raise UserError(
            f"{path}: no topic can be read: {unread}; readable encodings: ROS 1, ROS 2, JSON, protobuf"
        )
    if strange:
        notes.append(f"topics that cannot be read: {unread}")
    return Recording(path, "MCAP", collect.channels(), notes)


MAGIC = b"\x89MCAP0\r\n"  # first and last bytes of a complete file


def _read_messages(mcap: Any, file: BinaryIO, notes: list[str]) -> Iterator[tuple[Any, Any, Any]]:
    """Yield schema, channel and message of all messages.

    The index is at the end of the file. If the end is missing, the file is read from the
    front, without the index."""
    file.seek(0, 2)
    file.seek(max(file.tell() - len(MAGIC), 0))
    whole = file.read() == MAGIC
    file.seek(0)
    if whole:
        yield from mcap.make_reader(file).iter_messages()
    else:
        notes.append("the end of the file is missing: the part before is used")
        yield from mcap.NonSeekingReader(file).iter_messages(log_time_order=False)


def _find_decoder(path: Path, channel: Any, schema: Any, strange: dict[str, str]) -> Any:
    """Return a decoder of the messages of a channel.

    If the encoding or the schema of the channel is unknown, return None, and add the
    topic of the channel, with the reason, to `strange`."""
    encoding = channel.message_encoding
    if encoding == "json":
        return json.loads
    factory = {
        "cdr": ("mcap_ros2.decoder", "ros"),
        "ros1": ("mcap_ros1.decoder", "ros"),
        "protobuf": ("mcap_protobuf.decoder", "ros"),
    }
    if encoding not in factory:
        strange[channel.topic] = f"encoding {encoding!r}"
        return None
    module = import_optional(*factory[encoding], str(path))
    found = module.DecoderFactory().decoder_for(encoding, schema)
    if found is None:
        strange[channel.topic] = f"schema {schema.encoding if schema else 'none'}"
    return _wrap_protobuf(found) if encoding == "protobuf" and found else found


def _wrap_protobuf(decoder: Any) -> Any:
    """Return a decoder that converts the messages of a protobuf decoder to dicts."""
    from google.protobuf.json_format import MessageToDict

    return lambda data: MessageToDict(decoder(data), preserving_proto_field_name=True)
