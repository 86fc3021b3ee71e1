"""Binding of the C library.

Names, ranges, units and struct layouts are read from the library itself (tse/describe.h),
so that this file repeats none of its tables."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import math
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tse.library.errors import UserError, suggest_names

# enum tse_struct of tse/describe.h
CONFIG, INPUT, OUTPUT, SIM_CONFIG, SIM_INPUT, SIM_OUTPUT, STATUS, REASON = range(8)
REPLAY_LOG, REPLAY_START, REPLAY_OUT = range(8, 11)
FORMULA_PLACE, FORMULA_OP, FORMULA_LIMIT = range(11, 14)
STRUCT_COUNT = 14
STIFFNESS = ("cx_front", "cy_front", "cy_rear")  # in the order of TSE_CX_FRONT ...
ALL_SETTINGS_HINT = "; 'tselab settings' lists all"
GRIP = "grip"  # output whose validity is grip_valid
NOMINAL = {  # settings with the nominal stiffness, in which relative stiffness is counted
    "cx_front": "longitudinal_stiffness_front",
    "cy_front": "cornering_stiffness_front",
    "cy_rear": "cornering_stiffness_rear",
}


class SettingError(UserError):
    """A setting outside its range. The text names setting, value and range."""


class UnknownSetting(SettingError, KeyError):
    """A setting that does not exist. The text suggests similar names."""

    __str__ = Exception.__str__


@dataclass(frozen=True)
class Field:
    """One row of a table of the library."""

    name: str
    kind: str  # s setting, r real, i int32, u uint32, c code, p array, o array or NULL
    offset: int  # bytes; of STATUS and REASON the code
    default: float
    low: float
    high: float
    unit: str
    text: str

    @property
    def has_range(self) -> bool:
        """True if the table limits the value."""
        return self.high >= self.low

    @property
    def is_integer(self) -> bool:
        """True for integer fields."""
        return self.kind in "iu"

    @property
    def range_text(self) -> str:
        """Allowed range with unit, for messages."""
        unit = "" if self.unit in ("", "1") else f" {self.unit}"
        return f"{self.low:g} .. {self.high:g}{unit}" if self.has_range else "any"


@dataclass(frozen=True)
class EffectParameter:
    """One parameter of an effect; `setting` is its name in Config."""

    effect: str
    name: str
    setting: str
    unit: str
    text: str
    strength: bool  # True: 0 switches the effect off. False: a shape, unused at strength 0
    sign: int  # plausible sign of a strength: 1, -1, or 0 for either
    default: float
    low: float
    high: float
    typical: tuple[float, float]
    negligible: float  # size below which the effect is not reported
    given: bool = False  # a shape that logs cannot separate from the strength


@dataclass(frozen=True)
class EffectRow:
    """One row of src/tables/effects.toml."""

    id: str
    hook: str
    title: str
    entry_points: tuple[str, ...]
    channels: str
    look_alikes: tuple[str, ...]  # ids of effects, or descriptions of other causes
    estimator: str  # use of the effect by the filters
    bit: int
    filter: str  # both, default or none: the filters whose estimate it moves
    occurrence: str  # SENSOR, EVERY_CAR, SOME_CARS, ROAD, ABSORBED or IN_MODEL
    early: str  # title of a value below early_below, which is of messages or the IMU; "": there is none
    early_below: float
    parameters: tuple[EffectParameter, ...]

    @property
    def strengths(self) -> tuple[EffectParameter, ...]:
        """Parameters that scale the effect."""
        return tuple(p for p in self.parameters if p.strength)

    @property
    def shapes(self) -> tuple[EffectParameter, ...]:
        """Parameters that shape the effect."""
        return tuple(p for p in self.parameters if not p.strength)


@dataclass(frozen=True)
class SettingUse:
    """The use of one setting of Config."""

    table: str  # of src/tables: vehicle, uncertainty, sensors, latency, velocity, ...
    filter: str  # both, default, paper or none: the filters whose estimate it moves
    replaced_by: str  # the setting that the filter uses instead while that is not 0; "": there is none


@dataclass(frozen=True)
class FormulaOp:
    """One operation of src/tables/formula.toml."""

    name: str
    code: int
    takes: int  # number of operands
    kind: str  # NUMBER, SIGNAL, PLAIN, MEMORY
    # unit of the result: a unit, or its rule from the units of the operands (same,
    # product, quotient, root, first, rate)
    unit: str
    text: str


class _CEffect(ctypes.Structure):
    """tse_effect_row of tse/describe.h."""

    _fields_ = [
        *(
            (name, ctypes.c_char_p)
            for name in ("id", "hook", "title", "entry", "channels", "alike", "estimator")
        ),
        ("bit", ctypes.c_int32),
        *((name, ctypes.c_char_p) for name in ("filter", "occurrence", "early")),
        ("early_below", ctypes.c_double),
    ]


class _CSettingRow(ctypes.Structure):
    _fields_ = [(name, ctypes.c_char_p) for name in ("name", "table", "filter", "replaced_by")]


class _CEffectParameter(ctypes.Structure):
    """tse_effect_parameter of tse/describe.h."""

    _fields_ = [
        *((name, ctypes.c_char_p) for name in ("effect", "name", "setting", "unit", "text")),
        ("strength", ctypes.c_int32),
        ("sign", ctypes.c_int32),
        *(
            (name, ctypes.c_double)
            for name in ("default", "low", "high", "typical_low", "typical_high", "negligible")
        ),
    ]


class _CField(ctypes.Structure):
    """tse_field of tse/describe.h."""

    _fields_ = [
        ("name", ctypes.c_char_p),
        ("kind", ctypes.c_char),
        ("offset", ctypes.c_int32),
        ("default", ctypes.c_double),
        ("low", ctypes.c_double),
        ("high", ctypes.c_double),
        ("unit", ctypes.c_char_p),
        ("text", ctypes.c_char_p),
    ]


class _CBuild(ctypes.Structure):
    """tse_build of tse/describe.h."""

    _fields_ = [
        ("version", ctypes.c_char_p),
        ("format", ctypes.c_char_p),
        ("capacity", ctypes.c_int32),
        ("filter_bytes", ctypes.c_int32),
        ("params_bytes", ctypes.c_int32),
        ("sim_bytes", ctypes.c_int32),
        ("learnt_bytes", ctypes.c_int32),
        ("filter_paper_bytes", ctypes.c_int32),  # 0: the library has one size of filter
        ("fraction_bits", ctypes.c_int32),  # of a fixed-point number; 0: floating point
    ]


def find_library() -> Path:
    """Return the path TSELAB_LIBRARY, or that of the library beside this package."""
    if named := os.environ.get("TSELAB_LIBRARY"):
        return Path(named)
    suffix = {"darwin": "dylib", "win32": "dll"}.get(sys.platform, "so")
    return Path(__file__).parent / "lib" / f"libtse.{suffix}"


class Library:
    """The loaded library: its functions, tables and struct layouts."""

    def __init__(self, path: Path):
        if not path.is_file():
            raise UserError(
                f"the tse library is not at {path}: run scripts/setup.sh, or set TSELAB_LIBRARY to the "
                "shared library"
            )
        try:
            self._dll = ctypes.CDLL(str(path))
        except OSError as error:
            raise UserError(f"{path}: cannot be loaded as a library: {error}") from None
        self.path = path
        # fixed-point numbers are exchanged as double: native(), from_native()
        for suffix, real in (("_f64", np.float64), ("_f32", np.float32), ("_fix", np.float64)):
            if hasattr(self._dll, "tse_step" + suffix):
                self._suffix = suffix
                self.real = np.dtype(real)
                break
        else:
            raise UserError(f"{path}: is not a double, float or fixed-point build of the tse library")
        self._read_build()
        self._read_fields()
        self.effects = self._read_effects()
        kinds = {"n": "NUMBER", "s": "SIGNAL", "p": "PLAIN", "m": "MEMORY"}
        self.formula_limits = {f.name: f.offset for f in self.fields(FORMULA_LIMIT)}
        self.formula_places = {f.name: f for f in self.fields(FORMULA_PLACE)}
        self.formula_ops = {
            f.name: FormulaOp(f.name, f.offset, int(f.default), kinds[f.kind], f.unit, f.text)
            for f in self.fields(FORMULA_OP)
        }
        self.settings = self._read_settings()
        self.uncertainties = self.settings_in("uncertainty")

    def _read_build(self) -> None:
        """Read version, number format and sizes of the build."""
        build = _CBuild()
        self.function("tse_describe_build", None)(ctypes.addressof(build))
        self.version, self.format = build.version.decode(), build.format.decode()
        self.capacity = build.capacity
        self.filter_bytes, self.filter_paper_bytes = build.filter_bytes, build.filter_paper_bytes
        self.params_bytes, self.sim_bytes = build.params_bytes, build.sim_bytes
        self.learnt_bytes = build.learnt_bytes
        self.fraction_bits = build.fraction_bits

    def _read_fields(self) -> None:
        """Read the tables of all structs and codes."""
        describe = self.function(
            "tse_describe", ctypes.POINTER(_CField), [ctypes.c_int] + [ctypes.c_void_p] * 2
        )
        self._fields: dict[int, list[Field]] = {}
        self._sizes: dict[int, int] = {}
        for which in range(STRUCT_COUNT):
            count, size = ctypes.c_int32(), ctypes.c_int32()
            rows = describe(which, ctypes.addressof(count), ctypes.addressof(size))
            self._sizes[which] = size.value
            self._fields[which] = [
                Field(
                    f.name.decode(),
                    f.kind.decode(),
                    f.offset,
                    f.default,
                    f.low,
                    f.high,
                    f.unit.decode(),
                    f.text.decode(),
                )
                for f in (rows[i] for i in range(count.value))
            ]

    def _read_table(self, function: str, row: type) -> list:
        """Return the rows that a function of the library describes."""
        count = ctypes.c_int32()
        rows = self.function(function, ctypes.POINTER(row))(ctypes.addressof(count))
        return [rows[i] for i in range(count.value)]

    def _read_settings(self) -> dict[str, SettingUse]:
        """Return the use of every setting, in the order of Config."""
        return {
            r.name.decode(): SettingUse(r.table.decode(), r.filter.decode(), r.replaced_by.decode())
            for r in self._read_table("tse_describe_settings", _CSettingRow)
        }

    def settings_in(self, *tables: str) -> tuple[str, ...]:
        """Return the settings of some tables of src/tables, in the order of Config."""
        return tuple(name for name, use in self.settings.items() if use.table in tables)

    def _read_effects(self) -> dict[str, EffectRow]:
        """Return the catalogue of effects, in its order."""
        parameters = [
            EffectParameter(
                *(getattr(r, n).decode() for n in ("effect", "name", "setting", "unit", "text")),
                strength=r.strength > 0,
                sign=r.sign,
                default=r.default,
                low=r.low,
                high=r.high,
                typical=(r.typical_low, r.typical_high),
                negligible=r.negligible,
                given=r.strength < 0,
            )
            for r in self._read_table("tse_describe_effect_parameters", _CEffectParameter)
        ]
        return {
            r.id.decode(): EffectRow(
                id=r.id.decode(),
                hook=r.hook.decode(),
                title=r.title.decode(),
                entry_points=tuple(r.entry.decode().split(", ")),
                channels=r.channels.decode(),
                look_alikes=tuple(r.alike.decode().split(", ")),
                estimator=r.estimator.decode(),
                bit=r.bit,
                filter=r.filter.decode(),
                occurrence=r.occurrence.decode(),
                early=r.early.decode(),
                early_below=r.early_below,
                parameters=tuple(p for p in parameters if p.effect == r.id.decode()),
            )
            for r in self._read_table("tse_describe_effects", _CEffect)
        }

    def function(self, name: str, restype: Any = ctypes.c_int, argtypes: list | None = None) -> Any:
        """Return a function of the library; `argtypes` None: only pointers."""
        f = getattr(self._dll, name + self._suffix)
        f.restype = restype
        if argtypes is None:
            argtypes = [ctypes.c_void_p] * {
                "tse_step": 4,
                "tse_sim_reset": 4,
                "tse_prepare": 3,
                "tse_sim_step": 3,
            }.get(name, 1)
        f.argtypes = argtypes
        return f

    def fields(self, which: int) -> list[Field]:
        """Return the rows of a table."""
        return self._fields[which]

    def field(self, which: int, name: str) -> Field:
        """Return one row of a table by its name."""
        return next(f for f in self._fields[which] if f.name == name)

    @functools.cache  # noqa: B019  (few libraries per process)
    def dtype(self, which: int) -> np.dtype:
        """Return the layout of a struct as a dtype of numpy."""
        kinds = {"s": self.real, "r": self.real, "i": np.dtype(np.int32), "u": np.dtype(np.uint32)}
        kinds["p"] = kinds["o"] = np.dtype(np.uintp)
        rows = self._fields[which]
        return np.dtype(
            {
                "names": [f.name for f in rows],
                "formats": [kinds[f.kind] for f in rows],
                "offsets": [f.offset for f in rows],
                "itemsize": self._sizes[which],
            }
        )

    def native(self, values: np.ndarray, which: int | None = None) -> np.ndarray:
        """Convert numbers, or records of struct `which`, to the library's number format.

        A fixed-point library receives a new array: NaN becomes its NaN, numbers beyond
        the range become the nearest limit. Settings are rounded to single precision first
        (TSE_S in tse/real.h). Other libraries receive `values` itself."""
        if not self.fraction_bits:
            return values
        if which is None:
            return _to_fixed(values, self.fraction_bits)
        records = np.ascontiguousarray(values).copy()
        words, raw = records.view(np.float64), records.view(np.int64)
        for kind in "sr":
            at = self._columns(which, kind)
            numbers = words.reshape(len(records), -1)[:, at]
            raw.reshape(len(records), -1)[:, at] = _to_fixed(
                numbers.astype(np.float32).astype(float) if kind == "s" else numbers, self.fraction_bits
            )
        return records

    def from_native(self, native: np.ndarray, values: np.ndarray, which: int | None = None) -> None:
        """Convert `native`, which the library has written, back into `values`."""
        if not self.fraction_bits:  # native is values
            return
        if which is None:
            values[:] = _from_fixed(native, self.fraction_bits)
            return
        values[:] = native
        raw = np.ascontiguousarray(native).view(np.int64).reshape(len(native), -1)
        names = [f.name for f in self._fields[which]]
        kinds = [f.kind for f in self._fields[which]]
        for name, kind in zip(names, kinds, strict=True):
            if kind in "sr":
                numbers = _from_fixed(raw[:, self.dtype(which).fields[name][1] // 8], self.fraction_bits)
                values[name] = [float(str(x)) for x in numbers.astype(np.float32)] if kind == "s" else numbers

    @functools.cache  # noqa: B019  (few libraries per process)
    def _columns(self, which: int, kind: str) -> list[int]:
        """Return offsets of the settings or reals of a struct, in words of 8 bytes."""
        return [f.offset // 8 for f in self._fields[which] if f.kind == kind]

    def codes(self, which: int) -> dict[int, Field]:
        """Return the rows of STATUS or REASON by their code."""
        return {f.offset: f for f in self._fields[which]}

    def status(self, name: str) -> int:
        """Return the code of a status by its name."""
        return self.field(STATUS, name).offset

    @property
    def channels(self) -> list[Field]:
        """Channels of a log row, in their order."""
        names = [f.name for f in self._fields[INPUT]]
        return self._fields[INPUT][1 : names.index("missing")]

    @property
    def optional(self) -> list[Field]:
        """Optional channels of a log row, in the order of their bits in `given`."""
        names = [f.name for f in self._fields[INPUT]]
        return self._fields[INPUT][names.index("given") + 1 :]


FIXED_NAN = np.iinfo(np.int64).min  # the NaN of number/fixed.h
MAX_SCALED = 2.0**60  # limit of converted numbers; larger than every result


def _to_fixed(values: np.ndarray, bits: int) -> np.ndarray:
    """Convert numbers to fixed point with `bits` fraction bits."""
    numbers = np.asarray(values, float)
    with np.errstate(invalid="ignore", over="ignore"):
        scaled = np.clip(np.rint(numbers * 2.0**bits), -MAX_SCALED, MAX_SCALED)
        return np.where(np.isnan(numbers), FIXED_NAN, np.nan_to_num(scaled).astype(np.int64))


def _from_fixed(raw: np.ndarray, bits: int) -> np.ndarray:
    """Convert fixed point with `bits` fraction bits to numbers."""
    return np.where(raw == FIXED_NAN, np.nan, raw / 2.0**bits)


@functools.lru_cache(maxsize=1)
def library() -> Library:
    """Return the library; load it at the first call."""
    return Library(find_library())


@functools.lru_cache(maxsize=1)
def hash_library() -> str:
    """Return the hash of the bytes of the library that this process has loaded."""
    return hashlib.sha256(library().path.read_bytes()).hexdigest()


class Settings:
    """A settings struct of the library, with an attribute per setting.

    Each assignment is checked against the range of the setting."""

    _which: int = CONFIG
    _defaults: str = "tse_config_default"

    def __init__(self, values: Mapping[str, float] | None = None, lib: Library | None = None):
        object.__setattr__(self, "_lib", lib)
        lib = self.lib
        record = np.zeros(1, lib.dtype(self._which))
        object.__setattr__(self, "_record", record)
        self.fill(self._defaults)
        object.__setattr__(self, "_table", {f.name: f for f in lib.fields(self._which)})
        for name, value in (values or {}).items():
            self.set(name, value)

    @property
    def lib(self) -> Library:
        """The library whose settings these are."""
        return self._lib or library()

    @property
    def fields(self) -> dict[str, Field]:
        """Rows of the table of settings, by name."""
        return self._table

    def fill(self, function: str) -> None:
        """Let a function of the library write the settings."""
        native = self.lib.native(self._record, self._which)
        self.lib.function(function, None)(native.ctypes.data)
        self.lib.from_native(native, self._record, self._which)

    @property
    def address(self) -> int:
        """Address of the settings for the library, valid until the next read of it."""
        object.__setattr__(self, "_native", self.lib.native(self._record, self._which))
        return self._native.ctypes.data

    def __getattr__(self, name: str) -> float | int:
        if name.startswith("_") or name not in self._table:
            raise AttributeError(name)
        value = self._record[name][0]
        # a setting 0.01 in single precision is returned as 0.01, not as 0.00999999977
        return value.item() if value.dtype != np.float32 else float(str(value))

    def __setattr__(self, name: str, value: float) -> None:
        self.set(name, value)

    def __contains__(self, name: str) -> bool:
        return name in self._table

    def set(self, name: str, value: float, source: str = "") -> None:
        """Set one value. `source` (a file, an option) begins the message of a refusal."""
        where = f"{source}: " if source else ""
        field = self._table.get(name)
        if field is None:
            hint = suggest_names(name, self._table, other=ALL_SETTINGS_HINT)
            raise UnknownSetting(f"{where}there is no setting '{name}'{hint}")
        kind = "a whole number" if field.is_integer else "a number"
        number = isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)
        if not number or not math.isfinite(value) or (field.is_integer and value != int(value)):
            raise SettingError(f"{where}{name} = {value!r} is not {kind}; allowed: {field.range_text}")
        if not field.low <= value <= field.high and value != field.default:
            raise SettingError(
                f"{where}{name} = {value:g} is outside its range {field.range_text} ({field.text})"
            )
        self._record[name] = value

    def as_dict(self) -> dict[str, float | int]:
        """Return all settings by name."""
        return {name: getattr(self, name) for name in self._table}

    def changed(self) -> dict[str, float | int]:
        """Return the settings that differ from the defaults."""
        default = type(self)(lib=self._lib)
        return {name: value for name, value in self.as_dict().items() if value != getattr(default, name)}


class Config(Settings):
    """tse_config: vehicle, sensors, filter.

    The default is an ordinary car without its mass."""

    @classmethod
    def exact(cls, values: Mapping[str, float] | None = None, lib: Library | None = None) -> Config:
        """Return an exactly known car, as the simulator's, with `values` set."""
        config = cls(lib=lib)
        config.fill("tse_config_exact")
        for name, value in (values or {}).items():
            config.set(name, value)
        return config

    def complete(self) -> Config:
        """Return a copy with the filter's values for unset mass, inertia, stiffness."""
        config = type(self)(self.as_dict(), lib=self._lib)
        config.fill("tse_config_complete")
        return config

    @classmethod
    def settings_of(cls, name: str) -> dict[str, float | int]:
        """Return the settings in which tse_config_NAME() differs from the defaults."""
        config = cls()
        config.fill(f"tse_config_{name}")
        return config.changed()


