"""Each part of a live drive by itself, without a bus and without waiting.

Covered are the reader of the bus, the record on disk, the rows for the filter, the
sentences about events, the numbers of the display, the page in the browser, and Live.
"""

import json
import math
import time
import urllib.error
import urllib.request
from collections import deque
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from small_car import CAR, CODE

import tse
from tse.api import live as _live
from tse.calibration.own import is_uncalibrated
from tse.car.config import make_config
from tse.channels.signals import read_signals
from tse.estimation.estimate import Learnt, list_est_columns
from tse.estimation.regimes import REGIMES
from tse.library.core import OUTPUT, STATUS, NativeFilter, library
from tse.library.errors import UserError
from tse.readers.bus_text import CanFrame
from tse.streaming import drive as part
from tse.streaming import page as pages
from tse.streaming.drive import Arrived, DriveState, LiveDrive, Reader, Record

STATE = {f.name: code for code, f in library().codes(STATUS).items()}
IN_KILO = {"cx_front": 80.0, "cy_front": 100.0, "cy_rear": 150.0}  # nominal, kN and kN/rad


class Bus:
    """A bus that gives messages; an exception among them is raised."""

    def __init__(self, messages=(), at_end=lambda: None):
        self.messages, self.at_end, self.closed = deque(messages), at_end, 0

    def recv(self, timeout):
        if not self.messages:
            self.at_end()
            time.sleep(0.001)
            return None
        found = self.messages.popleft()
        if isinstance(found, Exception):
            raise found
        return found

    def shutdown(self):
        self.closed += 1


def make_message(identifier=1, **more):
    given = {"timestamp": 5.0, "arbitration_id": identifier, "is_extended_id": False, "channel": None}
    given |= {"is_error_frame": False, "is_remote_frame": False, "data": bytearray(b"\x01\x02")}
    return SimpleNamespace(**{**given, **more})


def make_arrived(stamp, at=0.0, identifier=1):
    return Arrived(CanFrame(stamp, identifier, False, "0", b""), at)


def make_outputs(rows=1, **values):
    """Return outputs of the library that are valid and equal nominal."""
    out = np.zeros(rows, library().dtype(OUTPUT))
    for name in out.dtype.names:
        out[name] = 0
    for s in tse.STIFFNESS:
        out[s] = 1.0
        out[f"{s}_valid"] = CODE["valid"]
    for name, value in values.items():
        out[name] = value
    return out


def make_config_of(car=CAR):
    return make_config(tse.read_vehicle(car), None)[0]


@pytest.fixture
def begin(monkeypatch):
    """Return a function that makes a drive whose threads have ended."""
    monkeypatch.setattr(
        part, "gc", SimpleNamespace(collect=lambda: 0, freeze=lambda: None, unfreeze=lambda: None)
    )
    monkeypatch.setattr(part, "_warm_up", lambda config: None)
    monkeypatch.setattr(part, "Bus", lambda *_: SimpleNamespace(knows=lambda i: i == 1))
    made = []

    def make(folder=None, car=CAR, signals=None, **more):
        bus = Bus()
        live = LiveDrive(lambda: bus, (), tse.read_vehicle(car), make_config_of(car), signals, folder, **more)
        live._ended.set()
        live.reader.stop()
        live._keeper.join()
        made.append(live)
        return live

    yield make
    for live in made:
        live.record.close()


def read_said(live):
    return [text for _, text in live.said]


# ---- the bus


def read_bus(messages):
    """Return the reader after it has read all messages, what it has said and recorded."""
    said, recorded = [], []
    bus = Bus(messages)
    reader = Reader(lambda: bus, said.append, recorded.append)
    bus.at_end = reader._ended.set
    reader.run()
    return reader, said, recorded


def test_a_reader_takes_data_frames_as_they_are_and_records_each():
    sent = [
        make_message(0x123, timestamp=7.25, channel="can1", is_extended_id=True, data=bytearray(b"\x05")),
        make_message(9, is_remote_frame=True),
        make_message(2, timestamp=7.5),
    ]
    before = time.monotonic()
    reader, said, recorded = read_bus(sent)
    assert recorded == [sent[0], sent[2]] and reader.count == 2 and reader.errors == 0 and said == []
    came = reader.take(0.0)
    assert [a.frame for a in came] == [
        CanFrame(7.25, 0x123, True, "can1", b"\x05"),
        CanFrame(7.5, 2, False, "0", b"\x01\x02"),
    ]
    assert all(before <= a.at <= time.monotonic() for a in came)
    assert reader.take(0.0) == []


