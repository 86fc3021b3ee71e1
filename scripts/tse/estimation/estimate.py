"""Run the filter over a log and write the table of estimates (EST.csv or .parquet).

A run may start from the learnt state of an earlier drive: stiffnesses, grip, steering
offset, sensor biases and noise at the end of that drive, with their sds and correlations.
The library writes and reads the learnt state as bytes (tse/learnt.h)."""

from __future__ import annotations

import functools
import itertools
import signal
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from tse.estimation import regimes
from tse.library.core import (
    GRIP,
    NOMINAL,
    OUTPUT,
    REASON,
    STIFFNESS,
    Config,
    Field,
    LearntError,
    NativeFilter,
    library,
)
from tse.library.errors import UserError
from tse.library.files import is_parquet, write_atomically
from tse.log.clock import DAY
from tse.log.rows import MEASURES, CheckedLog

if TYPE_CHECKING:
    import pyarrow as pa

# [bytes] max length that is read of a file. A learnt state is shorter, and the library
# rejects a file of this length.
MAX_LEARNT = 1 << 16


@dataclass(frozen=True)
class Learnt:
    """A learnt state as read from its file, not yet checked by the library."""

    path: Path
    data: bytes
    age: float  # [s] time since the drive on which the state was learnt
    given: bool  # True if the user stated the age, False if it is the age of the file

    def load(self, filter_: NativeFilter) -> None:
        """Load the state into the filter. Raise UserError if the library rejects it."""
        try:
            filter_.load_learnt(self.data, self.age)
        except LearntError as error:
            raise UserError(f"{self.path}: {error}") from None

    @property
    def note(self) -> str:
        days = f"{self.age / DAY:.3g} days"
        return f"{self.path}, {days} old" + (
            " (--age)" if self.given else " (time of the file; give the true age by --age)"
        )


def read_learnt(path: Path, age: float | None = None) -> Learnt:
    """Read a file that write_learnt() wrote.

    `age` is the time [s] since the drive on which the state was learnt. The library needs
    it, because the uncertainty of the learnt values grows with time. None: the age of the
    file is used."""
    try:
        with open(path, "rb") as file:
            data = file.read(MAX_LEARNT)
        since = time.time() - path.stat().st_mtime if age is None else age
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}") from None
    return Learnt(path, data, max(since, 0.0), age is not None)


def write_learnt(path: Path, data: bytes) -> None:
    with write_atomically(path, "wb") as file:
        file.write(data)


# ---- Rows as CSV
#
# For speed, orjson converts numbers to text. Arrow writes a block of rows if orjson would
# write one of its numbers differently than Arrow (SAME_TEXT), or if a string needs
# quotes. The ten million cells of a long log take 8 s with pandas, 1 s with Arrow, 0.25 s
# with orjson.


Columns = Mapping[str, Any] | pd.DataFrame  # name -> array, Categorical or Series
# Precision, single ("f") or double ("d") -> range of absolute values for which orjson and
# Arrow write the same text. If a number other than 0 is outside, Arrow writes the rows.
SAME_TEXT = {"f": (0.0, 1e10), "d": (1e-5, 1e10)}
MAX_WHOLE = 1 << 24  # single precision represents all integers up to this one exactly


def make_csv_header(table: Columns) -> bytes:
    """Return the header line of the CSV file: the column names."""
    return pd.DataFrame(columns=list(table)).to_csv(index=False, lineterminator="\n").encode()


def make_csv_rows(table: Columns) -> bytes:
    """Return the rows as lines of CSV.

    Each number has the smallest number of digits from which the same bits are read back.
    Missing values are empty cells."""
    columns = [getattr(column, "array", column) for _, column in table.items()]
    columns = [c if isinstance(c, pd.Categorical) else np.asarray(c) for c in columns]
    if not columns or not len(columns[0]):
        return b""
    parts: list[Iterable[bytes]] = []
    for (kind, same, plain), group in itertools.groupby(columns, _find_kind):
        among = [c[:1] if same else c for c in group]
        found = _join_cells(among, kind, plain)
        if found is None:
            return _write_rows_by_arrow(table)
        parts.append(itertools.repeat(found[0], len(columns[0])) if same else found)
    return b"\n".join(map(b",".join, zip(*parts, strict=True))) + b"\n"