class SimConfig(Settings):
    """tse_sim_config: settings of the simulator beyond Config."""

    _which = SIM_CONFIG
    _defaults = "tse_sim_config_default"


def _raise_refusal(status: int, wrong: ctypes.c_char_p, settings: tuple[Settings, ...]) -> None:
    """Raise a SettingError for a negative status.

    `wrong`: name of the refused setting."""
    if status >= 0:
        return
    name = wrong.value.decode() if wrong.value else ""
    for group in settings:
        if name in group:
            f, value = group.fields[name], getattr(group, name)
            if value == f.default:
                raise SettingError(
                    f"{name} follows from mass, lf and lr, and is outside its range {f.range_text} ({f.text})"
                )
            raise SettingError(f"{name} = {value:g} is refused; allowed: {f.range_text} ({f.text})")
    row = settings[0].lib.codes(STATUS).get(status)
    raise SettingError(f"settings refused: {row.text if row else status}{f' ({name})' if name else ''}")


def _allocate(size: int) -> np.ndarray:
    """Return zeroed memory of at least `size` bytes, aligned to eight bytes."""
    return np.zeros((size + 7) // 8, np.uint64)


class LearntError(UserError):
    """Bytes that cannot be loaded as the filter's learnt state.

    The text is the library's."""


class NativeFilter:
    """One estimator of the library. It starts at its first row."""

    def __init__(self, config: Config):
        self.lib = lib = config.lib
        self.config = config
        particles = "form" in config and config.form  # the default filter has no particles
        self._bytes = lib.filter_paper_bytes if particles else lib.filter_bytes
        self._params, self._filter = _allocate(lib.params_bytes), _allocate(self._bytes)
        wrong = ctypes.c_char_p()
        status = lib.function("tse_prepare")(
            config.address, self._params.ctypes.data, ctypes.addressof(wrong)
        )
        _raise_refusal(status, wrong, (config,))
        self._step = lib.function("tse_step")
        self._pointers = self._params.ctypes.data, self._filter.ctypes.data
        self.reset()

    def reset(self) -> None:
        """Return to the state before the first row."""
        reset = self.lib.function("tse_reset", argtypes=[ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t])
        status = reset(*self._pointers, self._bytes)
        if status < 0:
            raise RuntimeError(f"tse_reset refused: {self.lib.codes(STATUS)[status].text}")

    def step_into(
        self, rows: np.ndarray, outputs: np.ndarray, first: int = 0, last: int | None = None
    ) -> None:
        """Feed rows[first:last], write outputs[first:last].

        Of a refused row only `status` is written."""
        last = len(rows) if last is None else last
        step, (params, state) = self._step, self._pointers
        given, made = self.lib.native(rows[first:last], INPUT), self.lib.native(outputs[first:last], OUTPUT)
        u, du = given.ctypes.data, given.strides[0]
        y, dy = made.ctypes.data, made.strides[0]
        for i in range(last - first):
            status = step(params, state, u + i * du, y + i * dy)
            if status < 0:
                made["status"][i] = status
        self.lib.from_native(made, outputs[first:last], OUTPUT)

    def step_one(self, rows: np.ndarray, outputs: np.ndarray) -> int:
        """Feed rows[0], write outputs[0], return the status.

        A negative status: the row is refused, and the output is unchanged."""
        return int(self._step(*self._pointers, rows.ctypes.data, outputs.ctypes.data))

    def estimate_rows(self, rows: np.ndarray) -> np.ndarray:
        """Feed rows of any number format; return their outputs."""
        given, out = self.inputs(len(rows)), self.outputs(len(rows))
        for name in given.dtype.names:
            given[name] = rows[name]
        self.step_into(given, out)
        return out

    def inputs(self, n: int) -> np.ndarray:
        """Return n zeroed rows."""
        return np.zeros(n, self.lib.dtype(INPUT))

    def outputs(self, n: int) -> np.ndarray:
        """Return n outputs; their real numbers are NaN."""
        out = np.zeros(n, self.lib.dtype(OUTPUT))
        for name in out.dtype.names:
            if out.dtype[name].kind == "f":
                out[name] = np.nan
        return out

    def snapshot(self) -> bytes:
        """Return the state of the filter as bytes."""
        return self._filter.tobytes()[: self._bytes]

    def uncertainty_sd(self) -> dict[str, np.ndarray]:
        """Return the share of each uncertain setting in the sd of the three stiffnesses.

        Settings are those of src/tables/uncertainty.toml. The sd is relative to the
        nominal stiffness and holds for the last row. The filter with particles has none:
        {}."""
        types = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int32, ctypes.c_void_p]
        sd: dict[str, np.ndarray] = {}
        for k, name in enumerate(self.lib.uncertainties):
            part_of = self.lib.function("tse_uncertainty_sd", argtypes=types)
            out = np.zeros(3, self.lib.real)
            made = self.lib.native(out)
            if part_of(*self._pointers, k, made.ctypes.data) >= 0:
                self.lib.from_native(made, out)
                sd[name] = out.astype(float)
        return sd

    def save_learnt(self) -> bytes | None:
        """Return the learnt state for the next drive; None before the first row."""
        out = np.zeros(self.lib.learnt_bytes, np.uint8)
        save = self.lib.function("tse_learnt_save", argtypes=[ctypes.c_void_p] * 3)
        return out.tobytes() if save(*self._pointers, out.ctypes.data) >= 0 else None

    def load_learnt(self, learnt: bytes, age: float) -> None:
        """Start from the learnt state of an earlier drive, saved `age` seconds ago.

        To be called before the first row."""
        if not isinstance(learnt, bytes | bytearray | memoryview):
            raise TypeError(
                "learnt: bytes are needed, as save_learnt() and Result.learnt give them, not "
                f"{type(learnt).__name__}"
            )
        if math.isnan(age):
            raise LearntError("age is NaN; allowed: 0 s or more")
        data = np.frombuffer(learnt, np.uint8) if learnt else np.zeros(1, np.uint8)
        types = [ctypes.c_void_p] * 3 + [ctypes.c_size_t, ctypes.c_uint32]
        load = self.lib.function("tse_learnt_load", argtypes=types)
        status = load(*self._pointers, data.ctypes.data, len(learnt), int(min(max(age, 0), 2**32 - 1)))
        if status < 0:
            wrong = ctypes.c_char_p()
            types = [ctypes.c_void_p] * 2 + [ctypes.c_size_t, ctypes.c_void_p]
            check = self.lib.function("tse_learnt_check", argtypes=types)
            check(self._pointers[0], data.ctypes.data, len(learnt), ctypes.addressof(wrong))
            detail = f" ({wrong.value.decode()})" if wrong.value else ""
            raise LearntError(self.lib.codes(STATUS)[status].text + detail)

    def restore(self, snapshot: bytes) -> None:
        """Return to the state of a snapshot."""
        if len(snapshot) != self._bytes:
            raise ValueError(f"a snapshot of this filter has {self._bytes} bytes, not {len(snapshot)}")
        self._filter.view(np.uint8)[: len(snapshot)] = np.frombuffer(snapshot, np.uint8)