def test_error_frames_are_counted_and_reported_once_in_ten_seconds(monkeypatch):
    clock = iter([100.0, 100.0, 105.0, 111.0, 111.0])
    monkeypatch.setattr(part, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    error = make_message(0x4, is_error_frame=True)
    reader, said, recorded = read_bus([error] * 3)
    assert reader.errors == 3 and reader.count == 0 and recorded == []
    assert [s.partition(" on the bus")[0] for s in said] == ["1 error frame", "3 error frames"]


def test_a_bus_is_off_unless_its_controller_has_restarted():
    off, restarted = (make_message(i, is_error_frame=True) for i in (0x40, 0x140))
    _, said, _ = read_bus([off])
    assert len(said) == 1 and said[0].startswith("the bus is off")
    _, said, _ = read_bus([restarted])
    assert len(said) == 1 and said[0].startswith("1 error frame on the bus")


def test_a_bus_that_fails_is_closed_and_opened_again_after_a_second(monkeypatch):
    waits, said, used = [], [], []
    first, second = Bus([OSError("x" * 200)]), Bus([make_message(3)])
    openers = iter([first, OSError("away"), second])

    def open_bus():
        found = next(openers)
        used.append(found)
        if isinstance(found, Exception):
            raise found
        return found

    reader = Reader(open_bus, said.append, lambda _: None)
    first.at_end = second.at_end = reader._ended.set
    plain = reader._ended.wait
    monkeypatch.setattr(reader._ended, "wait", lambda s: waits.append(s) or plain(0.0))
    reader.run()
    assert len(used) == 3 and first.closed == 1 and second.closed == 0 and waits == [1.0, 1.0]
    assert len(said) == 2 and said[1] == "the bus is open again"
    assert said[0].startswith(f"the bus failed ({'x' * 120}): tselab tries")
    assert reader.count == 1
    reader.stop()
    assert second.closed == 1


def test_an_error_without_a_text_has_the_name_of_its_type():
    reader, said, _ = read_bus([])
    reader._ended.clear()
    reader._ended.wait = lambda _: True
    reader._fail(TimeoutError())
    assert said[0].startswith("the bus failed (TimeoutError)") and reader._bus is None
    reader._fail(TimeoutError())
    assert len(said) == 1  # it is reported once, until the bus is open again


def test_a_bus_is_opened_with_channel_and_options_and_a_refusal_has_the_drivers_words(monkeypatch):
    asked = []

    def open_bus(**given):
        asked.append(given)
        if given["channel"] == "bad":
            raise RuntimeError("z" * 300)
        if given["channel"] == "dumb":
            raise RuntimeError
        return "open"

    monkeypatch.setattr(part, "import_optional", lambda *_: SimpleNamespace(Bus=open_bus))
    assert part.make_bus_opener("pcan", "can7", bitrate=500000)() == "open"
    assert asked == [{"interface": "pcan", "channel": "can7", "bitrate": 500000}]
    for channel, text in (("bad", "z" * 200 + "$"), ("dumb", "RuntimeError$")):
        with pytest.raises(
            UserError, match=f"^interface pcan, channel {channel}: cannot be opened: {text}"
        ) as error:
            part.make_bus_opener("pcan", channel)()
        assert error.value.__cause__ is None


# ---- the record


def test_a_record_appends_and_needs_an_empty_folder(tmp_path):
    record = Record(tmp_path / "new", lambda _: None)
    record.write("a.csv", b"1\n")
    record.write("b.csv", b"x")
    record.write("a.csv", b"2\n")
    assert (tmp_path / "new" / "a.csv").read_bytes() == b"1\n2\n"  # also before it is closed
    record.close()
    with pytest.raises(UserError, match="new: is not empty"):
        Record(tmp_path / "new", lambda _: None)


def test_without_a_folder_nothing_is_recorded_and_nothing_is_left():
    said = []
    record = Record(None, said.append)
    record.write("a.csv", b"1")
    record.frame(make_message())
    assert record.folder.is_dir() and not list(record.folder.iterdir()) and said == []
    record.close()
    assert not record.folder.exists()


def test_a_record_that_cannot_be_written_is_reported_once_and_ends(tmp_path):
    said = []
    record = Record(tmp_path / "out", said.append)

    def full():
        raise OSError(28, "No space left on device")

    record._run_guarded(full)
    record.write("a.csv", b"1")
    record.frame(make_message())
    assert len(said) == 1 and "(No space left on device)" in said[0] and "no longer recorded" in said[0]
    assert not list((tmp_path / "out").iterdir())
    other = []
    Record(tmp_path / "text", other.append)._run_guarded(lambda: (_ for _ in ()).throw(OSError("odd")))
    assert "cannot be written (odd)" in other[0]


def test_each_frame_goes_to_one_file_of_the_record(tmp_path, monkeypatch):
    made = []

    class Writer:
        def __init__(self, path):
            self.path, self.got, self.stopped = path, [], 0
            made.append(self)

        def on_message_received(self, message):
            self.got.append(message)

        def stop(self):
            self.stopped += 1

    monkeypatch.setattr(part, "import_optional", lambda *_: SimpleNamespace(BLFWriter=Writer))
    record = Record(tmp_path / "out", lambda _: None)
    for message in ("one", "two"):
        record.frame(message)
    record.close()
    assert [(w.path, w.got, w.stopped) for w in made] == [
        (str(tmp_path / "out" / "frames.blf"), ["one", "two"], 1)
    ]


def test_a_record_holds_databases_signals_and_the_state_before_the_drive(tmp_path, begin):
    (tmp_path / "car.dbc").write_text("DBC")
    text = '[log]\ndatabases = ["car.dbc"]\nrate = 50\n[signals.yaw_rate]\nname = "r"\n'
    (tmp_path / "signals.toml").write_text(text)
    live = begin(tmp_path / "out")
    live.databases = (tmp_path / "car.dbc",)
    live._signals = read_signals(tmp_path / "signals.toml")
    live._learnt = SimpleNamespace(data=b"state", note="car.tse, 2 days old")
    live._copy_inputs()
    kept = {p.name: p.read_text() for p in (tmp_path / "out").iterdir()}
    assert kept == {
        "car.dbc": "DBC",
        "frames.signals.toml": text.replace('databases = ["car.dbc"]\n', ""),
        "before.tse": "state",
    }
    assert live.started_from == "car.tse, 2 days old"
    live._learnt = None
    assert live.started_from is None


def test_a_drive_with_signals_makes_rows_from_the_beginning(begin, monkeypatch):
    made = []
    monkeypatch.setattr(part, "Stream", lambda *given: made.append(given) or make_stream())
    signals = SimpleNamespace(path=None)
    live = begin(signals=signals, rate=50.0)
    assert made == [((), signals, live.vehicle, 50.0)] and live.stream is not None


def test_a_learnt_state_that_is_refused_ends_a_drive_before_its_bus_is_opened(begin):
    def refuse(filter_):
        assert isinstance(filter_, NativeFilter)
        raise UserError("car.tse: is of another vehicle")

    config = make_config_of()
    with pytest.raises(UserError, match="of another vehicle"):
        LiveDrive(lambda: pytest.fail("opened"), (), tse.read_vehicle(CAR), config, None, None,
                  SimpleNamespace(load=refuse))  # fmt: skip


# ---- sentences


def test_a_sentence_has_the_time_of_the_drive_and_is_recorded(tmp_path, begin):
    heard = []
    live = begin(tmp_path / "out", say=heard.append)
    live.drive.time = 12.346
    live.say("it rains")
    live.drive.time = 13.0
    live.say("it stops")
    assert live.said == [(12.346, "it rains"), (13.0, "it stops")] and heard == ["it rains", "it stops"]
    assert (tmp_path / "out" / "events.txt").read_text() == "12.35 s: it rains\n13.00 s: it stops\n"


def test_a_sentence_that_differs_in_numbers_only_is_said_once(begin):
    live = begin()
    for text in ("3.5 % of accel_y", "4.25 % of accel_y", "4.25 % of accel_x", "3.5 % of accel_x"):
        live._say_once(text)
    assert read_said(live) == ["3.5 % of accel_y", "4.25 % of accel_x"]


def test_a_silent_bus_is_reported_after_a_second_and_again_when_frames_arrive(begin):
    live = begin()
    live._last_frame = 100.0
    live._look_at_bus([], 101.0)
    assert live.said == []
    for now in (101.01, 105.0):
        live._look_at_bus([], now)
    assert len(live.said) == 1 and read_said(live)[0].startswith("no frame for a second")
    live._look_at_bus([make_arrived(0.0)], 106.5)
    assert read_said(live)[1:] == ["frames arrive again, after 6.5 s without a frame"]
    live._look_at_bus([make_arrived(0.0)], 106.6)
    live._look_at_bus([], 107.55)
    assert len(live.said) == 2
    live._look_at_bus([], 107.65)
    assert len(live.said) == 3


def test_a_foreign_bus_is_reported_two_seconds_after_the_first_frame(begin):
    strange, own = make_arrived(0.0, identifier=0x258), make_arrived(0.0, identifier=1)
    live = begin()
    live.databases = (Path("a/car.dbc"), Path("b.dbc"))
    live._listened = [strange, make_arrived(0.0, identifier=0x1F), strange]
    live._look_at_bus(live._listened, 50.0)
    live._look_at_bus(live._listened, 51.9)
    assert live.said == []
    for now in (52.0, 60.0):
        live._look_at_bus(live._listened, now)
    assert len(live.said) == 1
    assert read_said(live)[0].startswith("none of the 2 identifiers (0x1f, 0x258) is in car.dbc, b.dbc:")
    mixed = begin()
    mixed._listened = [strange, own, own]
    assert mixed._count() == (2, {0x258: 1})
    for now in (50.0, 53.0):
        mixed._look_at_bus(mixed._listened, now)
    assert mixed.said == []
    streamed = begin()
    streamed._listened, streamed.stream = [own], SimpleNamespace(known=0, unknown={7: 2})
    for now in (50.0, 53.0):  # the stream counts, as soon as there is one
        streamed._look_at_bus([own], now)
    assert read_said(streamed)[0].startswith("none of the 1 identifiers (0x7)")


def make_stream(**more):
    given = {"time": 10.0, "rate": 100.0, "one_speed": False, "notes": [], "last": {}, "known": 1}
    given |= {"unknown": {}, "find_message": lambda c: f"M_{c}", "add": lambda frames: []}
    given["make_rows"] = lambda until: (np.zeros(0), {})
    return SimpleNamespace(**{**given, **more})


def test_each_channel_that_is_silent_for_more_than_a_second_is_reported_once(begin):
    live = begin()
    live.stream = make_stream(last={"yaw_rate": 9.0, "accel_y": 8.9})
    for _ in range(2):
        live._look_at_channels()
    assert len(live.said) == 1
    assert read_said(live)[0].startswith("accel_y: no value for a second (message M_accel_y)")
    live.stream.time, live.stream.last = 12.0, {"yaw_rate": 11.9, "accel_y": 11.9}
    for _ in range(2):
        live._look_at_channels()
    assert read_said(live)[1:] == ["accel_y: values arrive again, after 3.1 s without a value"]


def test_silent_channels_are_not_reported_while_the_bus_is_silent_or_before_the_rows_begin(begin):
    live = begin()
    live.stream = make_stream(last={"accel_y": 2.0})
    live._quiet = True
    live._look_at_channels()
    live._quiet, live.stream.rate = False, None
    live._look_at_channels()
    assert live.said == []
    live.stream.rate = 50.0
    live._look_at_channels()
    assert len(live.said) == 1


@pytest.mark.parametrize(
    ("calls", "expected"),
    [
        ([("fault", 1.0, 2.0), ("fault", 3.0, 4.0)], [False, True]),  # a second later: the same
        ([("fault", 1.0, 2.0), ("fault", 3.01, 4.0)], [False, False]),
        ([("fault", 1.0, 2.0), ("sliding", 1.0, 2.0)], [False, False]),
        ([("fault", 1.0, 5.0), ("fault", 2.0, 3.0), ("fault", 5.9, 6.0)], [False, True, True]),
        ([("fault", 1.0, 2.0), ("fault", 2.5, 6.0), ("fault", 6.5, 7.0)], [False, True, True]),
        ([("changed", 1.0), ("changed", 2.0), ("changed", 3.1)], [False, True, False]),
        ([("fault", 1.0, 2.0), ("fault", 9.0, 9.5), ("fault", 9.6, 9.7)], [False, False, True]),
    ],
)
def test_an_event_within_a_second_of_one_of_its_name_is_the_same(calls, expected, begin):
    live = begin()
    assert [live._is_reported(*call) for call in calls] == expected


def make_tail(end, change=None, spell=None):
    """Return a block of the summary up to `end`, with a change or a spell.

    `change`: time, kind and ratio. `spell`: column, first and last time.
    """
    t = np.round(np.arange(end - 25.0, end + 1e-9, 0.1), 3)
    n = len(t)
    block = {"time": t, "status": np.zeros(n, int), "change_kind": np.zeros(n, int)}
    block |= {c: np.zeros(n) for c in ("change_age", "p_fault", "p_sliding", "change_probability")}
    block |= {f"change_{s}": np.full(n, np.nan) for s in tse.STIFFNESS}
    block |= {"fault_channel": np.zeros(n, int), "estimate_age": np.zeros(n)}
    if change:
        when, kind, ratio = change
        rows = t >= when
        block["change_kind"][rows], block["change_age"][rows] = kind, t[rows] - when
        block["change_probability"][rows] = 0.99
        block["change_cy_front"][rows] = ratio
    if spell:
        column, first, last = spell
        block[column][(t >= first - 1e-9) & (t <= last + 1e-9)] = 0.95
    return block


def test_a_change_is_reported_when_it_is_half_a_second_old(begin):
    live = begin()
    live._table, live.drive.time = [make_tail(30.0, change=(29.7, 2, 0.8))], 30.0
    live._look_back()
    assert live.said == []
    live._table, live.drive.time = [make_tail(31.0, change=(29.7, 2, 0.8))], 31.0
    for _ in range(2):
        live._look_back()
    assert len(live.said) == 1
    assert read_said(live)[0].startswith("front axle changed at 29.70 s: front cornering x 0.80")


@pytest.mark.parametrize(
    ("spell", "texts"),
    [
        (("p_sliding", 29.6, 30.0), []),  # too short
        (("p_sliding", 29.0, 30.0), ["sliding since 29.00 s, probability 95 %"]),
        (("p_sliding", 27.0, 28.0), ["sliding 27.00 .. 28.00 s, 95 %"]),
        (("p_sliding", 5.2, 9.0), []),  # before the last 20 s
        (("p_fault", 28.0, 30.0), ["fault since 28.00 s, probability 95 %"]),
    ],
)
def test_a_fault_or_sliding_of_more_than_half_a_second_is_reported_as_lasting_or_over(spell, texts, begin):
    live = begin()
    live._table, live.drive.time = [make_tail(30.0, spell=spell)], 30.0
    live._look_back()
    assert read_said(live) == texts
    live.drive.contradicted = ["yaw_rate is positive to the right"]
    live._happened = []
    live._look_back()  # events of channels that contradict each other are none
    assert read_said(live) == texts


def test_events_are_searched_in_all_blocks_of_the_last_twenty_seconds(begin):
    live = begin()
    whole = make_tail(30.0, spell=("p_sliding", 15.0, 17.0))
    cuts = [slice(0, 60), slice(60, 110), slice(110, 200), slice(200, None)]
    live._table, live.drive.time = [{n: x[c] for n, x in whole.items()} for c in cuts], 30.0
    live._look_back()
    assert read_said(live) == ["sliding 15.00 .. 17.00 s, 95 %"]


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({}, False),
        ({"change_kind": 1, "change_age": 19.9}, True),
        ({"change_kind": 1, "change_age": 20.0}, False),
        ({"change_kind": 0, "change_age": 1.0}, False),
        ({"p_fault": 0.9}, True),
        ({"p_fault": 0.89, "p_sliding": 0.89}, False),
        ({"p_sliding": 0.9}, True),
    ],
)
def test_rows_with_a_recent_change_a_fault_or_sliding_have_an_event(values, expected):
    x = {n: np.zeros(3) for n in ("time", "change_kind", "change_age", "p_fault", "p_sliding")}
    for name, value in values.items():
        x[name][1] = value
    assert part._has_event(x) is expected
    assert not part._has_event({n: v[:0] for n, v in x.items()})
    assert not part._has_event({n: v for n, v in x.items() if n != "change_kind"})