def _find_kind(column: Any) -> tuple[str, bool, bool]:
    """Return how the cells of a column can be converted to text.

    Returns
    -------
    kind : str
        "words" for a Categorical, "d" for double precision, "f" for single precision and
        integers; "" if only Arrow can write the column.
    same : bool
        True if all cells have the same text. Only one cell is then converted.
    plain : bool
        True if no number is missing or whole. The text of orjson is then used unchanged.
        False: _join_cells() corrects the text. orjson writes a missing number as "null"
        and the number 2 as "2.0". The file needs "" and "2"."""
    words = isinstance(column, pd.Categorical)
    values = column.codes if words else column
    if values.dtype.kind not in "iuf":
        return "", False, False
    missing = values != values
    same = bool((values == values[0]).all() or missing.all())
    if same and values[0] == 0:  # 0.0 and -0.0 are equal, but are written differently
        same = bool(np.signbit(values).all() == np.signbit(values).any())
    plain = values.dtype.kind == "f" and not bool((missing | (np.floor(values) == values)).any())
    return "words" if words else "d" if values.dtype == np.float64 else "f", same, plain


def _join_cells(columns: Sequence[Any], kind: str, plain: bool) -> list[bytes] | None:
    """Return one string for each row: the cells of these columns, joined by commas.

    Return None if only Arrow can write one of the columns."""
    if kind == "words":
        return _encode_words(columns)
    if not kind or any(
        c.dtype.kind in "iu" and not -MAX_WHOLE < c.min() <= c.max() < MAX_WHOLE for c in columns
    ):
        return None
    import orjson

    block = np.stack(columns, axis=1, dtype=kind, casting="unsafe")
    size, (low, high) = np.abs(block), SAME_TEXT[kind]
    if ((size >= high) | ((size < low) & (size > 0))).any():
        return None
    text = orjson.dumps(block, option=orjson.OPT_SERIALIZE_NUMPY)[2:-1]  # e.g. 1.5,null],[2.0,0.5]
    if not plain:
        text = text.replace(b"null", b"").replace(b".0,", b",").replace(b".0]", b"]")
    return text[:-1].split(b"],[")


def _encode_words(columns: Sequence[pd.Categorical]) -> list[bytes] | None:
    found = []
    for column in columns:
        words = [*map(str, column.categories), ""]
        if any(c in word for word in words for c in ',"\r\n'):
            return None  # CSV needs quotes around this word, and only Arrow writes quotes
        found.append(np.array([word.encode() for word in words], object)[column.codes].tolist())
    return list(map(b",".join, zip(*found, strict=True)))


def _write_rows_by_arrow(table: Columns) -> bytes:
    """Return the rows as lines of CSV, written by Arrow. All numbers and strings are
    allowed."""
    import pyarrow as pa
    from pyarrow.csv import WriteOptions, write_csv

    columns = [_make_arrow(column) for _, column in table.items()]
    plain = [c.dictionary_decode() if pa.types.is_dictionary(c.type) else c for c in columns]
    if not plain:
        return b""
    rows = pa.table(plain, [str(name) for name in table])

    def write_lines(quotes: str) -> bytes:
        written = pa.BufferOutputStream()
        write_csv(rows, written, WriteOptions(include_header=False, quoting_style=quotes))
        return bytes(written.getvalue())

    try:
        return write_lines("none")
    except pa.ArrowInvalid:
        # A string contains a comma, a quote or a line break. With the style "needed",
        # Arrow puts quotes around all strings. Therefore, "none" is tried first.
        return write_lines("needed")