class Simulator:
    """The simulator of the library: true motion and measurements of a car."""

    def __init__(self, config: Config, sim_config: SimConfig):
        self.lib = lib = library()
        if not lib.sim_bytes:
            raise UserError(f"{lib.path}: this build of the library has no simulator")
        self._sim = _allocate(lib.sim_bytes)
        wrong = ctypes.c_char_p()
        status = lib.function("tse_sim_reset")(
            self._sim.ctypes.data, config.address, sim_config.address, ctypes.addressof(wrong)
        )
        _raise_refusal(status, wrong, (sim_config, config))
        self._step = lib.function("tse_sim_step")

    def step_into(self, inputs: np.ndarray, outputs: np.ndarray, i: int) -> None:
        """Simulate one row: read inputs[i], write outputs[i]."""
        given = self.lib.native(inputs[i : i + 1], SIM_INPUT)
        made = self.lib.native(outputs[i : i + 1], SIM_OUTPUT)
        status = self._step(self._sim.ctypes.data, given.ctypes.data, made.ctypes.data)
        if status < 0:
            raise UserError(f"the simulator refused row {i + 1}: {self.lib.codes(STATUS)[status].text}")
        self.lib.from_native(made, outputs[i : i + 1], SIM_OUTPUT)

    def inputs(self, n: int) -> np.ndarray:
        """Return n zeroed inputs."""
        return np.zeros(n, self.lib.dtype(SIM_INPUT))

    def outputs(self, n: int) -> np.ndarray:
        """Return n zeroed outputs."""
        return np.zeros(n, self.lib.dtype(SIM_OUTPUT))