# ---- pieces, cells, hints


def test_frames_are_cut_into_pieces_of_a_fifth_of_a_second():
    came = [make_arrived(t) for t in (0.0, 0.1, 0.2, 0.21, 0.4, 0.42, 0.1)]
    pieces = part._cut_pieces(came)
    assert [[a.frame.time for a in p] for p in pieces] == [[0.0, 0.1, 0.2], [0.21, 0.4], [0.42], [0.1]]
    assert part._cut_pieces([]) == []


@pytest.mark.parametrize(
    ("value", "cell"), [(math.nan, ""), (0.1, "0.1"), (0.0, "0.0"), (1 / 3, repr(1 / 3)), (-2.5, "-2.5")]
)
def test_a_cell_has_all_digits_and_a_missing_value_is_empty(value, cell):
    assert part._format_cell(value) == cell


def test_the_hint_is_the_most_similar_signal_of_the_first_missing_channel_that_has_one():
    proposal = SimpleNamespace(nearest={"yaw_rate": ("Gier: too slow", "Rate: no unit"), "accel_y": ("Q",)})
    missing = ("steer_angle", "yaw_rate", "accel_y")
    assert part._find_nearest(proposal, missing) == " (most similar signal: Gier: too slow)"
    assert part._find_nearest(proposal, ("steer_angle",)) == ""


# ---- proposed signals


def test_frames_are_searched_after_twenty_seconds_and_then_in_intervals_of_them(begin, monkeypatch):
    live, searches = begin(), []
    monkeypatch.setattr(live, "_propose", lambda came: searches.append(len(came)))
    live._first_frame = 100.0
    for now in (110.0, 120.0):
        live._listen([make_arrived(now)], now)
        assert live._proposing is None
    live._listen([make_arrived(120.5)], 120.5)
    live._proposing.join()
    assert searches == [3]
    live._listen([make_arrived(121.0)], 121.0)  # it has ended without a result
    assert live._proposing is None and live.stream is None
    for now, count in ((140.4, 1), (140.6, 2)):
        live._listen([], now)
        if live._proposing is not None:
            live._proposing.join()
        assert len(searches) == count


