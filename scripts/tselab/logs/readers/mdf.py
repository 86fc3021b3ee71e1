"""MDF 3 and 4 by asammdf; frames of a bus in them by the databases."""

from __future__ import annotations

import gc
import logging
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from tselab.errors import UserError
from tselab.logs.extras import need
from tselab.logs.frames import databases_for, decode
from tselab.logs.recording import Channel, How, Recording

FRAMES = ("CAN_DataFrame", "CAN_DataFrame.ID", "CAN_DataFrame.DataBytes")


def read(path: Path, how: How) -> Recording:
    """Channels with their conversions; values that are marked invalid are missing. Frames are decoded and their messages named."""
    asammdf = need("asammdf", "mf4", str(path))
    logging.getLogger("asammdf").setLevel(logging.CRITICAL)
    notes: list[str] = []
    damage = ""
    hook = sys.unraisablehook
    sys.unraisablehook = lambda _: None  # what asammdf drops of a damaged file complains on its way out
    try:
        with asammdf.MDF(str(path)) as mdf:
            channels = _plain(mdf, how)
            frames = _frames(mdf)
            if frames is not None:
                channels |= decode(path, *frames, databases_for(path, how, required=not channels), how, notes)
            version = mdf.version
    except UserError:
        raise
    except Exception as error:  # asammdf's parsers stumble over damage in many ways
        damage = f"{type(error).__name__}: {str(error)[:120]}"
    finally:
        gc.collect()
        sys.unraisablehook = hook
    if damage:  # outside of the above, for an error keeps alive what it was raised beside
        raise UserError(f"{path}: is damaged or cut off: {damage}")
    return Recording(path, f"MDF {version}", channels, notes)


def _plain(mdf: Any, how: How) -> dict[str, Channel]:
    found: list[tuple[str, str, Channel]] = []
    for g, group in enumerate(mdf.groups):
        master = mdf.masters_db.get(g)
        times: dict[int, np.ndarray] = {}
        title = getattr(group.channel_group, "acq_name", None) or getattr(group.channel_group, "comment", "") or ""
        for c, channel in enumerate(group.channels):
            if c == master or channel.name.startswith("CAN_DataFrame") or (how.wanted and not how.wanted(channel.name)):
                continue
            value, time, unit, text = _samples(mdf, g, c)
            if value is None:
                continue
            time = times.setdefault(len(time), time)
            found.append((channel.name, str(title), Channel(channel.name, time, value, unit, text)))
    often = Counter(name for name, _, _ in found)
    channels: dict[str, Channel] = {}
    for name, title, c in found:
        full = name
        if often[name] > 1:
            full = f"{title}.{name}" if title else name
            k = 2
            while full in channels:
                full = f"{title + '.' if title else ''}{name}#{k}"
                k += 1
        channels[full] = Channel(full, c.time, c.value, c.unit, c.text)
    return channels


def _samples(mdf: Any, group: int, index: int) -> tuple[np.ndarray | None, np.ndarray, str, str]:
    signal = mdf.get(group=group, index=index, ignore_invalidation_bits=True)
    value = np.asarray(signal.samples)
    if value.dtype.kind not in "biuf":  # a table of texts: the numbers below it
        signal = mdf.get(group=group, index=index, raw=True, ignore_invalidation_bits=True)
        value = np.asarray(signal.samples)
    if value.dtype.kind not in "biuf" or value.ndim != 1 or not len(value):
        return None, np.zeros(0), "", ""
    value = value.astype(float)
    bad = signal.invalidation_bits
    if bad is not None and len(np.atleast_1d(bad)) == len(value):
        value = np.where(np.asarray(bad, bool), np.nan, value)
    return value, np.asarray(signal.timestamps, float), str(signal.unit or ""), str(signal.comment or "")[:200]


def _frames(mdf: Any) -> tuple[np.ndarray, np.ndarray, list[bytes]] | None:
    """Time, identifier and bytes of all frames of the buses, in order of time; None without any."""
    times, ids, data = [], [], []
    for g, group in enumerate(mdf.groups):
        for c, channel in enumerate(group.channels):
            if channel.name != FRAMES[0]:
                continue
            frame = mdf.get(group=g, index=c, raw=True)
            samples = frame.samples
            names = samples.dtype.names or ()
            if not all(n in names for n in FRAMES[1:]):
                continue
            raw = samples[FRAMES[2]]
            length = (
                samples["CAN_DataFrame.DataLength"]
                if "CAN_DataFrame.DataLength" in names
                else np.full(len(raw), raw.shape[1])
            )
            times.append(np.asarray(frame.timestamps, float))
            ids.append(np.asarray(samples[FRAMES[1]], np.int64) & 0x1FFFFFFF)
            data += [bytes(r[: int(n)]) for r, n in zip(raw, length, strict=True)]
    if not times:
        return None
    time, identifier = np.concatenate(times), np.concatenate(ids)
    order = np.argsort(time, kind="stable") if len(times) > 1 else np.arange(len(time))
    return time[order], identifier[order], [data[i] for i in order]