class Replay:
    """The model, driven by steering angle and wheel speeds of a log.

    It predicts the other channels, without noise, with the effects that Config switches
    on. For fits: a row without effects takes about 0.1 us.

    Parameters
    ----------
    outputs : sequence of str
        Channels to compute, names of REPLAY_OUT.
    **log : array_like, (rows,)
        Columns of the log, names of REPLAY_LOG. Optional ones may be None, or follow by
        set().
    """

    def __init__(self, outputs: Sequence[str] = ("accel_x", "accel_y", "yaw_rate"), **log: Any):
        self.lib = lib = library()
        if not lib.fields(REPLAY_LOG):
            raise UserError(f"{lib.path}: this build of the library has no replay")
        self.rows = len(log["dt"])
        self._arrays: dict[str, np.ndarray] = {}
        self._log = np.zeros(1, lib.dtype(REPLAY_LOG))
        self._out = np.zeros(1, lib.dtype(REPLAY_OUT))
        self._start = np.zeros(1, lib.dtype(REPLAY_START))
        self.outputs = {name: np.zeros(self.rows, lib.real) for name in outputs}
        self._made = {name: lib.native(array) for name, array in self.outputs.items()}
        for name, array in self._made.items():
            self._out[name] = array.ctypes.data
        for name, values in log.items():
            self.set(name, values)
        for f in lib.fields(REPLAY_LOG):
            if f.kind == "p" and not self._log[f.name][0]:
                raise ValueError(f"{f.name} is needed: {f.text}")
        self._params = _allocate(lib.params_bytes)
        self._prepare = lib.function("tse_prepare")
        self._replay = lib.function(
            "tse_replay", argtypes=[ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int32] + [ctypes.c_void_p] * 3
        )
        self._defaults = lib.function("tse_replay_start_default", None)

    def set(self, name: str, values: Any) -> None:
        """Set a column of the log (a road's profile, a disturbance); None removes it."""
        if values is None:
            self._log[name] = 0
            return
        array = self.lib.native(np.ascontiguousarray(values, self.lib.real))
        if array.shape != (self.rows,):
            raise ValueError(f"{name} has shape {array.shape}, not ({self.rows},)")
        self._arrays[name] = array
        self._log[name] = array.ctypes.data

    def run(self, config: Config, **start: float) -> dict[str, np.ndarray]:
        """Run the log.

        Parameters
        ----------
        config : Config
            The car and its effects.
        **start : float
            Initial state, names of REPLAY_START. The others have the library's defaults.

        Returns
        -------
        dict of str to ndarray, (rows,)
            The channels `outputs`. The next run overwrites these arrays.
        """
        wrong = ctypes.c_char_p()
        status = self._prepare(config.address, self._params.ctypes.data, ctypes.addressof(wrong))
        _raise_refusal(status, wrong, (config,))
        begin = self.lib.native(self._start, REPLAY_START)
        self._defaults(begin.ctypes.data)
        self.lib.from_native(begin, self._start, REPLAY_START)
        for name, value in start.items():
            self._start[name] = value
        begin = self.lib.native(self._start, REPLAY_START)
        row = ctypes.c_int32()
        status = self._replay(
            self._params.ctypes.data,
            self._log.ctypes.data,
            self.rows,
            begin.ctypes.data,
            self._out.ctypes.data,
            ctypes.addressof(row),
        )
        if status < 0:
            raise UserError(f"replay refused row {row.value + 1}: {self.lib.codes(STATUS)[status].text}")
        for name, array in self.outputs.items():
            self.lib.from_native(self._made[name], array)
        return self.outputs


def convert_stiffness(config: Config, output: np.void) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return mean, sd and spread of the stiffnesses of one output, N and N/rad."""
    lib = library()
    record = lib.native(np.array([output], lib.dtype(OUTPUT)), OUTPUT)
    si = [np.zeros(3, lib.real) for _ in range(3)]
    made = [lib.native(a) for a in si]
    lib.function("tse_stiffness_si", None, [ctypes.c_void_p] * 5)(
        config.address, record.ctypes.data, *(a.ctypes.data for a in made)
    )
    for native, values in zip(made, si, strict=True):
        lib.from_native(native, values)
    return si[0], si[1], si[2]
