"""Frames of a bus and their databases, by a few lines and bytes decoded by hand."""

import struct
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tse.library.errors import NoFile, UserError
from tse.readers import bus_text, databases, read_can
from tse.readers.bus_text import AscText, CanFrame, Lines, TrcText, detect_bus_text, read_frames
from tse.readers.read_can import Bus, drop_codes, find_databases, make_key, read_states
from tse.readers.read_mdf import _read_frame_columns
from tse.readers.readers import read_recording
from tse.readers.recording import ReadOptions

DAY = 86400.0


def read_all(folder: Path, kind: str, text: str, known: tuple[int, ...] = ()) -> tuple[list[CanFrame], Lines]:
    """Return the frames of a text, and what was found of its lines."""
    path = folder / "bus.log"
    path.write_bytes(text.encode())
    lines = Lines(path)
    return list(read_frames(path, kind, lines, lambda i: i in known)), lines


# ---- What kind of text it is


@pytest.mark.parametrize(
    ("head", "suffix", "kind"),
    [
        ("(1489113253.313310) can0 083#0F\n", ".log", "candump"),
        ("(0.1) can0 00000083#0F\n", ".txt", "candump"),
        ("  can0  083   [2]  0F E0\n", ".txt", "candump"),
        (" (000.1)  vcan0  RX - -  083   [2]  0F E0\n", ".txt", "candump"),
        ("***BUSMASTER Ver 3.2.2***\n", ".log", "busmaster"),
        (";$FILEVERSION=1.1\n", ".txt", "trc"),
        ("anything\n", ".trc", "trc"),
        ("date x\nbase hex  timestamps absolute\n", ".txt", "asc"),
        ("anything\n", ".asc", "asc"),
        ("Time,ID,Data\n", ".csv", "table"),
        ("\n" * 3 + "# by a logger\nTimestamp;CAN ID;DLC;D0\n", ".csv", "table"),
        ("time,speed,yaw_rate\n", ".csv", ""),
        ("time,id\n", ".csv", ""),  # without data
        ("(1489113253.313310) can0 083 speed\n", ".log", ""),
    ],
)
def test_the_tool_that_wrote_a_bus_is_found_by_its_first_lines(head, suffix, kind):
    assert detect_bus_text(head.encode(), suffix) == kind
    assert detect_bus_text(b"\xff\xfe" + head.encode("utf-16-le"), suffix) == kind


def test_binary_content_is_no_text_of_a_bus():
    assert detect_bus_text(b"(0.1) can0 083#0F\n\0\0", ".asc") == ""


def test_lines_have_numbers_from_one_in_each_encoding(tmp_path):
    path = tmp_path / "bus.log"
    for encoding, start in (("utf-8", b""), ("cp1252", b""), ("utf-8-sig", b""), ("utf-16", b"")):
        path.write_bytes(start + "Prüfstand\nzwei\n".encode(encoding))
        lines = Lines(path)
        assert list(lines) == [(1, "Prüfstand\n"), (2, "zwei\n")] and lines.number == 2
    # a character of UTF-8 that the first part of the file cuts is no error
    path.write_bytes(b"a" * (bus_text.DETECTION_BYTES - 1) + "ü\n".encode())
    assert bus_text._detect_encoding(path) == "utf-8-sig"
    path.write_bytes(b"a" * (bus_text.DETECTION_BYTES - 9) + b"\xfc" + b"a" * 20)
    assert bus_text._detect_encoding(path) == "cp1252"


@pytest.mark.parametrize(
    ("odd", "text"),
    [([7], "line 7"), ([7, 8, 9], "line 7, 8, 9"), ([7, 8, 9, 11], "line 7, 8, 9 and 1 more")],
)
def test_the_first_three_odd_lines_are_named(odd, text):
    lines = Lines(Path("x"))
    lines.odd = odd
    assert lines.note() == f"{len(odd)} lines cannot be parsed as frames and are left out: {text}"


# ---- candump


def test_frames_of_candump_have_time_bus_kind_and_bytes(tmp_path):
    text = (
        "(10.5) can0 7FF#01.02\n"
        "(10.6) can1 000007FF#FF\n"
        "\n"
        "(10.7) can0 123#R\n"  # a remote frame
        "(10.8) can0 123#R8\n"
        "(10.9) can0 20000080#0000\n"  # an error frame
        "(11.0) can0 123##1AABB\n"
        "(11.1) can0 123#\n"
        "(11.2) can0 123#123\n"  # half a byte
        "garbage\n"
        "(11.3) can0 123#0A T\n"
    )
    frames, lines = read_all(tmp_path, "candump", text)
    assert frames == [
        CanFrame(10.5, 0x7FF, False, "can0", b"\x01\x02"),
        CanFrame(10.6, 0x7FF, True, "can1", b"\xff"),
        CanFrame(11.0, 0x123, False, "can0", b"\xaa\xbb"),
        CanFrame(11.1, 0x123, False, "can0", b""),
        CanFrame(11.3, 0x123, False, "can0", b"\x0a"),
    ]
    assert lines.odd == [9, 10] and lines.errors == 1