def test_of_frames_that_span_more_than_ten_minutes_the_older_half_is_dropped(begin):
    live = begin()
    live._listen([make_arrived(t) for t in (0.0, 200.0, 400.0, 600.0)], 0.0)
    assert len(live._listened) == 4
    live._listen([make_arrived(600.1)], 0.0)
    assert [a.frame.time for a in live._listened] == [400.0, 600.0, 600.1]


def test_rows_begin_with_the_proposed_signals(begin, monkeypatch):
    live, made = begin(), []

    def make_it(*given):
        made.append(given)
        return make_stream(notes=["a note of the database"])

    monkeypatch.setattr(part, "Stream", make_it)
    live._rate = 50.0
    live._proposing = SimpleNamespace(is_alive=lambda: True)
    live._proposed = "signals"
    live._listen([], 1.0)
    assert made == []
    live._proposing.is_alive = lambda: False
    live._listen([], 1.0)
    assert made == [((), "signals", live.vehicle, 50.0)] and live._signals == "signals"
    assert read_said(live) == ["a note of the database"] and live.stream.notes == []


@pytest.mark.parametrize(
    ("missing", "said"),
    [
        (("accel_x",), None),
        (("accel_x", "yaw_rate"), "no signal found so far for yaw_rate: drive some bends"),
    ],
)
def test_a_search_needs_all_channels_but_the_longitudinal_acceleration(
    missing, said, begin, monkeypatch, tmp_path
):
    frames = []
    bus = SimpleNamespace(add=lambda *x: frames.append(x), channels=lambda times, *_: [times])
    live = begin(tmp_path / "out")
    monkeypatch.setattr(part, "Bus", lambda *_: bus)
    monkeypatch.setattr(
        part,
        "Recording",
        lambda path, kind, channels, notes: SimpleNamespace(since_start=lambda: channels[0].tolist()),
    )
    seen = []
    proposal = SimpleNamespace(missing=missing, nearest={}, guesses=["g"])
    monkeypatch.setattr(part, "propose", lambda recording, car: seen.append((recording, car)) or proposal)
    monkeypatch.setattr(part, "format_signals", lambda *_: "text")
    monkeypatch.setattr(part, "format_headline", lambda g: f"headline of {g}")
    monkeypatch.setattr(part, "read_signals", lambda path: path.read_text())
    first = Arrived(CanFrame(1.0, 5, True, "can1", b"\x05"), 0.0)
    live._propose([first, make_arrived(3.0), make_arrived(2.0)])
    assert seen == [([1.0, 3.0, 3.0], live.vehicle)]  # a time stamp never goes back
    assert frames[0][0].tolist() == [5, 1, 1] and frames[0][1].tolist() == [True, False, False]
    assert frames[0][2:] == (["can1", "0", "0"], [b"\x05", b"", b""])
    if said is None:
        assert live._proposed == "text" and read_said(live)[0] == "proposed: headline of g"
        assert "frames.signals.toml" in read_said(live)[1]
    else:
        assert live._proposed is None and len(live.said) == 1 and read_said(live)[0].startswith(said)
    monkeypatch.setattr(part, "propose", lambda *_: 1 / 0)
    for _ in range(2):
        live._propose([make_arrived(1.0)])
    assert read_said(live)[-1].startswith("the search for signals failed (ZeroDivisionError: division")
    assert sum("failed" in s for s in read_said(live)) == 1


# ---- rows for the filter


ROW = {
    "steer_angle": 0.01,
    "wheel_speed_front": 60.0,
    "wheel_speed_rear": 61.0,
    "accel_x": 0.2,
    "accel_y": 1.0,
    "yaw_rate": 0.05,
}


def make_columns(count, **more):
    return {n: np.full(count, x) for n, x in {**ROW, **more}.items()}


def test_the_first_row_has_the_sample_time_and_each_other_the_time_since_the_row_before(begin):
    live = begin()
    live.config.sample_time = 0.02
    rows = live._make_inputs(np.array([5.0, 5.03]), make_columns(2, gnss_speed=[19.0, np.nan]))
    assert rows["dt"] == pytest.approx([0.02, 0.03]) and live.drive.first == 5.0
    for name, value in ROW.items():
        assert (rows[name] == np.float64(value)).all()
    bit = 1 << [f.name for f in library().optional].index("gnss_speed")
    assert rows["given"].tolist() == [bit, 0] and rows["gnss_speed"].tolist() == [19.0, 0.0]
    live.drive.rows, live.drive.time = 2, 5.03
    assert live._make_inputs(np.array([5.1]), make_columns(1))["dt"] == pytest.approx([0.07])
    assert live.drive.first == 5.0


@pytest.mark.parametrize(("first", "origin"), [(1.7e9 + 0.25, 1.7e9), (999_999.5, 0.0)])
def test_times_of_the_epoch_are_counted_from_the_second_before_the_first_row(first, origin, begin):
    live = begin()
    live.stream = make_stream()
    live._start(first)
    assert live._origin == origin and isinstance(live.filter, NativeFilter)


def test_the_filter_starts_with_the_rate_of_the_rows_and_its_settings_are_recorded(tmp_path, begin):
    live = begin(tmp_path / "out")
    live.config.cornering_stiffness_front = 90e3
    live.stream = make_stream(rate=25.0, one_speed=True)
    live._start(3.0)
    assert live.config.sample_time == 0.04 and live.config.wheel_signals == 1 and live.said == []
    lines = (tmp_path / "out" / "filter.toml").read_text().splitlines()
    assert lines[0].startswith("#")
    kept = dict(line.split(" = ") for line in lines[1:])
    assert {k: float(v) for k, v in kept.items()} == {
        "cornering_stiffness_front": 90e3,
        "sample_time": 0.04,
        "max_gap": live.config.max_gap,
        "wheel_signals": 1,
    }
    slow, loaded = begin(), []
    slow.stream = make_stream(rate=4.0)
    slow._learnt = SimpleNamespace(load=loaded.append)
    slow._start(3.0)
    assert "rows are 0.25 s apart" in read_said(slow)[0]
    assert slow.config.wheel_signals == make_config_of().wheel_signals != 1
    assert loaded == [slow.filter]


def step(live, times, came, now=0.0, outputs=None):
    """Run one step on rows of these times."""
    live.stream.make_rows = lambda until: (np.array(times, float), make_columns(len(times)))
    if outputs is not None:
        live.filter = SimpleNamespace(
            outputs=lambda n: np.zeros(n, library().dtype(OUTPUT)),
            step_into=lambda rows, out: out.__setitem__(slice(None), outputs),
        )
        live._origin = 0.0
    return live._step(came, now)


def test_a_step_counts_rows_valid_rows_and_statuses(begin):
    live = begin()
    live.stream = make_stream()
    outputs = make_outputs(4, cy_front=0.5)
    outputs["cy_front_valid"][0] = CODE["starting"]
    outputs["cy_rear_valid"][:2] = CODE["held"]
    outputs["status"][3] = STATE["TSE_E_INPUT"]
    times, found = step(live, [10.0, 10.1, 10.2, 10.4], [make_arrived(9.0)], outputs=outputs)
    assert times.tolist() == [10.0, 10.1, 10.2, 10.4] and (found["cy_front"] == 0.5).all()
    assert live._valid == {"cx_front": 3, "cy_front": 2, "cy_rear": 1}
    assert live.drive.rows == 4 and (live.drive.first, live.drive.time) == (10.0, 10.4)
    assert live.drive.statuses == {0: 3, STATE["TSE_E_INPUT"]: 1}
    assert live.last["status"] == STATE["TSE_E_INPUT"] and len(live._pending) == 1
    live.drive.contradicted = ["yaw_rate is positive to the right"]
    _, found = step(live, [10.5], [], outputs=make_outputs())
    assert found["cy_front_valid"][0] == CODE["implausible"] and live._valid["cy_front"] == 2
    assert live.drive.rows == 5 and live.drive.first == 10.0


