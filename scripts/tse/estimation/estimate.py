"""Run the filter over a log: what it starts from (a learnt state, whose bytes are the
library's, tse/learnt.h), the table that comes out, and how that is written."""

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
    Filter,
    LearntError,
    library,
)
from tse.library.errors import UserError
from tse.library.files import atomic, is_parquet
from tse.log.rows import MEASURES, Log

if TYPE_CHECKING:
    import pyarrow as pa

DAY = 86400.0  # s
MOST = 1 << 16  # bytes; no learnt state is longer


@dataclass(frozen=True)
class Learnt:
    """A learnt state, read but not yet checked, and how old it is."""

    path: Path
    data: bytes
    age: float  # s
    given: bool  # the age; else it is that of the file

    def load(self, filter_: Filter) -> None:
        """Let the filter start from it; the library says what is wrong with it."""
        try:
            filter_.load_learnt(self.data, self.age)
        except LearntError as error:
            raise UserError(f"{self.path}: {error}") from None

    @property
    def note(self) -> str:
        days = f"{self.age / DAY:.3g} days"
        return f"{self.path}, {days} old" + (
            " (--age)" if self.given else " (time of the file; --age says it better)"
        )


def read_learnt(path: Path, age: float | None = None) -> Learnt:
    """Read a file that write_learnt() wrote. `age`: s since that drive; None: the age of
    the file."""
    try:
        with open(path, "rb") as file:
            data = file.read(MOST)
        since = time.time() - path.stat().st_mtime if age is None else age
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}") from None
    return Learnt(path, data, max(since, 0.0), age is not None)


def write_learnt(path: Path, data: bytes) -> None:
    with atomic(path, "wb") as file:
        file.write(data)


# ---- Rows of a table as CSV: a long log is ten million cells, for which pandas takes eight seconds, Arrow one, orjson a quarter.


Columns = Mapping[str, Any] | pd.DataFrame  # the columns: arrays, Categoricals or Series
ALIKE = {"f": (0.0, 1e10), "d": (1e-5, 1e10)}  # sizes of real numbers that orjson and Arrow write alike
WHOLE = 1 << 24  # from here on not every whole number is one in single precision


def csv_header(table: Columns) -> bytes:
    """The line of the column names."""
    return pd.DataFrame(columns=list(table)).to_csv(index=False, lineterminator="\n").encode()


def csv_rows(table: Columns) -> bytes:
    """The lines of the rows: of every number the shortest digits that give the same bits
    back; missing values are empty cells."""
    columns = [getattr(column, "array", column) for _, column in table.items()]
    columns = [c if isinstance(c, pd.Categorical) else np.asarray(c) for c in columns]
    if not columns or not len(columns[0]):
        return b""
    parts: list[Iterable[bytes]] = []
    for (kind, same, plain), group in itertools.groupby(columns, _kind):
        among = [c[:1] if same else c for c in group]
        found = _parts(among, kind, plain)
        if found is None:
            return _rows_of_arrow(table)
        parts.append(itertools.repeat(found[0], len(columns[0])) if same else found)
    return b"\n".join(map(b",".join, zip(*parts, strict=True))) + b"\n"


def _kind(column: Any) -> tuple[str, bool, bool]:
    """As what a column is written: words, f (small whole numbers, too), d or nothing of
    these; whether all its cells read the same, as in most columns of a few rows; whether
    no number is missing or whole, which orjson writes otherwise than Arrow."""
    words = isinstance(column, pd.Categorical)
    values = column.codes if words else column
    if values.dtype.kind not in "iuf":
        return "", False, False
    missing = values != values
    same = bool((values == values[0]).all() or missing.all())
    if same and values[0] == 0:  # -0.0 is another number
        same = bool(np.signbit(values).all() == np.signbit(values).any())
    plain = values.dtype.kind == "f" and not bool((missing | (np.floor(values) == values)).any())
    return "words" if words else "d" if values.dtype == np.float64 else "f", same, plain