def test_the_console_of_candump_states_the_number_of_bytes(tmp_path):
    text = (
        " (1.0)  can0  123   [2]  0A 0B   '..'\n"
        " (2.0)  can0  123   [3]  0A 0B\n"  # cut
        " (3.0)  can0  18FEF100   [1]  01\n"
        " (4.0)  can0  123   [0]  remote request\n"
        " (5.0)  can0  123   [0]\n"
    )
    frames, lines = read_all(tmp_path, "candump", text)
    assert [(f.time, f.identifier, f.extended, f.data) for f in frames] == [
        (1.0, 0x123, False, b"\x0a\x0b"),
        (3.0, 0x18FEF100, True, b"\x01"),
        (5.0, 0x123, False, b""),
    ]
    assert lines.odd == [2]


@pytest.mark.parametrize(
    ("stamp", "time"),
    [
        ("12.25", 12.25),
        ("2024-03-06 00:00:01.5", 1709683201.5),
        (" 1970-01-02 ", 86400.0),
        ("abc", np.nan),
        ("", np.nan),
    ],
)
def test_a_stamp_of_candump_is_a_number_or_a_date(stamp, time):
    assert bus_text._parse_stamp(stamp) == pytest.approx(time, nan_ok=True)


def test_differences_from_frame_to_frame_are_summed_up_and_absolute_times_are_not(tmp_path):
    steps = [0.0, *[0.01, 0.03, 0.02] * 6]
    rows = [f"({x:.6f}) can0 123#0{i % 8}\n" for i, x in enumerate(steps)]
    rows.insert(2, "(0.500000) can0 20000080#00\n")  # the time of an error frame passes, too
    frames, _ = read_all(tmp_path, "candump", "".join(rows))
    wanted = np.cumsum(steps) + np.where(np.arange(19) > 1, 0.5, 0.0)
    np.testing.assert_allclose([f.time for f in frames], wanted)
    # of ten frames or less, and of stamps since 1970, the order is no evidence
    few, _ = read_all(tmp_path, "candump", "".join(rows[:2] + rows[3:11]))
    assert [f.time for f in few] == steps[:10]
    late = [f"({1.7e9 + x:.6f}) can0 123#00\n" for x in steps]
    frames, _ = read_all(tmp_path, "candump", "".join(late))
    np.testing.assert_allclose([f.time - 1.7e9 for f in frames], steps, atol=1e-6)


def test_a_difference_that_is_no_number_is_no_time_and_spoils_no_later_one(tmp_path):
    steps = [0.0, *[0.01, 0.03, 0.02] * 6]
    rows = [f"({x:.6f}) can0 123#00\n" for x in steps]
    rows.insert(5, "(bad) can0 123#00\n")
    frames, _ = read_all(tmp_path, "candump", "".join(rows))
    np.testing.assert_allclose([f.time for f in frames], np.insert(np.cumsum(steps), 5, sum(steps[:5])))


# ---- BUSMASTER


@pytest.mark.parametrize(
    ("stamp", "time"),
    [
        ("01:02:03:5", 3723.5),
        ("01:02:03:005", 3723.005),
        ("01:02:03:0005", 3723.0005),
        ("00:00:10:000250", 10.00025),
    ],
)
def test_the_fraction_of_a_second_of_busmaster_has_any_number_of_digits(stamp, time, tmp_path):
    frames, _ = read_all(tmp_path, "busmaster", f"***HEX***\n{stamp} Rx 1 0x10 s 1 00\n")
    assert frames[0].time == pytest.approx(time, abs=1e-9)


def test_frames_of_busmaster_are_decimal_or_hexadecimal_and_long_where_their_type_begins_with_x(tmp_path):
    rows = "00:00:01:0 Rx 2 0x10 s 2 10 20\n00:00:02:0 Tx 1 0x10 x 1 07\n00:00:03:0 Rx 1 0x10 sr 0\n"
    rows += "00:00:04:0 Rx 1 0x10 xr 0\nodd\n00:00:05:0 Rx 1 0x10 s 1 07 08\n"
    frames, lines = read_all(tmp_path, "busmaster", "***HEX***\n" + rows)
    assert frames == [
        CanFrame(1.0, 16, False, "2", b"\x10\x20"),
        CanFrame(2.0, 16, True, "1", b"\x07"),
        CanFrame(5.0, 16, False, "1", b"\x07"),
    ]
    assert lines.odd == [6]
    frames, lines = read_all(tmp_path, "busmaster", "***DEC***\n" + rows.replace("0x10", "10"))
    assert [(f.identifier, f.data) for f in frames] == [(10, b"\x0a\x14"), (10, b"\x07"), (10, b"\x07")]
    frames, lines = read_all(tmp_path, "busmaster", "***DEC***\n00:00:01:0 Rx 1 10 s 1 256\n")
    assert frames == [] and lines.odd == [2]


def test_times_of_busmaster_go_on_after_each_midnight_and_relative_ones_are_summed_up(tmp_path):
    stamps = ["23:59:59:9", "00:00:00:1", "12:00:00:0", "23:00:00:0", "00:00:00:2"]
    text = "".join(f"{s} Rx 1 0x1 s 0\n" for s in stamps)
    frames, _ = read_all(tmp_path, "busmaster", "***ABSOLUTE MODE***\n" + text)
    wanted = [DAY - 0.1, DAY + 0.1, 1.5 * DAY, 2 * DAY - 3600, 2 * DAY + 0.2]
    np.testing.assert_allclose([f.time for f in frames], wanted)
    text = "".join(f"00:00:00:{s} Rx 1 0x1 {k} 0\n" for s, k in (("5", "s"), ("25", "sr"), ("1", "s")))
    frames, _ = read_all(tmp_path, "busmaster", "***RELATIVE MODE***\n" + text)
    np.testing.assert_allclose([f.time for f in frames], [0.5, 0.85])  # a remote frame takes time


