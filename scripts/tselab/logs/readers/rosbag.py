"""ROS 1 bags and the folders of ROS 2 bags by rosbags."""

from __future__ import annotations

from pathlib import Path

from tselab.errors import UserError
from tselab.logs.extras import need
from tselab.logs.fields import Collector
from tselab.logs.recording import How, Recording, listed


def read(path: Path, how: How) -> Recording:
    """Fields of all messages by topic and path."""
    highlevel = need("rosbags.highlevel", "ros", str(path))
    typesys = need("rosbags.typesys", "ros", str(path))
    bag = path
    if path.is_file() and path.suffix.lower() != ".bag":
        bag = path.parent
        if not (bag / "metadata.yaml").exists():
            with open(path, "rb") as file:
                frames = b"arbitration_id" in file.read(1 << 16)  # a column of the table that python-can writes
            if frames:
                raise UserError(
                    f"{path}: holds frames of a bus that python-can wrote, and is no bag of ROS 2: write them as BLF: "
                    f"python -m can.logconvert {path.name} {path.stem}.blf"
                )
            raise UserError(
                f"{path}: is one file of a ROS 2 bag, whose metadata.yaml is missing beside it: give the folder of the bag"
            )
    collect, notes = Collector(how.wanted), []
    count, strange = 0, {}
    try:
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
    except Exception as error:  # damage shows in many ways
        if not count:
            raise UserError(f"{path}: is damaged or cut off: {type(error).__name__} {str(error)[:100]}") from None
        notes.append(f"the bag is damaged after {count} messages ({str(error)[:60]}): what is before is used")
    if strange:
        notes.append(f"topics whose message types the bag does not define: {listed(strange)}")
    if not count:
        raise UserError(
            f"{path}: has no message that can be read{f' (types unknown: {listed(strange.values())})' if strange else ''}"
        )
    return Recording(path, "ROS bag", collect.channels(), notes, room=collect.room)