def _parts(columns: Sequence[Any], kind: str, plain: bool) -> list[bytes] | None:
    """Of each row the cells of these columns, of which _kind() says what it says; None of
    what Arrow writes otherwise."""
    if kind == "words":
        return _words(columns)
    if not kind or any(c.dtype.kind in "iu" and not -WHOLE < c.min() <= c.max() < WHOLE for c in columns):
        return None
    import orjson

    block = np.stack(columns, axis=1, dtype=kind, casting="unsafe")
    size, (least, most) = np.abs(block), ALIKE[kind]
    if ((size >= most) | ((size < least) & (size > 0))).any():
        return None
    text = orjson.dumps(block, option=orjson.OPT_SERIALIZE_NUMPY)[2:-1]  # 1.5,null],[2.0,0.5]
    if not plain:
        text = text.replace(b"null", b"").replace(b".0,", b",").replace(b".0]", b"]")
    return text[:-1].split(b"],[")


def _words(columns: Sequence[pd.Categorical]) -> list[bytes] | None:
    found = []
    for column in columns:
        words = [*map(str, column.categories), ""]
        if any(c in word for word in words for c in ',"\r\n'):
            return None  # it needs quotes
        found.append(np.array([word.encode() for word in words], object)[column.codes].tolist())
    return list(map(b",".join, zip(*found, strict=True)))


def _rows_of_arrow(table: Columns) -> bytes:
    """The same, of any numbers and words."""
    import pyarrow as pa
    from pyarrow.csv import WriteOptions, write_csv

    columns = [_arrow(column) for _, column in table.items()]
    plain = [c.dictionary_decode() if pa.types.is_dictionary(c.type) else c for c in columns]
    if not plain:
        return b""
    rows = pa.table(plain, [str(name) for name in table])

    def lines(quotes: str) -> bytes:
        written = pa.BufferOutputStream()
        write_csv(rows, written, WriteOptions(include_header=False, quoting_style=quotes))
        return bytes(written.getvalue())

    try:
        return lines("none")
    except (
        pa.ArrowInvalid
    ):  # a text with a comma, a quote or a line's end; Arrow would put quotes around every text
        return lines("needed")


def _arrow(column: Any) -> pa.Array:
    """A column for Arrow, the words of a Categorical once."""
    import pyarrow as pa

    column = getattr(column, "array", column)
    if isinstance(column, pd.Categorical):
        codes = pa.array(column.codes, mask=column.codes < 0)
        return pa.DictionaryArray.from_arrays(codes, pa.array(list(column.categories)))
    return pa.array(column, from_pandas=True)


# ---- the filter over a log


CHUNK = 64  # rows between two looks at Ctrl-C and the progress bar
BLOCK = 2048  # rows that are in memory with all their columns at a time
MOST_KEPT = 1 << 19  # rows of a summary: 87 minutes at 100 Hz; of longer logs so many, spread evenly
GROUP = 4 * BLOCK  # ... where they are written as Parquet: rows of a group
DOUBLE = ("time", "log_evidence")  # columns of EST.csv whose differences from row to row count
Block = dict[str, Any]  # rows of EST.csv: column -> array, reasons as pd.Categorical
REFUSED = "row refused"  # the reason of a row with a negative status


@dataclass
class Estimate:
    """Estimates row by row, and how the run ended. The table has all columns of EST.csv,
    or those of SUMMARY, of a very long log every so-manieth row."""

    table: pd.DataFrame
    interrupted: bool
    learnt: bytes | None = None  # what it taught, for Filter.load_learnt(); None without a row
    uncertainty_sd: dict[str, np.ndarray] = field(default_factory=dict)  # Filter.uncertainty_sd() at the end
    statuses: dict[int, int] = field(default_factory=dict)  # rows with each status, all of them

    def __post_init__(self) -> None:
        if not self.statuses:
            self.statuses = dict(Counter(self.table["status"].tolist()))

    def __len__(self) -> int:
        return sum(self.statuses.values())


def est_fields() -> list[Field]:
    """Outputs of the library as EST.csv has them: what came later stands last, so that
    columns keep their places."""
    return sorted(library().fields(OUTPUT), key=lambda f: _generation(f.name))


def _generation(name: str) -> int:
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
def est_columns() -> list[str]:
    """Columns of EST.csv, in order."""
    names = [f.name for f in est_fields()]
    reasons = [f"{s}_reason" for s in STIFFNESS]
    of = {g: [n for n in names if _generation(n) == g] for g in range(5)}
    return ["time", *of[0], *of[1], *reasons, *of[2], *of[3], f"{GRIP}_reason", *of[4]]