def _make_arrow(column: Any) -> pa.Array:
    """Return a column as an Arrow array; a Categorical as a dictionary array."""
    import pyarrow as pa

    column = getattr(column, "array", column)
    if isinstance(column, pd.Categorical):
        codes = pa.array(column.codes, mask=column.codes < 0)
        return pa.DictionaryArray.from_arrays(codes, pa.array(list(column.categories)))
    return pa.array(column, from_pandas=True)


# ---- the filter over a log


ROWS_AT_A_TIME = 64  # number of rows after which Ctrl-C is checked and the progress bar is updated
BLOCK = 2048  # number of rows that are in memory with all columns at one time
# Max number of rows of a Summary (the columns that verdicts and events need): 87 minutes
# at 100 Hz. Of a longer log, only every n-th row is kept.
MAX_SUMMARY = 1 << 19
GROUP = 4 * BLOCK  # number of rows of a row group in a Parquet file
# columns that are written in double precision, because small differences of large values
# are significant
DOUBLE = ("time", "log_evidence")
Block = dict[str, Any]  # rows of EST.csv: column -> array, reasons as pd.Categorical
REFUSED = "row refused"  # reason in every row whose status is negative


@dataclass
class Estimates:
    """The estimates of a run, row by row, and how the run ended.

    If estimate() made the table, it has all columns of EST.csv and all rows. If
    estimate_to() made it, it has the columns of SUMMARY, and only every n-th row of a
    long log."""

    table: pd.DataFrame
    interrupted: bool  # True if Ctrl-C ended the run before the last row
    learnt: bytes | None = None  # for NativeFilter.load_learnt(); None: nothing was learnt
    # Result of NativeFilter.uncertainty_sd() after the last row: uncertain setting of the
    # car -> [1] sd that it adds to cx_front, cy_front and cy_rear, each divided by the
    # nominal stiffness
    uncertainty_sd: dict[str, np.ndarray] = field(default_factory=dict)
    # status -> number of rows with this status, including rows that are not in the table
    statuses: dict[int, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.statuses:
            self.statuses = dict(Counter(self.table["status"].tolist()))

    def __len__(self) -> int:
        return sum(self.statuses.values())


def list_est_fields() -> list[Field]:
    """Return the library's outputs in the order of EST.csv.

    Outputs that were added in later versions come last, so that the older columns keep
    their positions."""
    return sorted(library().fields(OUTPUT), key=lambda f: _find_generation(f.name))


def _find_generation(name: str) -> int:
    """Return the version of EST.csv that first had this output, 0 .. 4. Version 0 is the
    first, 4 the present one."""
    if name.endswith("_secant") or name == "fault_factor":
        return 4
    if name.startswith((GRIP, "noise_wheel_", "innovation_", "nis_")) or name == "sideslip_sd":
        return 3
    if name.startswith(("p_", "change_", "discrepancy_", "lag_")) or name in (
        "fault_channel",
        "estimate_age",
    ):
        return 2
    return int(name.endswith("_spread_seen") or name.startswith("noise_"))


@functools.lru_cache(maxsize=1)
def list_est_columns() -> list[str]:
    """Return the names of the columns of EST.csv, in their order."""
    names = [f.name for f in list_est_fields()]
    reasons = [f"{s}_reason" for s in STIFFNESS]
    of = {g: [n for n in names if _find_generation(n) == g] for g in range(5)}
    return ["time", *of[0], *of[1], *reasons, *of[2], *of[3], f"{GRIP}_reason", *of[4]]


def estimate(
    log: CheckedLog,
    config: Config,
    progress: bool = False,
    learnt: Learnt | None = None,
    contradicted: bool = False,
) -> Estimates:
    """Run the filter over a log. Ctrl-C ends the run early, and the estimates up to there
    are returned.

    `learnt` is the learnt state from which the run starts. None: the run starts from the
    settings. `contradicted`: True if the channels of the log contradict each other. Then
    estimates that the filter marks as valid are marked as implausible instead."""
    tables = [pd.DataFrame(_make_head(config))]
    take = lambda block: tables.append(pd.DataFrame(block))  # noqa: E731
    state, uncertainty_sd = _run_filter(log, config, take, progress, learnt, contradicted)
    table = pd.concat(tables[1:] or tables, ignore_index=True)
    return Estimates(table, interrupted=len(table) < len(log), learnt=state, uncertainty_sd=uncertainty_sd)


def estimate_to(
    path: Path | None,
    log: CheckedLog,
    config: Config,
    progress: bool = False,
    learnt: Learnt | None = None,
    watch: Sequence[Callable[[Block], None]] = (),
    contradicted: bool = False,
) -> Estimates:
    """Run the filter over a log, and write EST.csv or .parquet block by block.

    The table of the result has only the columns of SUMMARY and at most MAX_SUMMARY rows,
    which limits the memory needed. If `path` is None, no file is written. The functions
    in `watch` are called with every block of rows. `learnt` and `contradicted` have the
    same meaning as in estimate()."""
    head = _make_head(config)
    summary = Summary(head, len(log))
    with _open_writer(path, head) as write:

        def take(block: Block) -> None:
            write(block)
            for each in (summary.add, *watch):
                each(block)

        state, uncertainty_sd = _run_filter(log, config, take, progress, learnt, contradicted)
    return Estimates(
        summary.table(),
        interrupted=summary.rows < len(log),
        learnt=state,
        uncertainty_sd=uncertainty_sd,
        statuses=summary.statuses,
    )


@contextmanager
def _open_writer(path: Path | None, head: Block) -> Iterator[Callable[[Block], object]]:
    """Open the file, and yield a function that writes a block of rows to it.

    The format is Parquet if the file name has its ending, otherwise CSV. `head` is the
    table without rows. If `path` is None, the function writes nothing."""
    if path is None:
        yield lambda block: None
    elif is_parquet(path):
        with write_atomically(path, "wb") as file, _Parquet(file, convert_to_single(head)) as rows:
            yield lambda block: rows.add(convert_to_single(block))
    else:
        with write_atomically(path, "wb") as file:
            file.write(make_csv_header(head))
            yield lambda block: file.write(make_csv_rows(convert_to_single(block)))


def convert_to_single(block: Columns) -> Block:
    """Return estimates in single precision, the precision of the files.

    Further digits would not be significant. They would double the size of a file and the
    time to write it. The columns of DOUBLE keep double precision."""
    return {
        name: column.astype(np.float32) if column.dtype == np.float64 and name not in DOUBLE else column
        for name, column in block.items()
    }


class _Parquet:
    """Writes blocks of rows to a Parquet file, GROUP rows in each row group."""

    def __init__(self, file: IO[bytes], head: Block):
        import pyarrow as pa
        import pyarrow.parquet as pq

        self._pa = pa
        self._waiting: list[Any] = []
        self._schema = pa.schema([(name, _make_arrow(column).type) for name, column in head.items()])
        self._file = pq.ParquetWriter(file, self._schema)

    def __enter__(self) -> _Parquet:
        return self

    def __exit__(self, *error: object) -> None:
        self._flush()
        self._file.close()

    def add(self, block: Block) -> None:
        self._waiting.append(self._pa.table([_make_arrow(x) for x in block.values()], schema=self._schema))
        if len(self._waiting) >= GROUP // BLOCK:
            self._flush()

    def _flush(self) -> None:
        if self._waiting:
            self._file.write_table(self._pa.concat_tables(self._waiting))
            self._waiting.clear()


def _run_filter(
    log: CheckedLog,
    config: Config,
    take: Callable[[Block], None],
    progress: bool,
    learnt: Learnt | None,
    contradicted: bool,
) -> tuple[bytes | None, dict[str, np.ndarray]]:
    """Run the filter over a log, and call `take` with each block of estimates.

    Return two results after the last row: the learnt state (None if there was no row),
    and NativeFilter.uncertainty_sd()."""
    filter_ = NativeFilter(config)
    if learnt is not None:
        learnt.load(filter_)
    done = 0
    with (
        _catch_interrupt() as stopped,
        tqdm(
            total=len(log),
            unit="row",
            unit_scale=True,
            disable=not progress,
            file=sys.stderr,
            leave=False,
            desc="estimate",
        ) as bar,
    ):
        while done < len(log) and not stopped():
            rows = log.rows(done, done + BLOCK)
            outputs, first = filter_.outputs(len(rows)), 0
            while first < len(rows) and not stopped():
                last = min(first + ROWS_AT_A_TIME, len(rows))
                filter_.step_into(rows, outputs, first, last)
                bar.update(last - first)
                first = last
            if contradicted:
                mark_implausible(outputs[:first])
            if first:
                take(make_block(log.time[done : done + first], outputs[:first], config))
            done += first
    return filter_.save_learnt(), filter_.uncertainty_sd()


def mark_implausible(outputs: np.ndarray) -> None:
    """Mark all valid estimates as implausible.

    Replace the reason "valid" by "implausible". Rows with a replaced reason get the
    status TSE_W_IMPLAUSIBLE. Refused rows are not changed."""
    codes = {f.name: code for code, f in library().codes(REASON).items()}
    was_valid = np.zeros(len(outputs), bool)
    for s in (*STIFFNESS, GRIP):
        valid = (outputs[f"{s}_valid"] == codes["valid"]) & (outputs["status"] >= 0)
        outputs[f"{s}_valid"][valid] = codes["implausible"]
        was_valid |= valid
    outputs["status"][was_valid] = library().status("TSE_W_IMPLAUSIBLE")


def _make_head(config: Config) -> Block:
    """Return the table of estimates with its columns, but without rows."""
    return make_block(np.zeros(0), np.zeros(0, library().dtype(OUTPUT)), config)


def make_block(time: np.ndarray, outputs: np.ndarray, config: Config) -> Block:
    """Convert the library's outputs to the columns of EST.csv.

    The library returns stiffness as a ratio to the nominal value. It is converted to N or
    N/rad. The code of a reason is converted to validity (1 or 0) and to a word."""
    refused = outputs["status"] < 0
    columns: Block = {"time": time}
    for f in library().fields(OUTPUT):
        value = outputs[f.name]
        stiffness = next((s for s in STIFFNESS if f.name == s or f.name.startswith(s + "_")), None)
        if f.name.endswith("_valid"):
            columns[f.name] = ((value == 0) & ~refused).astype(int)
        elif stiffness and f.unit == "1":
            columns[f.name] = value * getattr(config, NOMINAL[stiffness])
        else:
            columns[f.name] = value
    for s in (*STIFFNESS, GRIP):
        columns[f"{s}_reason"] = _name_reasons(outputs[f"{s}_valid"], refused)
    return {name: columns[name] for name in list_est_columns()}


def _name_reasons(codes: np.ndarray, refused: np.ndarray) -> pd.Categorical:
    """Return the reason of each row as a word: REFUSED for refused rows, otherwise the
    name of the code (tse_reason), or "unknown" if the library has no such code."""
    words = [f.name for _, f in sorted(library().codes(REASON).items())]  # word i has code i
    known = (codes >= 0) & (codes < len(words))
    place = np.where(refused, len(words) + 1, np.where(known, codes, len(words)))
    return pd.Categorical.from_codes(place, dtype=_make_categories((*words, "unknown", REFUSED)))


@functools.lru_cache(maxsize=1)
def _make_categories(words: tuple[str, ...]) -> pd.CategoricalDtype:
    return pd.CategoricalDtype(words)


def write_estimates(table: pd.DataFrame, path: Path) -> None:
    """Write a table with all columns of EST.csv to a CSV file, in single precision."""
    write_table(pd.DataFrame(convert_to_single(table)), path)


def write_table(table: pd.DataFrame, path: Path) -> None:
    """Write a table as CSV. Each number has the smallest number of digits from which the
    same bits are read back."""
    with write_atomically(path, "wb") as file:
        file.write(make_csv_header(table))
        for start in range(0, len(table), BLOCK):
            file.write(make_csv_rows(table.iloc[start : start + BLOCK]))


# Key: column that verdicts, remarks or events need. Value: type in which the column stays
# in memory. It is the smallest type that holds its values, because a summary has up to
# MAX_SUMMARY rows. None: pd.Categorical.
SUMMARY: dict[str, type | None] = {
    "time": np.float64,
    "status": np.int16,
    **{f"{s}{part}": np.float32 for s in STIFFNESS for part in ("", "_sd", "_spread")},
    **{f"{s}{part}": np.int8 for s in STIFFNESS for part in ("_valid", "_spread_seen")},
    **{f"{s}_reason": None for s in (*STIFFNESS, GRIP)},
    **dict.fromkeys((GRIP, f"{GRIP}_sd", "sideslip", "sideslip_sd", "lag_steer"), np.float32),
    f"{GRIP}_valid": np.int8,
    **{f"noise_{c}": np.float32 for c in MEASURES},
    **regimes.EVENT_COLUMNS,
    "fault_factor": np.float32,
}


class Summary:
    """Collects the columns of SUMMARY block by block.

    `head`: table without rows. `rows`: number of rows of the log. If there are more than
    MAX_SUMMARY, every n-th row is kept, with the smallest n that suffices."""

    def __init__(self, head: Block, rows: int):
        kinds = {name: kind for name, kind in SUMMARY.items() if name in head}
        self._stride = max(1, -(-rows // MAX_SUMMARY))
        self._words = {name: head[name].dtype for name, kind in kinds.items() if kind is None}
        # For an array of np.zeros(), the system provides memory only when the array is
        # written to. Columns that stay 0, such as those of faults and changes, therefore
        # need no memory.
        self._columns = {
            name: np.zeros(-(-rows // self._stride), kind or np.int8) for name, kind in kinds.items()
        }
        self._done = 0
        self.rows = 0
        self.statuses: dict[int, int] = {}

    def add(self, block: Block) -> None:
        """Add the rows of a block."""
        count = len(block["time"])
        rows = slice(-self.rows % self._stride, count, self._stride)
        part = slice(self._done, self._done + len(range(*rows.indices(count))))
        for name, column in self._columns.items():
            values = (block[name].codes if name in self._words else block[name])[rows]
            if values.any():
                column[part] = values
        self._done, self.rows = part.stop, self.rows + count
        for status, often in Counter(np.asarray(block["status"]).tolist()).items():
            self.statuses[status] = self.statuses.get(status, 0) + often

    def table(self) -> pd.DataFrame:
        columns: dict[str, Any] = {name: column[: self._done] for name, column in self._columns.items()}
        for name, words in self._words.items():
            columns[name] = pd.Categorical.from_codes(columns[name], dtype=words)
        return pd.DataFrame(columns, copy=False)


@contextmanager
def _catch_interrupt() -> Iterator[Callable[[], bool]]:
    """Replace the handler of Ctrl-C, and yield a function that returns whether Ctrl-C was
    pressed.

    The first Ctrl-C is only noted. A second one raises KeyboardInterrupt. In a thread
    other than the main one, the handler cannot be replaced, and the function always
    returns False."""
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    seen = threading.Event()

    def on_interrupt(_signal: int, _frame: object) -> None:
        seen.set()
        signal.signal(signal.SIGINT, signal.default_int_handler)

    before = signal.signal(signal.SIGINT, on_interrupt)
    try:
        yield seen.is_set
    finally:
        signal.signal(signal.SIGINT, before)