def test_other_lines_of_a_header_leave_the_base_and_the_mode_of_busmaster(tmp_path):
    head = "***DEC***\n***RELATIVE MODE***\n***PROTOCOL CAN***\n"
    rows = "00:00:00:5 Rx 1 10 s 1 11\n" * 2
    frames, _ = read_all(tmp_path, "busmaster", head + rows)
    assert [(f.time, f.identifier, f.data) for f in frames] == [(0.5, 10, b"\x0b"), (1.0, 10, b"\x0b")]


def test_a_remote_frame_of_busmaster_passes_midnight_for_the_frames_after_it(tmp_path):
    stamps = (("23:59:59:0", "s"), ("00:00:01:0", "sr"), ("06:00:00:0", "s"))
    frames, _ = read_all(tmp_path, "busmaster", "".join(f"{t} Rx 1 0x1 {k} 0\n" for t, k in stamps))
    assert [f.time for f in frames] == [DAY - 1.0, DAY + 6 * 3600.0]


# ---- Tables


@pytest.mark.parametrize(
    ("line", "columns"),
    [
        ("Time Stamp (ms),ID (hex),Data", {"time": 0, "identifier": 1, "data": 2}),
        (
            ";Message Number,Time Offset (ms),Type,ID (hex),Data (hex)",
            {"time": 1, "identifier": 3, "data": 4},
        ),
        ('"timestamp"\t"arbitration_id"\t"d1"\t"d2"', {"time": 0, "identifier": 1, "data": 2}),
        ("Time;CAN ID;DLC", {}),
        ("time,id", {}),
    ],
)
def test_a_table_of_frames_is_known_by_its_titles(line, columns):
    assert bus_text._find_columns(line) == columns


def test_a_row_of_bytes_has_as_many_as_its_length_states(tmp_path):
    text = (
        "time,id,ide,bus,rtr,len,d1,d2,d3\n"
        "0.5,10h,0,2,0,2,0A,0B,FF\n"
        "0.6,11x,0,2,0,1,0C,,\n"
        "0.7,12,true,1,0,4,01,02,03,04\n"
        "0.8,13,0,1,1,1,05,,\n"  # a remote frame
        "# a comment\n"
        "0.9,zz,0,1,0,1,05,,\n"
        "1.0,14,X,1,0,,05,06,\n"
    )
    frames, lines = read_all(tmp_path, "table", text)
    assert frames == [
        CanFrame(0.5, 0x10, False, "2", b"\x0a\x0b"),
        CanFrame(0.6, 0x11, True, "2", b"\x0c"),
        CanFrame(0.7, 0x12, True, "1", b"\x01\x02\x03\x04"),
        CanFrame(1.0, 0x14, True, "1", b"\x05\x06"),
    ]
    assert lines.odd == [7]


def test_short_rows_and_single_times_of_day_leave_the_layout_of_a_table(tmp_path):
    text = "id,data,time (ms)\n10,0A\n10,0A,100\n10,0B,200\n10,0C,0:00:01\n10,0D,300\n"
    frames, lines = read_all(tmp_path, "table", text)
    assert [f.time for f in frames] == pytest.approx([0.1, 0.2, 0.3]) and lines.odd == [2, 5]


def test_a_column_of_data_is_hexadecimal_or_in_base_64(tmp_path):
    text = 'time,id,data\n1,1A,"0x0a 0x0B"\n2,1A,0x0C0D\n3,1A,0E:0F\n4,1A,01-02\n'
    frames, _ = read_all(tmp_path, "table", text)
    assert [f.data.hex() for f in frames] == ["0a0b", "0c0d", "0e0f", "0102"]
    assert {f.bus for f in frames} == {"0"}
    frames, lines = read_all(tmp_path, "table", "time,id,data\n1,1A,AQI=\n2,1A,/w==\n3,1A,x\n")
    assert [f.data for f in frames] == [b"\x01\x02", b"\xff"] and lines.odd == [4]


@pytest.mark.parametrize(
    ("title", "stamps", "times"),
    [
        ("time", ["0.5", "1.25"], [0.5, 1.25]),
        ("time (ms)", ["500", "1250"], [0.5, 1.25]),
        ("time offset [us]", ["500", "1250"], [5e-4, 1.25e-3]),
        ("timestamp_ns", ["500", "1250"], [5e-7, 1.25e-6]),
        ("time (s)", ["5", "7"], [5.0, 7.0]),
        ("timems", ["500", "1250"], [500.0, 1250.0]),  # ms is no word of its own: s by a fraction
        ("zeit", ["0,5", "1,25"], [0.5, 1.25]),
        ("time", ["10", "20"], [0.010, 0.020]),  # integers: ms by their step
        ("time", ["1000", "2000"], [1e-3, 2e-3]),  # us
        ("time", ["12:00:01.5", "12:00:02,5"], [43201.5, 43202.5]),
        ("time", ["01:30", "02:00.5"], [90.0, 120.5]),
        ("time", ["23:59:59", "00:00:01"], [DAY - 1, DAY + 1]),  # over midnight
        ("time", ["12:00:02", "12:00:01"], [43202.0, 43201.0]),  # frames out of order
        ("time", ["1970-01-01 00:00:01.5", "1970-01-01 00:00:02"], [1.5, 2.0]),
    ],
)
def test_the_times_of_a_table_are_in_the_unit_of_their_title_or_their_form(title, stamps, times):
    if title == "timems":
        stamps = [f"{s}.0" for s in stamps]
        title = "item s"
    parse = bus_text._make_time_parser(title, stamps)
    np.testing.assert_allclose([parse(s) for s in stamps], times, rtol=1e-12)


