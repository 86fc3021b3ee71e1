"""openpilot's rlog and qlog, by the schema in the Python package openpilot-logging."""

import bz2
import importlib.util
from pathlib import Path
from typing import Any

from tse.library.errors import UserError
from tse.readers.recording import Collector, ReadOptions, Recording, import_optional

# Services that say how the car moves. Cameras, models and states of the software are left out: they are most of a log.
SERVICES = ("carState", "accelerometer", "gyroscope", "sensorEvents", "gpsLocation", "gpsLocationExternal", "livePose",
            "liveLocationKalman", "liveParameters", "carControl")  # fmt: skip


def read(path: Path, how: ReadOptions) -> Recording:
    """Fields of the services that say how the car moves, by their path: carState.wheelSpeeds.fl."""
    capnp = import_optional("capnp", "openpilot", str(path))
    spec = importlib.util.find_spec("openpilot_logging")
    if spec is None or not spec.submodule_search_locations:
        import_optional("openpilot_logging", "openpilot", str(path))
        raise UserError(f"{path}: the schema is not in the Python package openpilot_logging")
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
    except Exception as error:  # Cap'n Proto throws what C++ throws
        if not count:
            raise UserError(
                f"{path}: is no log of openpilot, or damaged: {str(error).splitlines()[0][:100]}"
            ) from None
        notes.append(f"the log is cut off after {count} events: what is before is used")
    if not count:
        raise UserError(f"{path}: has none of the services {', '.join(SERVICES)}")
    return Recording(path, "openpilot", collect.channels(), notes)


def _add(collect: Collector, service: str, time: float, message: Any) -> None:
    if service == "sensorEvents":
        for part in message:
            collect.add(f"{service}.{part.which()}", time, part.to_dict())
        return
    collect.add(service, time, message.to_dict())


def _unpack(path: Path) -> bytes:
    raw = path.read_bytes()
    try:
        if raw.startswith(b"BZh"):
            return bz2.decompress(raw)
        if raw.startswith(b"\x28\xb5\x2f\xfd"):
            return bytes(
                import_optional("zstandard", "openpilot", str(path))
                .ZstdDecompressor()
                .stream_reader(raw)
                .read()
            )
    except (UserError, MemoryError):
        raise
    except (OSError, EOFError, ValueError) as error:
        raise UserError(f"{path}: is damaged or cut off: {error}") from None
    return raw