def test_times_of_a_drive_count_from_its_first_second_with_one_filter(begin):
    live = begin()
    live.stream = make_stream()
    times, _ = step(live, [1.7e9 + 0.9, 1.7e9 + 1.1], [make_arrived(0.0)])
    filter_ = live.filter
    assert times == pytest.approx([0.9, 1.1], abs=1e-5) and live.drive.first == times[0]
    times, _ = step(live, [1.7e9 + 2.2], [make_arrived(0.0)])
    assert times == pytest.approx([2.2], abs=1e-5) and live.filter is filter_
    rows = live._make_inputs(np.array([2.3]), make_columns(1, accel_y=np.nan))
    assert np.isnan(rows["accel_y"]).all() and not np.isnan(rows["accel_x"]).any()


def test_the_delay_is_that_of_the_oldest_frame_and_the_worst_of_a_second(begin, monkeypatch):
    live = begin()
    live.stream = make_stream()
    clock = [0.0]
    monkeypatch.setattr(part.time, "monotonic", lambda: clock[0])
    for now, age, worst in ((100.0, 0.03, 0.03), (100.5, 0.01, 0.03), (101.2, 0.02, 0.02)):
        clock[0] = now
        step(live, [now, now + 0.01], [make_arrived(0.0, now - age), make_arrived(0.0, now)],
             outputs=make_outputs(2))  # fmt: skip
        assert live.drive.delay == pytest.approx(worst)
    assert live.drive.delays == pytest.approx([0.03] * 2 + [0.01] * 2 + [0.02] * 2)
    step(live, [102.0], [], outputs=make_outputs())  # no frame, no delay
    many = np.arange(50) * 0.01 + 103.0  # half a second of rows: their frames have waited
    step(live, many, [make_arrived(0.0, 1.0)], outputs=make_outputs(50))
    assert len(live.drive.delays) == 6


def test_without_frames_rows_are_made_up_to_the_present(begin):
    live, until = begin(), []
    live.stream = make_stream(time=50.0, notes=["1 value", "2 value"])
    live.stream.make_rows = lambda t: until.append(t) or (np.zeros(0), {})
    live._last_frame = 7.0
    times, outputs = live._step([], 7.25)
    assert len(times) == len(outputs) == 0 and outputs.dtype == library().dtype(OUTPUT)
    live._step([make_arrived(1.0)], 7.25)
    assert until == [50.25, 50.0] and read_said(live) == ["1 value"] and live.stream.notes == []


def test_work_steps_piece_by_piece_and_joins_the_rows(begin, monkeypatch):
    live, given = begin(), []
    came = [make_arrived(t) for t in (0.0, 0.1, 0.5)]
    live.reader.take = lambda timeout: came if timeout else []
    live.stream = make_stream(add=lambda frames: given.append([f.time for f in frames]) or ["set back"])
    rows = iter([(np.array([1.0, 2.0]), make_outputs(2)), (np.array([3.0]), make_outputs(1, cy_rear=0.3))])
    monkeypatch.setattr(live, "_step", lambda part_, now: next(rows))
    times, outputs = live.work()
    assert given == [[0.0, 0.1], [0.5]] and times.tolist() == [1.0, 2.0, 3.0]
    assert outputs["cy_rear"].tolist() == [1.0, 1.0, 0.3]
    assert live.drive.frames == 3 and read_said(live) == ["set back"] * 2


def test_frames_collected_before_the_signals_are_known_are_used_once(begin, monkeypatch):
    live, looked, channels, stepped = begin(), [], [], []
    frames = iter([[make_arrived(1.0)], [make_arrived(1.1)], [make_arrived(1.2)], []])
    live.reader.take = lambda timeout: next(frames) if timeout else []

    def listen(came, now):
        live._listened += came
        if len(live._listened) == 2:
            live.stream = make_stream()

    monkeypatch.setattr(live, "_listen", listen)
    monkeypatch.setattr(live, "_look_at_bus", lambda came, now: looked.append(len(came)))
    monkeypatch.setattr(live, "_look_at_channels", lambda: channels.append(1))
    nothing = (np.zeros(0), make_outputs(0))
    monkeypatch.setattr(live, "_step", lambda x, now: stepped.append([a.frame.time for a in x]) or nothing)
    for _ in range(4):
        times, outputs = live.work()
        assert len(times) == len(outputs) == 0
    assert stepped == [[1.0, 1.1], [1.2], []]  # also without frames: rows up to the present
    assert looked == [1, 1, 1, 0] and len(channels) == 3 and live.drive.frames == 3
    assert live._listened == []


def test_work_waits_for_two_milliseconds_since_the_last_frames_and_takes_what_came(begin, monkeypatch):
    live, slept, clock = begin(), [], [50.0]
    monkeypatch.setattr(part, "time", SimpleNamespace(monotonic=lambda: clock[0], sleep=slept.append))
    live.stream, given = make_stream(add=lambda frames: given.append([f.time for f in frames]) or []), []
    monkeypatch.setattr(live, "_step", lambda *_: (np.zeros(0), make_outputs(0)))
    live.reader.take = lambda timeout: [make_arrived(1.0 if timeout else 1.1)]
    live.work()
    clock[0] += 0.0005
    live.work()
    assert slept == [pytest.approx(0.0015)] and given == [[1.0], [1.0, 1.1]]
    live.reader.take = lambda timeout: []
    live.work()
    assert len(slept) == 1  # without frames there is nothing to wait for


# ---- written rows


def pend(live, times, **values):
    outputs = make_outputs(len(times), **values)
    live._pending.append((np.array(times, float), make_columns(len(times)), outputs))


def test_written_rows_have_one_header_and_empty_cells_for_missing_values(tmp_path, begin):
    live = begin(tmp_path / "out")
    pend(live, [0.1, 0.2])
    live._pending[0][1]["accel_y"][1] = np.nan
    pend(live, [0.3])
    live._write()
    pend(live, [0.4], cy_front=0.75)
    live._write()
    live._write()
    assert (tmp_path / "out" / "rows.csv").read_text().splitlines() == [
        "time,steer_angle,wheel_speed_front,wheel_speed_rear,accel_x,accel_y,yaw_rate",
        "0.1,0.01,60.0,61.0,0.2,1.0,0.05",
        "0.2,0.01,60.0,61.0,0.2,,0.05",
        "0.3,0.01,60.0,61.0,0.2,1.0,0.05",
        "0.4,0.01,60.0,61.0,0.2,1.0,0.05",
    ]
    est = pd.read_csv(tmp_path / "out" / "rows.est.csv")
    assert list(est) == list_est_columns()
    assert est["time"].tolist() == [0.1, 0.2, 0.3, 0.4]
    assert est["cy_front"].tolist() == [100e3, 100e3, 100e3, 75e3] and (est["cy_rear"] == 150e3).all()
    assert live._written == 4 and live.table()["time"].tolist() == [0.1, 0.2, 0.3, 0.4]


def test_a_long_drive_keeps_every_second_then_every_fourth_row(begin, monkeypatch):
    monkeypatch.setattr(part, "MAX_SUMMARY", 8)
    live = begin()
    assert len(live.table()) == 0 and "cy_front" in live.table()
    done = 0
    for size in (3, 5, 2, 4, 2, 3, 6):
        pend(live, np.arange(done, done + size))
        live._write()
        done += size
        step_ = live._stride
        assert live.table()["time"].tolist() == list(range(0, done, step_)), done
        assert step_ == (1 if done <= 8 else 2 if done <= 16 else 4)
    assert len(live.table()) == 7