@pytest.mark.parametrize(
    ("first", "step", "tick"),
    [
        (0, 10, 1e-3),
        (0, 20, 1e-3),
        (0, 21, 1e-6),
        (0, 10_000, 1e-6),
        (0, 100_000, 1e-6),
        (0, 1_000_000, 1e-9),
        (1_700_000_000_000, 10, 1e-3),
        (1_700_000_000_000_000, 500, 1e-6),
        (1_700_000_000_000_000, 1_000_000, 1e-6),  # since 1970, whatever the step
        (1_700_000_000_000_000_000, 5_000_000, 1e-9),
    ],
)
def test_the_unit_of_whole_times_is_that_of_the_usual_step_on_a_bus(first, step, tick):
    stamps = first + step * np.array([0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 500], float)
    assert bus_text._guess_tick(stamps) == tick
    assert bus_text._guess_tick(np.array([float(first)])) == (tick if first > 1e14 else 1e-6)


@pytest.mark.parametrize(
    ("ids", "known", "decimal"),
    [
        ({"256", "512"}, (256, 512), True),
        ({"256", "512"}, (0x256, 0x512), False),
        ({"256", "512"}, (256, 0x256), False),  # as many of either
        ({"256", "1A"}, (256,), False),
        ({"256", "0512"}, (256, 512), False),
        ({"0", "256"}, (0, 256), True),
        (set(), (), False),
    ],
)
def test_identifiers_are_decimal_where_the_databases_have_more_of_them(ids, known, decimal):
    assert bus_text._is_decimal(ids, lambda i: i in known) == decimal


def test_decimal_identifiers_of_a_table_are_read_as_such(tmp_path):
    text = "time,id,data\n0.5,256,00\n0.6,512,01\n"
    assert [f.identifier for f in read_all(tmp_path, "table", text, (256, 512))[0]] == [256, 512]
    assert [f.identifier for f in read_all(tmp_path, "table", text)[0]] == [0x256, 0x512]


# ---- ASC and TRC


def repair_asc(folder: Path, text: str) -> tuple[list[str], list[str]]:
    path = folder / "a.asc"
    path.write_text(text)
    notes: list[str] = []
    return [x.strip() for x in AscText(Lines(path), notes)], notes


def test_relative_times_of_an_asc_are_summed_up_from_the_start_of_the_measurement(tmp_path):
    text = "base dec  timestamps relative\n 0.5 Start of measurement\n"
    text += " 0.25 1 10 Rx\n 0,25 1 11 Rx\n0.5 1 12 Rx\n"
    found, notes = repair_asc(tmp_path, text)
    assert found[0] == "base dec  timestamps absolute" and len(notes) == 1 and "summed up" in notes[0]
    assert found[2:] == ["0.750000000 1 10 Rx", "1.000000000 1 11 Rx", "1.500000000 1 12 Rx"]


def test_absolute_times_of_an_asc_stay_and_a_negative_start_becomes_zero(tmp_path):
    text = "base hex  timestamps absolute\n {} 1 10 Rx\n {} 1 11 Rx\n"
    found, notes = repair_asc(tmp_path, text.format("5.0", "5.5"))
    assert found[0] == "base hex  timestamps absolute" and notes == []
    assert found[2:] == ["5.000000000 1 10 Rx", "5.500000000 1 11 Rx"]
    found, notes = repair_asc(tmp_path, text.format("-20.0", "-19.5"))
    assert found[2:] == ["0.000000000 1 10 Rx", "0.500000000 1 11 Rx"]
    assert notes == ["times begin at -20 s: they are shifted to begin at 0"]
    found, notes = repair_asc(tmp_path, text.format("5.0", "-1.0"))
    assert found[3] == "0.000000000 1 11 Rx" and notes == []


@pytest.mark.parametrize(("version", "between"), [("1.2", " - "), ("1.1", " "), ("1.3", " ")])
def test_a_trc_of_version_1_2_gets_the_column_that_version_1_3_has_more(version, between, tmp_path):
    path = tmp_path / "a.trc"
    path.write_text(
        f";$FILEVERSION={version}\n; a comment of more than five words here\n1) 2.0 1 Rx 0123 2 AA BB\n"
    )
    found = list(TrcText(Lines(path)))
    assert found[0].strip() == f";$FILEVERSION={version.replace('1.2', '1.3')}"
    assert found[1].startswith("; a comment of more than five")
    assert found[2].strip() == f"1) 2.0 1 Rx 0123{between}2 AA BB"


# ---- Signals in frames


def make_signal(name: str, start: int, length: int, order: str = "little_endian", **more) -> SimpleNamespace:
    """Return a signal as cantools has it."""
    own = {"scale": 1, "offset": 0, "is_signed": False, "is_float": False, "choices": None, "unit": None,
           "comment": None, "multiplexer_ids": None, "multiplexer_signal": None}  # fmt: skip
    return SimpleNamespace(name=name, start=start, length=length, byte_order=order, **(own | more))


def decode(signal: SimpleNamespace, data: list[bytes], length: int = 8, *others) -> dict[str, list[float]]:
    """Return the frames that have the signal, and its values in them."""
    message = SimpleNamespace(length=length, signals=[signal, *others])
    found = list(read_can.decode_signals(message, [signal], data))
    return {"at": found[0][1].tolist(), "value": found[0][2].tolist()} if found else {}


