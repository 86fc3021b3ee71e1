"""Read openpilot's rlog and qlog by the schema in the package openpilot-logging."""

import bz2
import importlib.util
from pathlib import Path
from typing import Any

from tse.library.errors import UserError
from tse.readers.recording import Collector, ReadOptions, Recording, import_optional

# Services, i.e. kinds of messages in a log of openpilot, that have signals of the car's
# motion. All other services (cameras, neural networks, states of the software), which
# take most of a log, are skipped.
SERVICES = (
    "carState",
    "accelerometer",
    "gyroscope",
    "sensorEvents",
    "gpsLocation",
    "gpsLocationExternal",
    "livePose",
    "liveLocationKalman",
    "liveParameters",
    "carControl",
)


def read(path: Path, how: ReadOptions) -> Recording:
    """Read the fields of SERVICES as channels with names like carState.wheelSpeeds.fl."""
    capnp = import_optional("capnp", "openpilot", str(path))
    spec = importlib.util.find_spec("openpilot_logging")
    if spec is None or not spec.submodule_search_locations:
        import_optional("openpilot_logging", "openpilot", str(path))
        raise UserError(
            f"{path}: the Python package openpilot_logging does not contain the schema: "
            "pip install 'tse[openpilot]' (in a checkout: scripts/setup.sh logs)"
        )
    capnp.remove_import_hook()
    folder = Path(next(iter(spec.submodule_search_locations))) / "cereal"
    log = capnp.load(str(folder / "log.capnp"))
    raw = _unpack(path)
    collect, notes, count = Collector(path, how.wanted), [], 0
    try:
        for event in log.Event.read_multiple_bytes(raw):
            service = event.which()
            if service not in SERVICES:
                continue
            _add(collect, service, 1e-9 * event.logMonoTime, getattr(event, service))
            count += 1
    except (UserError, MemoryError):
        raise
    except Exception as error:  # a parser may raise any error
        if not count:
            raise UserError(
                f"{path}: is no log of openpilot, or is damaged: {str(error).splitlines()[0][:100]}"
            ) from None
        notes.append(f"the log is cut off after {count} events: the part before is used")
    if not count:
        raise UserError(f"{path}: has none of the services {', '.join(SERVICES)}")
    return Recording(path, "openpilot", collect.channels(), notes)


def _add(collect: Collector, service: str, time: float, message: Any) -> None:
    """Collect a message. sensorEvents has one message for each of several sensors."""
    if service == "sensorEvents":
        for part in message:
            collect.add(f"{service}.{part.which()}", time, part.to_dict())
        return
    collect.add(service, time, message.to_dict())


def _unpack(path: Path) -> bytes:
    """Return the content of a file, unpacked if it is packed by bzip2 or Zstandard."""
    raw = path.read_bytes()
    try:
        if raw.startswith(b"BZh"):
            return bz2.decompress(raw)
        if raw.startswith(b"\x28\xb5\x2f\xfd"):
            zstandard = import_optional("zstandard", "openpilot", str(path))
            return bytes(zstandard.ZstdDecompressor().stream_reader(raw).read())
    except (UserError, MemoryError):
        raise
    except (OSError, EOFError, ValueError) as error:
        raise UserError(f"{path}: is damaged or cut off: {error}; copy it again") from None
    return raw