def test_rows_for_the_checks_are_those_of_the_last_ten_minutes(begin, monkeypatch):
    monkeypatch.setattr(part, "MAX_CHECKED", 5)
    live = begin()
    for first in (0.0, 3.0, 6.0):
        pend(live, first + np.arange(2.0))
        live._write()
    assert [x["time"].tolist() for x in live._columns] == [[3.0, 4.0], [6.0, 7.0]]


def test_channels_are_checked_at_ten_seconds_and_then_in_intervals_of_twenty(begin, monkeypatch):
    live, checked, looked = begin(), [], []
    times = iter([10.0, 10.5, 30.5, 30.6, 40.0])
    live._columns.append({"time": np.zeros(1)})
    monkeypatch.setattr(live, "_write", lambda: setattr(live.drive, "time", next(times)))
    monkeypatch.setattr(live, "_look_back", lambda: looked.append(live.drive.time))
    monkeypatch.setattr(live, "_check_channels", lambda columns: checked.append(live.drive.time))
    waits = iter([False] * 5 + [True])
    live._ended = SimpleNamespace(wait=lambda s: next(waits) or s != 1.0)
    live._run_keeper()
    assert checked == [10.5, 30.6] and looked == [10.0, 10.5, 30.5, 30.6, 40.0]


def test_what_a_check_finds_is_a_warning_once_and_what_is_certain_contradicts(begin, monkeypatch):
    live, seen = begin(), []
    found = ["yaw_rate is positive to the right", "accel_y may be late by 0.1 s"]

    def check(log, car, config):
        seen.append((len(log), car, config))
        return found

    monkeypatch.setattr(part, "check_car", check)
    monkeypatch.setattr(part, "select_certain", lambda said: said[:1])
    times = np.arange(500) * 0.01
    blocks = [{"time": t, **make_columns(len(t), accel_x=np.nan)} for t in (times[:200], times[200:])]
    for _ in range(2):
        live._check_channels(blocks)
    assert seen == [(500, live.vehicle, live.config)] * 2
    assert [s for s in read_said(live) if s.startswith("warning")] == [f"warning: {s}" for s in found]
    assert live.drive.contradicted == found[:1]
    found.clear()
    live._check_channels(blocks)  # a contradiction that has gone is not reported
    assert live.drive.contradicted == []


def test_notes_of_a_check_that_concern_a_channel_are_said(begin, monkeypatch):
    live, seen = begin(), []
    found = ["yaw_rate measures nothing", "accel_x is computed from speed", "accel_y has no value in 3 rows"]

    def check(path, times, data, lines, notes, place):
        notes += [*found, "rows are 0.01 s apart"]
        return "log", sorted(data), len(times), lines.tolist(), place

    monkeypatch.setattr(part, "check_log", check)
    monkeypatch.setattr(part, "select_liveliest", lambda log, most: (log, most))
    monkeypatch.setattr(part, "check_car", lambda log, *_: seen.append(log) or [])
    holes = make_columns(2, accel_x=np.nan)
    holes["accel_y"][1] = np.nan
    live._check_channels([{"time": np.arange(2.0), **holes}])
    assert read_said(live) == found
    names = sorted(set(ROW) - {"accel_x"})  # a channel without any value is left out
    assert seen == [(("log", names, 2, [0, 1], "row"), part.MAX_CHECKED)]


def test_a_check_that_fails_is_a_sentence_and_the_drive_goes_on(begin, monkeypatch):
    live = begin()
    block = {"time": np.arange(3.0), **make_columns(3)}
    for error in (UserError("first line\nsecond"), KeyError("x" * 200)):

        def fail(*_, error=error, **__):
            raise error

        monkeypatch.setattr(part, "check_log", fail)
        live._check_channels([block])
    first, second = read_said(live)
    assert first == "first line"
    assert second == f"the channels could not be checked against each other (KeyError: '{'x' * 99})"


# ---- the answer


@pytest.mark.parametrize("driven", ["front", "rear"])
def test_the_display_has_each_stiffness_and_its_sd_as_shares_of_its_nominal(driven, begin):
    live = begin(car={**CAR, "driven_axle": driven})
    assert live.now() == []
    levels = {"cx_front": 0.5, "cy_front": 0.6, "cy_rear": 0.7}
    sds = {"cx_front": 0.01, "cy_front": 0.02, "cy_rear": 0.03}
    live.last = make_outputs(**levels, **{f"{s}_sd": x for s, x in sds.items()})[0]
    live.last["cy_rear_valid"] = CODE["sensor fault"]
    live.drive.rows, live._valid = 8, {"cx_front": 2, "cy_front": 4, "cy_rear": 8}
    (finding,) = live.now()
    assert [v.key for v in finding.verdicts] == list(tse.STIFFNESS)
    for v in finding.verdicts:
        assert v.value == pytest.approx(levels[v.key] * IN_KILO[v.key])
        assert v.band == pytest.approx(1.959964 * sds[v.key] * IN_KILO[v.key], rel=1e-4)
        assert v.nominal == pytest.approx(IN_KILO[v.key])
        assert v.valid == live._valid[v.key] / 8
        assert v.unit == ("kN" if v.key == "cx_front" else "kN/rad")
    assert [(v.level, v.reason) for v in finding.verdicts] == [
        ("good", ""),
        ("good", ""),
        ("none", "sensor fault"),
    ]
    live.last["status"] = STATE["TSE_E_TIME"]
    assert [v.level for v in live.now()[0].verdicts] == ["none"] * 3


def test_numbers_are_rows_per_second_and_delays_in_ms(begin):
    live = begin()
    live.drive = DriveState(rows=201, frames=77, first=10.0, time=12.0)
    assert live.numbers() == "77 frames, 201 rows"
    live.drive.delays = [0.001] * 50 + [0.004] * 49 + [0.5, 0.9]
    # of 101 delays in order, the middle one is number 51, that of 99 % number 100
    assert live.numbers() == (
        "77 frames, 201 rows, 100 rows per second; delay from a frame to its estimate: median 4 ms, for "
        "99 % of the rows at most 500 ms, max 900 ms"
    )


def test_the_result_of_a_drive_has_its_learnt_state_unless_channels_contradict(begin, monkeypatch):
    live = begin()
    est, found, changes, against = live.result()
    assert len(est) == 0 and est.learnt is None and (found, changes, against) == ([], [], [])
    live.filter = SimpleNamespace(
        save_learnt=lambda: b"state", uncertainty_sd=lambda: {"mass_sd": np.ones(3)}
    )
    live.drive.statuses.update({0: 7, -3: 2})
    pend(live, np.arange(300) * 0.01)
    live._write()
    est, found, _, against = live.result()
    assert est.learnt == b"state" and len(est) == 9 and not est.interrupted and against == []
    assert list(est.uncertainty_sd) == ["mass_sd"] and len(found) == 1
    live.drive.contradicted = ["yaw_rate is positive to the right"]
    est, found, _, against = live.result()
    assert est.learnt is None and against == live.drive.contradicted
    assert all(v.level == "none" for v in found[0].verdicts)
    against.append("x")
    assert live.drive.contradicted == ["yaw_rate is positive to the right"]
    live.drive.contradicted = []
    monkeypatch.setattr(part, "describe_implausible", lambda table: "channels contradict")
    est, _, _, against = live.result()
    assert est.learnt is None and against == ["channels contradict"]


def test_findings_of_a_drive_have_its_changes_and_its_uncertain_parameters(begin, monkeypatch):
    live, given = begin(), []
    sd = {"mass_sd": np.ones(3)}
    live.filter = SimpleNamespace(save_learnt=lambda: b"state", uncertainty_sd=lambda: sd)
    pend(live, np.arange(3) * 0.01)
    live._write()
    monkeypatch.setattr(part.regimes, "find_changes", lambda table: ["a change"])
    monkeypatch.setattr(part, "make_findings", lambda *x: given.append(x[1:]) or ["found"])
    est, found, changes, _ = live.result()
    assert given == [(live.config, ["a change"], [], sd)] and est.uncertainty_sd is sd
    assert found == ["found"] and changes == ["a change"]
    live.drive.contradicted = ["known"]
    monkeypatch.setattr(part, "describe_implausible", lambda table: "once more")
    assert live.result()[3] == ["known"]