@pytest.mark.parametrize(
    ("signal", "data", "value"),
    [
        (make_signal("x", 0, 16), b"\x34\x12", 0x1234),
        (make_signal("x", 4, 8), b"\x34\x12", 0x23),
        (make_signal("x", 7, 16, "big_endian"), b"\x12\x34", 0x1234),
        (make_signal("x", 3, 12, "big_endian"), b"\x12\x34", 0x234),
        (make_signal("x", 0, 8, is_signed=True), b"\xff", -1),
        (make_signal("x", 0, 8, is_signed=True), b"\x80", -128),
        (make_signal("x", 0, 8, is_signed=True), b"\x7f", 127),
        (make_signal("x", 0, 12, is_signed=True), b"\xff\x07", 2047),
        (make_signal("x", 0, 64, is_signed=True), struct.pack("<q", -5), -5),
        (make_signal("x", 0, 64), struct.pack("<Q", 1 << 63), 2.0**63),
        (make_signal("x", 0, 8, scale=0.5, offset=-40), b"\x64", 10.0),
        (make_signal("x", 0, 8, is_signed=True, scale=-0.1, offset=1), b"\xf6", 2.0),
        (make_signal("x", 0, 32, is_float=True), struct.pack("<f", -1.5), -1.5),
        (make_signal("x", 7, 32, "big_endian", is_float=True), struct.pack(">f", 2.25), 2.25),
        (make_signal("x", 0, 64, is_float=True, scale=2), struct.pack("<d", 0.125), 0.25),
        (make_signal("x", 0, 16, is_float=True), struct.pack("<e", 3.5), 3.5),
    ],
)
def test_a_signal_is_decoded_by_order_sign_scale_and_kind(signal, data, value):
    assert decode(signal, [data.ljust(8, b"\xaa")])["value"] == [pytest.approx(value)]


def test_a_frame_that_is_too_short_for_a_signal_lacks_it_and_a_longer_one_has_it():
    frames = [b"\x01\x02\x03", b"\x01\x02", b"\x01", bytes(12)]
    assert decode(make_signal("x", 8, 8), frames) == {"at": [0, 1, 3], "value": [2.0, 2.0, 0.0]}
    assert decode(make_signal("x", 12, 8), frames) == {"at": [0, 3], "value": [48.0, 0.0]}
    assert decode(make_signal("x", 15, 16, "big_endian"), frames)["at"] == [0, 3]
    assert decode(make_signal("x", 0, 8), [b""]) == {}
    assert decode(make_signal("x", 60, 8), frames) == {}  # beyond the end of the message
    # as long as its message states, a frame is complete
    assert decode(make_signal("x", 0, 16), [b"\x01\x02", b"\x01"], 2) == {"at": [0], "value": [513.0]}


def test_a_multiplexed_signal_is_in_the_frames_of_its_numbers():
    selector = make_signal("mux", 0, 4, scale=10)  # of the selector, the raw value counts
    own = make_signal("x", 8, 8, multiplexer_ids=[1, 3], multiplexer_signal="mux")
    frames = [bytes([k, 10 + k]) for k in (0, 1, 2, 3, 0x11)]
    assert decode(own, frames, 2, selector) == {"at": [1, 3, 4], "value": [11.0, 13.0, 27.0]}


@pytest.mark.parametrize(
    ("identifier", "extended", "key"),
    [
        (0x100, False, 0x100),
        (0x100, True, 0x100 | 1 << 29),
        (0x7FF, False, 0x7FF),
        (0x800, False, 0x800 | 1 << 29),  # too long for a standard identifier
        (1 << 31 | 0x123, False, 0x123),  # the mark of a DBC is no part of it
    ],
)
def test_the_key_of_a_message_keeps_both_kinds_of_identifiers_apart(identifier, extended, key):
    assert make_key(identifier, extended) == key
    both = make_key(np.array([identifier, 5]), np.array([extended, False]))
    assert both.tolist() == [key, 5]


def test_names_of_values_are_those_of_physical_values():
    s = make_signal("x", 0, 8, scale=0.5, offset=-10, choices={0: "off", 255: "SNA"})
    assert read_states(s) == {-10.0: "off", 117.5: "SNA"}
    assert read_states(make_signal("x", 0, 8)) == {}


@pytest.mark.parametrize(
    ("length", "said", "lost"),
    [
        (8, "SNA", True),
        (8, "not_available", True),
        (8, "Fehler", True),
        (8, "invalid value", True),
        (8, "init", True),
        (8, "on", False),
        (8, "snail", False),
        (7, "SNA", False),  # a state keeps its codes
    ],
)
def test_values_that_a_database_calls_not_available_are_missing(length, said, lost):
    s = make_signal("x", 0, length, scale=0.5, choices={255: said, 1: "low"})
    value, notes = np.array([0.5, 127.4, 127.5, 127.7, 100.0]), []
    found = drop_codes("m.x", s, value, read_states(s), notes)
    # a value counts as the code up to a quarter of a step beside it
    assert np.isnan(found).tolist() == [False, lost, lost, False, False]
    wanted = [f"m.x: 2 values that the database calls {said} are treated as missing"]
    assert notes == (wanted if lost else [])


DBC = """VERSION ""
BO_ 100 M: 8 X
 SG_ a : 0|8@1+ (1,0) [0|0] "km/h" X
 SG_ b : 56|8@1+ (1,0) [0|0] "deg" X
BO_ 2147483748 E: 8 X
 SG_ c : 0|8@1- (0.5,1) [0|0] "" X
CM_ SG_ 100 a "speed of the car";
"""