def estimate(
    log: Log, config: Config, progress: bool = False, learnt: Learnt | None = None, contradicted: bool = False
) -> Estimate:
    """Run the filter over a log, from what an earlier one taught. Ctrl-C ends the run
    early; what is done is kept. `contradicted`: its channels contradict each other, so no
    row is valid: what would be is implausible."""
    tables = [pd.DataFrame(_head(config))]
    take = lambda block: tables.append(pd.DataFrame(block))  # noqa: E731
    teaches, uncertainty_sd = _run(log, config, take, progress, learnt, contradicted)
    table = pd.concat(tables[1:] or tables, ignore_index=True)
    return Estimate(table, interrupted=len(table) < len(log), learnt=teaches, uncertainty_sd=uncertainty_sd)


def estimate_to(
    path: Path | None,
    log: Log,
    config: Config,
    progress: bool = False,
    learnt: Learnt | None = None,
    watch: Sequence[Callable[[Block], None]] = (),
    contradicted: bool = False,
) -> Estimate:
    """The same, written to EST.csv or .parquet on the way, so that memory does not grow
    by what is written; the table of the result has the columns of SUMMARY. `path`: None:
    they are not written. `watch`: shown every block of rows, for what else becomes of
    them."""
    head = _head(config)
    summary = Summary(head, len(log))
    with _writing(path, head) as write:

        def take(block: Block) -> None:
            write(block)
            for each in (summary.add, *watch):
                each(block)

        teaches, uncertainty_sd = _run(log, config, take, progress, learnt, contradicted)
    return Estimate(
        summary.table(),
        interrupted=summary.rows < len(log),
        learnt=teaches,
        uncertainty_sd=uncertainty_sd,
        statuses=summary.statuses,
    )


@contextmanager
def _writing(path: Path | None, head: Block) -> Iterator[Callable[[Block], object]]:
    """Who writes blocks of rows: as CSV, or as Parquet where the name says so. `head`:
    the table without rows."""
    if path is None:
        yield lambda block: None
    elif is_parquet(path):
        with atomic(path, "wb") as file, _Parquet(file, single(head)) as rows:
            yield lambda block: rows.add(single(block))
    else:
        with atomic(path, "wb") as file:
            file.write(csv_header(head))
            yield lambda block: file.write(csv_rows(single(block)))


def single(block: Columns) -> Block:
    """Estimates as they are written, in single precision: more digits double size and
    time of the file and mean nothing."""
    return {
        name: column.astype(np.float32) if column.dtype == np.float64 and name not in DOUBLE else column
        for name, column in block.items()
    }


class _Parquet:
    """Blocks of rows, several in one group of the file."""

    def __init__(self, file: IO[bytes], head: Block):
        import pyarrow as pa
        import pyarrow.parquet as pq

        self._pa = pa
        self._waiting: list[Any] = []
        self._schema = pa.schema([(name, _arrow(column).type) for name, column in head.items()])
        self._file = pq.ParquetWriter(file, self._schema)

    def __enter__(self) -> _Parquet:
        return self

    def __exit__(self, *error: object) -> None:
        self._flush()
        self._file.close()

    def add(self, block: Block) -> None:
        self._waiting.append(self._pa.table([_arrow(x) for x in block.values()], schema=self._schema))
        if len(self._waiting) >= GROUP // BLOCK:
            self._flush()

    def _flush(self) -> None:
        if self._waiting:
            self._file.write_table(self._pa.concat_tables(self._waiting))
            self._waiting.clear()