def test_the_last_frames_are_used_at_the_end_and_the_channels_checked_once_more(begin, monkeypatch):
    live, done = begin(), []
    live.stream = make_stream(add=lambda frames: done.append(("add", len(frames))))
    came = [make_arrived(0.0), make_arrived(1.0)]
    live.reader.take = lambda timeout: came
    monkeypatch.setattr(live, "_step", lambda part_, now: done.append(("step", len(part_))))
    for name in ("_write", "_look_back"):
        monkeypatch.setattr(live, name, lambda name=name: done.append(name))
    monkeypatch.setattr(live, "_check_channels", lambda columns: done.append(len(columns)))
    live._columns.append({"time": np.zeros(3)})
    close = live.record.close
    monkeypatch.setattr(live.record, "close", lambda: done.append("closed") or close())
    for _ in range(2):
        live.close()
    assert done == [("add", 1), ("step", 1)] * 2 + ["_write", 1, "_look_back", "closed"]
    assert live.drive.frames == 2 and live.closed


# ---- the page


@pytest.fixture
def show(monkeypatch):
    """Return a function that serves the page of a drive."""
    made = []
    serve = pages.ThreadingHTTPServer.serve_forever
    monkeypatch.setattr(pages.ThreadingHTTPServer, "serve_forever", lambda server: serve(server, 0.01))

    def make(driven="front", **more):
        drive = SimpleNamespace(
            config=make_config_of({**CAR, "driven_axle": driven}),
            drive=DriveState(rows=12, frames=99, time=61.4, delay=0.0126),
            said=[(1.0, "a"), (2.0, "b"), (3.0, "c")],
            now=list,
        )
        made.append(pages.Page(drive, **more))
        return made[-1]

    yield make
    for page in made:
        page.close()


def test_the_page_shows_twenty_rows_per_second(show):
    page = show()
    page.add(np.arange(11) * 0.01, make_outputs(11))
    page.add(np.array([0.12, 0.149, 0.15, 0.9]), make_outputs(4))
    assert page._make_state(0, 0)["columns"]["time"] == [0.0, 0.05, 0.1, 0.15, 0.9]


@pytest.mark.parametrize(("driven", "along", "cx"), [("front", "Front", 80.0), ("rear", "Rear", 90.0)])
def test_the_page_has_kilonewtons_of_the_driven_axle_flags_and_probabilities(driven, along, cx, show):
    page = show(driven)
    probabilities = {p: (i + 1) / 32 for i, p in enumerate(REGIMES)}
    row = make_outputs(cx_front=0.5, cy_front=0.25, cy_rear=0.125, cy_rear_sd=0.5, **probabilities)
    row["cy_front_valid"] = CODE["held"]
    row["cx_front_sd"] = np.nan
    page.add(np.array([1.23456]), row)
    state = page._make_state(0, 0)
    columns = state["columns"]
    assert {n: x[0] for n, x in columns.items()} == {
        "time": 1.235,
        "cx_front": 0.5 * cx,
        "cx_front_sd": None,
        "cx_front_valid": 1.0,
        "cx_front_reason": 0.0,
        "cy_front": 25.0,
        "cy_front_sd": 0.0,
        "cy_front_valid": 0.0,
        "cy_front_reason": CODE["held"],
        "cy_rear": 18.75,
        "cy_rear_sd": 75.0,
        "cy_rear_valid": 1.0,
        "cy_rear_reason": 0.0,
        **{p: pytest.approx(x) for p, x in probabilities.items()},
    }
    assert state["along"] == along and page._rear == (driven == "rear")
    assert state["reasons"][CODE["held"]] == "held" and state["reasons"][0] == "valid"


def test_a_page_asks_for_rows_and_events_from_a_number_on(show, monkeypatch):
    monkeypatch.setattr(pages, "AT_A_TIME", 3)
    monkeypatch.setattr(pages, "MAX_KEPT", 10)
    page = show(car="not calibrated")
    for t in range(10):
        page.add(np.array([float(t)]), make_outputs())
    for first, (start, after) in {0: (0, 3), 3: (3, 6), 8: (8, 10), 10: (10, 10), 11: (0, 3)}.items():
        state = page._make_state(first, 0)
        assert (state["begin"], state["from"], state["next"]) == (0, start, after)
        assert state["columns"]["time"] == list(range(start, after))
    page.add(np.array([10.0]), make_outputs())  # the older half is dropped
    for first, (start, after) in {0: (5, 8), 4: (5, 8), 5: (5, 8), 9: (9, 11), 11: (11, 11)}.items():
        state = page._make_state(first, 0)
        assert (state["begin"], state["from"], state["next"]) == (5, start, after)
        assert state["columns"]["time"] == list(range(start, after))
    state = page._make_state(5, 1)
    assert state["events"] == [(2.0, "b"), (3.0, "c")] and state["nextEvent"] == 3
    assert state["car"] == "not calibrated"
    assert state["state"] == "61 s, 12 rows, 99 frames, 13 ms behind"


def test_the_server_answers_for_rows_and_refuses_other_paths_and_hosts(show):
    page = show()
    page.add(np.array([1.0, 2.0, 3.0]), make_outputs(3))

    def get(path, **headers):
        request = urllib.request.Request(page.url.rstrip("/") + path, headers=headers)
        with urllib.request.urlopen(request, timeout=10) as found:
            return found.headers, found.read()

    headers, body = get("/rows?from=1&events=2")
    found = json.loads(body)
    assert found["columns"]["time"] == [2.0, 3.0] and found["events"] == [[3.0, "c"]]
    assert headers["Content-Type"] == "application/json" and headers["Cache-Control"] == "no-store"
    assert json.loads(get("/rows?from=x&events=-1")[1])["from"] == 0
    assert json.loads(get("/rows")[1])["columns"]["time"] == [1.0, 2.0, 3.0]
    assert get("/", Host="localhost:1")[0]["Content-Type"].startswith("text/html")
    for path, given, code in (("/x", {}, 404), ("/rows", {"Host": "localhost.evil.example"}, 403)):
        with pytest.raises(urllib.error.HTTPError) as error:
            get(path, **given)
        assert error.value.code == code


# ---- Live


def make_live(duration=None, found=(), folder=None, closed=True, learnt=None, notes=()):
    """Return a Live of a drive that counts its results."""
    calls = []

    def result():
        calls.append(1)
        return SimpleNamespace(learnt=learnt, number=len(calls)), list(found), [], ["against"]

    drive = SimpleNamespace(
        closed=closed,
        result=result,
        now=lambda: ["now"],
        config=make_config_of(),
        vehicle=tse.read_vehicle(CAR),
        drive=DriveState(rows=5, frames=9),
        said=[(1.5, "a")],
        started_from="car.tse",
        numbers=lambda: "9 frames",
        calls=calls,
    )
    return tse.Live(drive, duration, notes, folder)


def test_a_drive_ends_after_its_duration_or_when_it_is_stopped(monkeypatch):
    clock = [50.0]
    monkeypatch.setattr(_live.time, "monotonic", lambda: clock[0])
    drive, forever = make_live(2.0), make_live()
    for now, ended in ((51.99, False), (52.0, True)):
        clock[0] = now
        assert drive.ended is ended and not forever.ended
    forever.stop()
    assert forever.ended