def make_bus(folder: Path, wanted=None) -> Bus:
    pytest.importorskip("cantools", reason="cantools is not installed: scripts/setup.sh logs")
    (folder / "car.dbc").write_text(DBC)
    return Bus(folder / "x.log", [folder / "car.dbc"], ReadOptions(wanted=wanted))


def add(bus: Bus, *frames: tuple[int, bool, str, bytes]) -> None:
    ids, extended, buses, data = zip(*frames, strict=True)
    bus.add(np.array(ids), np.array(extended), buses, data)


def test_signals_of_frames_that_were_added_in_parts_have_the_times_of_their_frames(tmp_path):
    bus = make_bus(tmp_path)
    whole = bytes([7, 0, 0, 0, 0, 0, 0, 9])
    add(bus, (100, False, "1", b"\x01"), (100, True, "1", b"\xfe"), (100, False, "1", whole))
    add(bus, (200, False, "1", b"\x00"), (100, False, "1", whole), (100, True, "1", b"\x02"))
    notes: list[str] = []
    keep = np.array([True, True, True, True, True, False])
    found = bus.channels(np.array([0.0, 0.1, 0.2, 0.3, 0.4]), keep, notes)
    parts = {n: (c.time.tolist(), c.value.tolist(), c.unit, c.text) for n, c in found.items()}
    assert parts == {
        "M.a": ([0.0, 0.2, 0.4], [1, 7, 7], "km/h", "speed of the car"),
        "M.b": ([0.2, 0.4], [9, 9], "deg", ""),
        "E.c": ([0.1], [0.0], "", ""),
    }
    assert notes == ["1 identifiers are in no database: 0xc8"]
    assert bus.knows(100) and not bus.knows(200)


def test_times_of_frames_that_fall_are_sorted_with_their_values(tmp_path):
    bus = make_bus(tmp_path)
    add(bus, *((100, False, "1", bytes([k])) for k in range(4)))
    c = bus.channels(np.array([0.0, 0.2, 0.1, 0.3]), None, [])["M.a"]
    assert c.time.tolist() == [0.0, 0.1, 0.2, 0.3] and c.value.tolist() == [0, 2, 1, 3]


def test_a_message_on_two_buses_is_numbered_in_the_order_of_their_names(tmp_path):
    bus = make_bus(tmp_path)
    add(bus, *((100, False, b, bytes([k])) for k, b in enumerate(["10", "2", "1"])))
    notes: list[str] = []
    found = bus.channels(np.arange(3.0), np.ones(3, bool), notes)
    assert {n: c.value.tolist() for n, c in found.items()} == {"M.a": [2], "M.a#2": [1], "M.a#3": [0]}
    assert len(notes) == 2 and "identifier 0x64 on bus 2 are named like M.a#2" in notes[0]


def test_only_needed_signals_are_decoded_by_either_name_and_foreign_databases_are_refused(tmp_path):
    for name in ("b", "M.b"):
        bus = make_bus(tmp_path, lambda n, name=name: n == name)
        add(bus, (100, False, "1", bytes(8)), (300, False, "1", b""))
        notes: list[str] = []
        assert list(bus.channels(np.arange(2.0), None, notes)) == ["M.b"] and notes == []
    bus = make_bus(tmp_path)
    add(bus, (300, False, "1", b"\x00"), (0x12C, True, "1", b""), (301, False, "1", b""))
    with pytest.raises(UserError, match=r"none of its 2 identifiers \(0x12c, 0x12d\) is in car.dbc"):
        bus.channels(np.arange(3.0), None, [])


def test_databases_are_those_that_are_named_or_else_those_of_the_folder(tmp_path):
    log = tmp_path / "x.log"
    with pytest.raises(UserError, match="its folder has no database"):
        find_databases(log, ReadOptions(), required=True)
    assert find_databases(log, ReadOptions(), required=False) == []
    beside = [tmp_path / n for n in ("a.DBC", "b.arxml", "c.kcd", "d.sym")]
    for p in (*beside, tmp_path / "e.xml"):
        p.touch()
    assert find_databases(log, ReadOptions(), required=True) == beside
    assert find_databases(log, ReadOptions(databases=(beside[1],)), required=True) == [beside[1]]
    with pytest.raises(NoFile, match=r"f.dbc: no such file"):
        find_databases(log, ReadOptions(databases=(beside[0], tmp_path / "f.dbc")), required=False)


def test_error_frames_of_a_bus_and_times_that_fall_are_named(tmp_path):
    pytest.importorskip("can", reason="python-can is not installed: scripts/setup.sh logs")
    pytest.importorskip("cantools", reason="cantools is not installed: scripts/setup.sh logs")
    (tmp_path / "car.dbc").write_text(DBC)
    rows = [f"({0.1 * k:.1f}) can0 064#{k:02X}\n" for k in range(9)]
    rows.insert(4, "(0.4) can0 20000004#0000000000000000\n")
    rows.insert(7, "(0.05) can0 064#FF\n")
    (tmp_path / "x.log").write_text("".join(rows))
    log = read_recording(tmp_path / "x.log")
    c = log.channels["M.a"]
    assert c.value.tolist() == list(range(9)) and log.format == "CAN log"
    np.testing.assert_allclose(c.time, 0.1 * np.arange(9))
    assert "1 error frames on the bus" in log.notes
    assert "frames: 1 entries are out of order: left out" in log.notes
    (tmp_path / "x.log").write_text("(0.4) can0 20000004#0000000000000000\n")
    with pytest.raises(UserError, match="has no frames"):
        read_recording(tmp_path / "x.log")