def _run(
    log: Log,
    config: Config,
    take: Callable[[Block], None],
    progress: bool,
    learnt: Learnt | None,
    contradicted: bool,
) -> tuple[bytes | None, dict[str, np.ndarray]]:
    """Run the filter and give its table away block by block. Returned: what it has
    learnt, and Filter.uncertainty_sd()."""
    filter_ = Filter(config)
    if learnt is not None:
        learnt.load(filter_)
    done = 0
    with (
        _stop_flag() as stopped,
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
                last = min(first + CHUNK, len(rows))
                filter_.step_into(rows, outputs, first, last)
                bar.update(last - first)
                first = last
            if contradicted:
                contradict(outputs[:first])
            if first:
                take(block_of(log.time[done : done + first], outputs[:first], config))
            done += first
    return filter_.save_learnt(), filter_.uncertainty_sd()


def contradict(outputs: np.ndarray) -> None:
    """Let no row be valid, as the library itself does where it finds what contradicts:
    with its status and reason."""
    codes = {f.name: code for code, f in library().codes(REASON).items()}
    was_valid = np.zeros(len(outputs), bool)
    for s in (*STIFFNESS, GRIP):
        valid = (outputs[f"{s}_valid"] == codes["valid"]) & (outputs["status"] >= 0)
        outputs[f"{s}_valid"][valid] = codes["implausible"]
        was_valid |= valid
    outputs["status"][was_valid] = library().status("TSE_W_IMPLAUSIBLE")


def _head(config: Config) -> Block:
    """The table without rows."""
    return block_of(np.zeros(0), np.zeros(0, library().dtype(OUTPUT)), config)


def block_of(time: np.ndarray, outputs: np.ndarray, config: Config) -> Block:
    """Outputs of the library as the columns of EST.csv: stiffness in N and N/rad,
    validity as 1 or 0, reasons in words."""
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
        columns[f"{s}_reason"] = _reasons(outputs[f"{s}_valid"], refused)
    return {name: columns[name] for name in est_columns()}


def _reasons(codes: np.ndarray, refused: np.ndarray) -> pd.Categorical:
    """Codes of tse_reason in words."""
    words = [f.name for _, f in sorted(library().codes(REASON).items())]  # the codes count from 0
    known = (codes >= 0) & (codes < len(words))
    place = np.where(refused, len(words) + 1, np.where(known, codes, len(words)))
    return pd.Categorical.from_codes(place, dtype=_categories((*words, "unknown", REFUSED)))


@functools.lru_cache(maxsize=1)
def _categories(words: tuple[str, ...]) -> pd.CategoricalDtype:
    return pd.CategoricalDtype(words)


def write_estimates(table: pd.DataFrame, path: Path) -> None:
    """EST.csv of a table with all its columns."""
    write_table(pd.DataFrame(single(table)), path)


def write_table(table: pd.DataFrame, path: Path) -> None:
    """CSV with the shortest digits that give the same bits back."""
    with atomic(path, "wb") as file:
        file.write(csv_header(table))
        for start in range(0, len(table), BLOCK):
            file.write(csv_rows(table.iloc[start : start + BLOCK]))


# What verdicts, remarks and the list of events need of EST.csv, as small as it can be:
# 360 000 rows an hour stay in memory.
SUMMARY: dict[str, type | None] = {
    "time": np.float64,
    "status": np.int16,
    **{f"{s}{part}": np.float32 for s in STIFFNESS for part in ("", "_sd", "_spread")},
    **{f"{s}{part}": np.int8 for s in STIFFNESS for part in ("_valid", "_spread_seen")},
    **{f"{s}_reason": None for s in (*STIFFNESS, GRIP)},  # None: categories
    **dict.fromkeys((GRIP, f"{GRIP}_sd", "sideslip", "sideslip_sd", "lag_steer"), np.float32),
    f"{GRIP}_valid": np.int8,
    **{f"noise_{c}": np.float32 for c in MEASURES},
    **regimes.COLUMNS,
    "fault_factor": np.float32,
}


class Summary:
    """The columns of SUMMARY of a table that comes block by block. `head`: the table
    without rows; `rows`: how many may come. Of more than MOST_KEPT every second, third
    ... is kept."""

    def __init__(self, head: Block, rows: int):
        kinds = {name: kind for name, kind in SUMMARY.items() if name in head}
        self._stride = max(1, -(-rows // MOST_KEPT))
        self._words = {name: head[name].dtype for name, kind in kinds.items() if kind is None}
        # of a column of zeros nothing is in memory: no fault, no change
        self._columns = {
            name: np.zeros(-(-rows // self._stride), kind or np.int8) for name, kind in kinds.items()
        }
        self._done = 0
        self.rows = 0
        self.statuses: dict[int, int] = {}

    def add(self, block: Block) -> None:
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
def _stop_flag() -> Iterator[Callable[[], bool]]:
    """While open, the first Ctrl-C only raises a flag; the second acts as usual."""
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