def test_each_row_is_an_estimate_with_its_time_in_newtons(monkeypatch):
    live = make_live()
    outputs = make_outputs(2, cy_rear=[0.5, 0.25])
    outputs["cx_front_valid"][1] = CODE["held"]
    rows = iter([(np.zeros(0), outputs[:0]), (np.array([1.5, 1.6]), outputs)])
    live._drive.work = lambda: next(rows)
    found = []
    for estimate in live:
        found.append(estimate)
        if len(found) == 2:
            live.stop()
    assert [(e.time, e.cy_rear, e.cx_front) for e in found] == [(1.5, 75e3, 80e3), (1.6, 37.5e3, 80e3)]
    assert [(e.cx_front_valid, e.cx_front_reason) for e in found] == [(True, "valid"), (False, "held")]
    rows = iter([(np.array([1.0, 2.0, 3.0]), make_outputs(3))])
    shown = []
    live._page = SimpleNamespace(add=lambda t, o: shown.append(len(t)))
    assert live.poll() == 3 and shown == [3]
    live._drive.work = lambda: (np.zeros(0), make_outputs(0))
    assert live.poll() == 0 and shown == [3]


def test_during_a_drive_the_answer_is_of_now_and_afterwards_of_the_whole(monkeypatch):
    monkeypatch.setattr(_live, "make_answer", lambda found, config: found)
    live = make_live(found=["whole"], closed=False)
    assert live.answer == ("now",)
    assert [live._get_result()[0].number for _ in range(2)] == [1, 2]
    live._drive.closed = True
    assert live.answer == ("whole",)
    assert [live._get_result()[0].number for _ in range(2)] == [3, 3]
    assert live.rows == 5 and live.numbers == "9 frames" and live.said == ((1.5, "a"),)
    assert live.settings["cornering_stiffness_rear"] == 150e3


def test_a_drive_without_rows_is_not_usable_and_has_a_document(tmp_path):
    live = make_live(folder=tmp_path)
    assert live.exit_code == 4
    assert live.to_dict() == {
        "log": str(tmp_path / "rows.csv"),
        "vehicle": None,
        "record": str(tmp_path),
        "frames": 9,
        "warnings": ["against"],
        "started_from": "car.tse",
        "events": [{"time": 1.5, "text": "a"}],
        "rows": 0,
        "usable": "no",
        "exit_code": 4,
    }
    assert make_live()._get_rows_path() == Path("rows.csv")
    with pytest.raises(UserError, match=r"nothing was learnt, so x\.tse is not written"):
        live.save_learnt("x.tse")
    taught = make_live(learnt=b"state")
    assert taught.learnt == b"state" and taught.save_learnt(tmp_path / "x.tse").read_bytes() == b"state"


def test_closing_a_drive_closes_its_page_and_a_second_page_is_the_first(monkeypatch):
    live, closed = make_live(), []
    live._drive.close = lambda: closed.append("drive")
    page = SimpleNamespace(url="http://127.0.0.1:5/", close=lambda: closed.append("page"))
    made = []
    monkeypatch.setattr(_live, "Page", lambda *given: made.append(given) or page)
    live._car = "not calibrated"
    assert live.serve(5) == live.serve(6) == page.url
    assert made == [(live._drive, 5, "not calibrated")]
    with live as same:
        assert same is live
    assert closed == ["drive", "page"]
    live.close()
    assert closed == ["drive", "page", "drive"]


@pytest.fixture
def starts(monkeypatch):
    """Return the arguments of each LiveDrive that tse.live() makes."""
    made = []

    def make(*given):
        made.append(given)
        return SimpleNamespace(config=given[3])

    monkeypatch.setattr(_live, "LiveDrive", make)
    return made


def test_a_drive_begins_with_the_settings_state_and_signals_that_are_given(starts, tmp_path, monkeypatch):
    monkeypatch.setattr(_live, "read_signals", lambda path: f"signals of {path}")
    (tmp_path / "filter.toml").write_text("mass_sd = 0.01\ninitial_cy_front = 0.9\n")
    bus, say = object(), print
    drive = tse.live(
        CAR,
        database=[tmp_path / "a.dbc", str(tmp_path / "b.dbc")],
        bus=bus,
        signals="my.toml",
        out=tmp_path / "out",
        settings={"mass_sd": 0.02},
        config=tmp_path / "filter.toml",
        learnt=b"state",
        age=3600.0,
        rate=50.0,
        say=say,
    )
    ((opened, databases, car, config, mapped, folder, before, rate, tell),) = starts
    assert opened() is bus and databases == [tmp_path / "a.dbc", tmp_path / "b.dbc"]
    assert car.values["mass"] == 1650 and (config.mass_sd, config.initial_cy_front) == (0.02, 0.9)
    assert mapped == "signals of my.toml" and folder == drive.folder == tmp_path / "out"
    assert before == Learnt(Path("learnt"), b"state", 3600.0, True) and (rate, tell) == (50.0, say)
    assert drive.notes[0].startswith("started from: learnt, 0.0417 days old")


def test_without_signals_those_beside_the_database_are_used_if_there_are_any(starts, tmp_path, monkeypatch):
    monkeypatch.setattr(_live, "read_signals", lambda path: f"signals of {path}")
    opened = []
    monkeypatch.setattr(_live, "make_bus_opener", lambda *given, **more: opened.append((given, more)))
    tse.live(CAR, database=tmp_path / "a.dbc", interface="pcan", channel="can1", bitrate=5)
    (tmp_path / "signals.toml").write_text("")
    drive = tse.live(
        {**CAR, "uncertainty": {"mass_sd": 0.01}}, database=str(tmp_path / "a.dbc"), interface="x"
    )
    assert [given[4] for given in starts] == [None, f"signals of {tmp_path / 'signals.toml'}"]
    assert opened == [(("pcan", "can1"), {"bitrate": 5}), (("x", None), {})]
    assert [given[5:8] for given in starts] == [(None, None, None)] * 2
    starts[0][8]("a sentence is discarded")
    assert _live.NOT_CALIBRATED not in drive.notes and drive._car == "" and drive.folder is None


def test_a_car_that_is_not_calibrated_is_a_note_and_on_the_page(starts):
    plain = {k: v for k, v in CAR.items() if "stiffness" not in k}
    assert is_uncalibrated(tse.read_vehicle(plain))
    drive = tse.live(plain, database="a.dbc", bus=object(), learnt=b"state")
    assert drive.notes[0].startswith("started from: ") and drive.notes[1] == drive._car != ""
    assert drive.notes[1].startswith("not calibrated")


@pytest.mark.parametrize(
    ("given", "error", "text"),
    [
        ({"database": "a.dbc"}, TypeError, "either an interface or an open bus"),
        ({"database": "a.dbc", "bus": 1, "interface": "x"}, TypeError, "either an interface or an open bus"),
        ({"database": [], "bus": 1}, TypeError, "needs a database"),
        ({"database": "a.dbc", "bus": 1, "rate": 1.9}, UserError, r"rate: 1.9 .* range 2 .. 1000 Hz"),
        ({"database": "a.dbc", "bus": 1, "rate": 1000.5}, UserError, "rate: 1000.5 is outside"),
        ({"database": "a.dbc", "bus": 1, "settings": [1]}, TypeError, "settings: list is not a mapping"),
        ({"database": "a.dbc", "bus": 1, "settings": {"particles": 90}}, UserError, "has no effect"),
    ],
)
def test_what_cannot_begin_a_drive_is_refused(given, error, text, starts):
    with pytest.raises(error, match=text):
        tse.live(CAR, **given)
    assert starts == []


def test_the_ends_of_the_range_of_a_rate_are_allowed(starts):
    for rate in (2.0, 1000.0):
        tse.live(CAR, database="a.dbc", bus=object(), rate=rate)
    assert [given[7] for given in starts] == [2.0, 1000.0]