def test_error_frames_are_counted_and_remote_frames_are_left_out():
    def make(at: float, error: bool = False, remote: bool = False, **more) -> SimpleNamespace:
        own = {"arbitration_id": 5, "is_extended_id": True, "channel": 2, "data": bytearray(b"\x01")} | more
        return SimpleNamespace(timestamp=at, is_error_frame=error, is_remote_frame=remote, **own)

    lines = Lines(Path("x"))
    reader = [make(1.0), make(2.0, error=True), make(3.0, remote=True), make(4.0, channel=None)]
    assert list(read_can._convert_frames(reader, lines)) == [
        CanFrame(1.0, 5, True, "2", b"\x01"),
        CanFrame(4.0, 5, True, "0", b"\x01"),
    ]
    assert lines.errors == 1


def test_frames_of_an_mf4_have_the_columns_that_it_lacks_by_default():
    kind = [("CAN_DataFrame.ID", "u4"), ("CAN_DataFrame.DataBytes", "(4,)u1")]
    samples = np.array([(5, [1, 2, 3, 4]), (1 << 31 | 6, [5, 6, 7, 8])], kind)
    ids, extended, buses, data = _read_frame_columns(samples)
    assert (make_key(ids, extended) & 0x7FF).tolist() == [5, 6] and extended.tolist() == [False, True]
    assert buses == ["0", "0"] and data == [b"\x01\x02\x03\x04", b"\x05\x06\x07\x08"]
    more = [
        ("CAN_DataFrame.DataLength", "u1"),
        ("CAN_DataFrame.IDE", "u1"),
        ("CAN_DataFrame.BusChannel", "u1"),
    ]
    wide = np.zeros(2, kind + more)
    for name in samples.dtype.names:
        wide[name] = samples[name]
    wide["CAN_DataFrame.DataLength"] = [2, 0]
    wide["CAN_DataFrame.IDE"], wide["CAN_DataFrame.BusChannel"] = [1, 0], [3, 4]
    ids, extended, buses, data = _read_frame_columns(wide)
    assert extended.tolist() == [True, False] and buses == ["3", "4"] and data == [b"\x01\x02", b""]
    assert _read_frame_columns(samples[["CAN_DataFrame.ID"]]) is None


# ---- Databases


def split(text: str) -> tuple[list, list, list[str]]:
    """Return messages, later statements, and what is odd of a DBC."""
    odd = databases._OddLines()
    messages, later = databases._split_parts(text, odd)
    return messages, later, [f"{line}: {what}" for line, what in odd.said]


@pytest.mark.parametrize(
    ("line", "identifier", "odd"),
    [
        ("BO_ 100 M: 8 X", 100, ""),
        ("BO_ 2047 M: 64 X", 2047, ""),
        ("BO_ 2048 M: 8 X", 2048 | 1 << 31, "more than 11 bits, so it is taken as extended"),
        ("BO_ 2147483748 M: 8 X", 2147483748, ""),
        ("BO_ 3221225472 M: 0 X", None, ""),  # Vector's message of signals without a message
        ("BO_ 1610612736 M: 8 X", None, "identifier 1610612736 has more than 29 bits"),
        ("BO_ 100 M: 65 X", None, "its length is 65 bytes, allowed: up to 64"),
        ("BO_ x M: 8 X", None, "cannot be parsed as a message"),
    ],
)
def test_a_message_of_a_database_is_kept_repaired_or_left_out_with_its_signals(line, identifier, odd):
    signal = ' SG_ {} : 0|8@1+ (1,0) [0|1] "" X\n'
    text = (
        f"BO_ 50 F: 8 X\n{signal.format('f')}{line}\n{signal.format('a')}BO_ 200 N: 8 X\n{signal.format('b')}"
    )
    messages, _, said = split(text)
    wanted = {50: ["f"], identifier: ["a"], 200: ["b"]}
    wanted.pop(None, None)
    assert {m.identifier: list(m.signals) for m in messages} == wanted
    assert len(said) == bool(odd) and all(odd in s and s.startswith("3: ") for s in said)


@pytest.mark.parametrize(
    ("signal", "kept", "odd"),
    [
        ("a : 8|8@1+ (1,0) [0|1]", "a : 8|8@1+ (1,0) [0|1]", ""),
        ("a m2 : 7|16@0- (.5,-40)", "a m2 : 7|16@0- (0.5,-40) [0|0]", ""),
        ("a M : 0|64@1+ (1e-2,0) [-1|2]", "a M : 0|64@1+ (0.01,0) [-1|2]", ""),
        ("0a : 0|8@1+ (1,0) [0|1]", "_0a : 0|8@1+ (1,0) [0|1]", "the name '0a' is read as _0a"),
        ("a-b : 0|8@1+ (1,0) [0|1]", "a_b : 0|8@1+ (1,0) [0|1]", "the name 'a-b' is read as a_b"),
        ("a : 0|0@1+ (1,0) [0|1]", None, "has 0 bits, allowed: 1 .. 64"),
        ("a : 0|65@1+ (1,0) [0|1]", None, "has 65 bits"),
        ("a : 0|8@1+ (1,) [0|1]", None, "cannot be parsed as a signal"),
        ("first : 8|8@1+ (1,0) [0|1]", None, "signal first: occurs twice"),
    ],
)
def test_a_signal_of_a_database_is_kept_repaired_or_left_out(signal, kept, odd):
    head = 'BO_ 100 M: 8 X\n SG_ first : 0|8@1+ (1,0) [0|1] "" X\n'
    messages, _, said = split(f'{head} SG_ {signal} "deg" X')
    made = list(messages[0].signals.values())[1:]
    assert [" ".join(s.split()) for s in made] == ([f'SG_ {kept} "deg" Vector__XXX'] if kept else [])
    assert len(said) == bool(odd) and all(odd in s and s.startswith("3: ") for s in said)


HEAD = 'BO_ 100 M: 8 X\n SG_ a-b : 0|8@1+ (1,0) [0|1] "" X\n'


@pytest.mark.parametrize(
    ("text", "kept", "odd"),
    [
        ('VAL_ 100 a-b 1 "on" 0 "off" ;', 'VAL_ 100 a_b 1 "on" 0 "off" ;', ""),
        ('VAL_ 100 a-b 1 "on"', 'VAL_ 100 a_b 1 "on";', ""),
        ('VAL_ 100 c 1 "on" ;', None, "values of signal c, which does not exist"),
        ('VAL_ 101 a-b 1 "on" ;', None, "values of signal a-b, which does not exist"),
        ("VAL_ 100 a-b 1 on ;", None, "is not well-formed"),
        ("SIG_VALTYPE_ 100 a-b : 1;", "SIG_VALTYPE_ 100 a_b : 1;", ""),
        ("SIG_VALTYPE_ 100 a-b : 4;", None, "is not well-formed"),
        ('CM_ SG_ 100 a-b "of\ntwo lines";', 'CM_ SG_ 100 a_b "of\ntwo lines";', ""),
        ('CM_ SG_ 100 c "x";', None, "a comment of signal c, which does not exist"),
        ('CM_ SG_ 100 "x";', None, "is a comment that names no object"),
        ('CM_ 100 "x";', None, "is a comment that names no object"),
        ('CM_ BO_ 100 "x";', None, ""),
        (
            'BA_ "SystemSignalLongSymbol" SG_ 100 ab "long";',
            'BA_ "SystemSignalLongSymbol" SG_ 100 ab "long";',
            "",
        ),
        ('BA_ "SystemSignalLongSymbol" SG_ 999 ab "long";', None, ""),
    ],
)
def test_a_statement_of_a_signal_has_its_repaired_name_or_is_left_out(text, kept, odd):
    _, later, said = split(HEAD + text)
    assert [x for _, x in later] == ([kept] if kept else []) and all(line == 3 for line, _ in later)
    said = [s for s in said if "is read as" not in s]
    assert len(said) == bool(odd) and all(odd in s and s.startswith("3: ") for s in said)


def test_a_quote_that_is_not_closed_ends_before_the_next_message_but_not_before_other_words():
    text = (
        'CM_ "open\nVAL_ in the comment\nBO_ 100 M: 8 X\n SG_ a : 0|8@1+ (1,0) [0|1] "" X\nVAL_ 1 a 0 "x"\n;'
    )
    found = list(databases._split_statements(text))
    assert [line for line, _ in found] == [1, 3, 4, 5]
    assert found[0][1] == 'CM_ "open\nVAL_ in the comment' and found[-1][1] == 'VAL_ 1 a 0 "x"\n;'


def test_a_note_lists_the_first_odd_lines_in_their_order_and_counts_the_rest():
    odd = databases._OddLines()
    for line in (30, 10, 20, 50, 40, 60):
        odd.add(line, f"fault {line}")
    said = odd.note(Path("folder/car.dbc"))
    wanted = "; ".join(f"line {k}: fault {k}" for k in (10, 20, 30, 40))
    assert said == f"car.dbc: {wanted}; and 2 more such lines"
    odd.said = odd.said[:4]
    assert odd.note(Path("car.dbc")) == f"car.dbc: {wanted}"


def test_of_a_message_that_is_refused_the_good_signals_are_kept(tmp_path):
    """A signal that is named like a word of the language of databases cannot be read."""
    pytest.importorskip("cantools", reason="cantools is not installed: scripts/setup.sh logs")
    path, notes = tmp_path / "car.dbc", []
    signal = ' SG_ {} : {}|8@1+ (1,0) [0|1] "" X\n'
    head = "".join(signal.format(n, 8 * k) for k, n in enumerate(("a", "BO_", "b")))
    path.write_text(
        f'BO_ 100 M: 3 X\n{head}BO_ 200 N: 1 X\n{signal.format("c", 0)}BO_ 300 L: 99 X\nVAL_ 200 c 1 "on" ;\n'
    )
    found = databases.read_database(path, notes)
    assert {m.name: [s.name for s in m.signals] for m in found} == {"M": ["a", "b"], "N": ["c"]}
    assert len(notes) == 1 and notes[0] == (
        "car.dbc: line 1: signals BO_ of message M cannot be read: left out; "
        "line 7: message L: its length is 99 bytes, allowed: up to 64: left out; "
        "line 8: 1 lines of values and comments are left out"
    )


def test_a_database_is_decoded_as_utf_8_or_else_as_cp1252(tmp_path):
    path = tmp_path / "car.dbc"
    for encoding in ("cp1252", "utf-8", "utf-8-sig"):
        path.write_bytes("Größe °C".encode(encoding))
        assert databases._read_text(path) == "Größe °C"
