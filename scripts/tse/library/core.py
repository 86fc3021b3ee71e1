"""Binding of the C library.

Names, ranges, units and struct layouts are read from the loaded library (functions of
tse/describe.h), so that this file repeats none of its tables."""

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
# names of the stiffnesses, in the order of the C constants TSE_CX_FRONT, TSE_CY_FRONT,
# TSE_CY_REAR
STIFFNESS = ("cx_front", "cy_front", "cy_rear")
ALL_SETTINGS_HINT = "; 'tselab settings' lists all"
GRIP = "grip"  # name of an output that, like each stiffness, has its own validity (grip_valid)
# Key: stiffness. Value: setting with its nominal value. The library returns estimates as
# ratios to the nominal value
NOMINAL = {
    "cx_front": "longitudinal_stiffness_front",
    "cy_front": "cornering_stiffness_front",
    "cy_rear": "cornering_stiffness_rear",
}


class SettingError(UserError):
    """A setting is outside its range. The message names setting, value and range."""


class UnknownSetting(SettingError, KeyError):
    """There is no setting of this name. The message suggests similar names."""

    __str__ = Exception.__str__


@dataclass(frozen=True)
class Field:
    """One field of a struct of the library, or one row of a list (STATUS, REASON or
    FORMULA_...). Both are described by struct tse_field of tse/describe.h."""

    name: str
    # s: setting (tse_setting), r: tse_real, i: int32, u: uint32, p: pointer to an array,
    # o: pointer to an array or NULL. Row of a list: c. Row of the list FORMULA_OP: n, s,
    # p or m, for NUMBER, SIGNAL, PLAIN or MEMORY (FormulaOp.kind)
    kind: str
    offset: int  # [bytes] from the start of the struct. Row of a list: its code; FORMULA_LIMIT: the limit
    default: float
    low: float
    high: float
    unit: str
    text: str

    @property
    def has_range(self) -> bool:
        """True if the library limits the value to a range, `low` to `high`."""
        return self.high >= self.low

    @property
    def is_integer(self) -> bool:
        """True for integer fields."""
        return self.kind in "iu"

    @property
    def range_text(self) -> str:
        """Allowed range with unit, as messages print it."""
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
    # True: the parameter is a strength, whose value 0 switches the effect off. False: it
    # is a shape, which has no influence while all strengths of the effect are 0
    strength: bool
    sign: int  # plausible sign of a strength: 1, -1, or 0 if both are plausible
    default: float
    low: float
    high: float
    typical: tuple[float, float]
    negligible: float  # absolute value below which the effect is not reported
    # True: the parameter is a shape that logs cannot distinguish from the strength. No
    # fit estimates it
    given: bool = False


@dataclass(frozen=True)
class EffectRow:
    """One row of src/tables/effects.toml."""

    id: str
    hook: str  # place in the model at which the function of the effect is called: INPUT, LAG, ...
    title: str
    entry_points: tuple[str, ...]  # parts of the model that the effect changes
    channels: str  # channels in which the effect is visible, and when
    look_alikes: tuple[str, ...]  # causes with a similar influence on the channels: ids or descriptions
    estimator: str  # description of how the filters use the effect
    bit: int  # number of its bit in tse_effects.mask
    # filters whose estimate depends on the settings of the effect: "default" (only the
    # default filter), "both" (also the particle filter), "none"
    filter: str
    # class of the effect, from which its prior probability follows: SENSOR, EVERY_CAR,
    # SOME_CARS, ROAD, ABSORBED or IN_MODEL, defined at the top of src/tables/effects.toml
    occurrence: str
    # title used instead of `title` if a fitted strength is below `early_below`, which has
    # a different cause; "": none. Example: a negative delay of the IMU means that the
    # other channels are logged late
    early: str
    early_below: float
    parameters: tuple[EffectParameter, ...]

    @property
    def strengths(self) -> tuple[EffectParameter, ...]:
        """Parameters that are strengths: the effect is off while all of them are 0."""
        return tuple(p for p in self.parameters if p.strength)

    @property
    def shapes(self) -> tuple[EffectParameter, ...]:
        """Parameters that are shapes: without effect while all strengths are 0."""
        return tuple(p for p in self.parameters if not p.strength)


@dataclass(frozen=True)
class SettingUse:
    """How the filters use one setting of Config."""

    table: str  # table of src/tables that defines it: vehicle, uncertainty, sensors, ...
    # filters whose estimate depends on the setting: "default" (only the default filter),
    # "paper" (only the particle filter), "both", "none"
    filter: str
    # name of a second setting. If the second setting is not 0, the filters use the second
    # setting instead of this one. "": there is no second setting
    replaced_by: str


@dataclass(frozen=True)
class FormulaOp:
    """One operation of src/tables/formula.toml."""

    name: str
    code: int
    takes: int  # number of operands
    # NUMBER: a number of the formula, SIGNAL: a signal of the model, PLAIN: a function of
    # the operands, MEMORY: a function that also depends on earlier values of the operands
    kind: str
    # unit of the result and of all operands, or a rule for the unit of the result:
    # same: that of the operands, which must agree; first: that of the first operand;
    # rate: that of the operand, per s; product, quotient, root: the product, quotient or
    # square root of the operands' units
    unit: str
    text: str


class _CEffect(ctypes.Structure):
    """Layout of struct tse_effect_row in tse/describe.h."""

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
    """Layout of struct tse_setting_row in tse/describe.h."""

    _fields_ = [(name, ctypes.c_char_p) for name in ("name", "table", "filter", "replaced_by")]


class _CEffectParameter(ctypes.Structure):
    """Layout of struct tse_effect_parameter in tse/describe.h."""

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
    """Layout of struct tse_field in tse/describe.h."""

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
    """Layout of struct tse_build in tse/describe.h."""

    _fields_ = [
        ("version", ctypes.c_char_p),
        ("format", ctypes.c_char_p),
        ("capacity", ctypes.c_int32),
        ("filter_bytes", ctypes.c_int32),
        ("params_bytes", ctypes.c_int32),
        ("sim_bytes", ctypes.c_int32),
        ("learnt_bytes", ctypes.c_int32),
        # [bytes] size of a filter with particles; filter_bytes: size without particles
        ("filter_paper_bytes", ctypes.c_int32),
        # fraction bits of a fixed-point number; 0: the library uses floating point
        ("fraction_bits", ctypes.c_int32),
    ]


def find_library() -> Path:
    """Return the path of the library. It is the value of the environment variable
    TSELAB_LIBRARY or, if that is not set, a file in folder lib next to this module."""
    if named := os.environ.get("TSELAB_LIBRARY"):
        return Path(named)
    suffix = {"darwin": "dylib", "win32": "dll"}.get(sys.platform, "so")
    return Path(__file__).parent / "lib" / f"libtse.{suffix}"


class Library:
    """The loaded library: its functions, tables and struct layouts."""

    def __init__(self, path: Path):
        if not path.is_file():
            raise UserError(
                f"there is no tse library at {path}: run scripts/setup.sh, or set TSELAB_LIBRARY to "
                "the path of the shared library"
            )
        try:
            self._dll = ctypes.CDLL(str(path))
        except OSError as error:
            raise UserError(f"{path}: cannot be loaded as a library: {error}") from None
        self.path = path
        # For a library with fixed-point numbers, Python computes with doubles. native()
        # and from_native() convert between the two
        for suffix, real in (("_f64", np.float64), ("_f32", np.float32), ("_fix", np.float64)):
            if hasattr(self._dll, "tse_step" + suffix):
                self._suffix = suffix
                self.real = np.dtype(real)
                break
        else:
            raise UserError(
                f"{path}: is not a tse library: it has no function tse_step_f64, tse_step_f32 or tse_step_fix"
            )
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
        """Read version, number format and struct sizes of the loaded library."""
        build = _CBuild()
        self.function("tse_describe_build", None)(ctypes.addressof(build))
        self.version, self.format = build.version.decode(), build.format.decode()
        self.capacity = build.capacity
        self.filter_bytes, self.filter_paper_bytes = build.filter_bytes, build.filter_paper_bytes
        self.params_bytes, self.sim_bytes = build.params_bytes, build.sim_bytes
        self.learnt_bytes = build.learnt_bytes
        self.fraction_bits = build.fraction_bits

    def _read_fields(self) -> None:
        """Read the fields of every struct, and the lists of codes."""
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
        """Return the rows of the table that a tse_describe function returns.

        Parameters
        ----------
        function : str
            Name of the function, for example "tse_describe_effects".
        row : type
            Layout of a row, a subclass of ctypes.Structure.
        """
        count = ctypes.c_int32()
        rows = self.function(function, ctypes.POINTER(row))(ctypes.addressof(count))
        return [rows[i] for i in range(count.value)]

    def _read_settings(self) -> dict[str, SettingUse]:
        """Return how the filters use each setting, in the order of Config."""
        return {
            r.name.decode(): SettingUse(r.table.decode(), r.filter.decode(), r.replaced_by.decode())
            for r in self._read_table("tse_describe_settings", _CSettingRow)
        }

    def settings_in(self, *tables: str) -> tuple[str, ...]:
        """Return the settings of these tables of src/tables, in the order of Config."""
        return tuple(name for name, use in self.settings.items() if use.table in tables)

    def _read_effects(self) -> dict[str, EffectRow]:
        """Return the effects by id, in the order of src/tables/effects.toml."""
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
        """Return a function of the library.

        Parameters
        ----------
        name : str
            Name without the suffix _f64, _f32 or _fix of the number format.
        restype
            ctypes type of the result.
        argtypes : list, optional
            ctypes types of the arguments. None: all arguments are pointers.
        """
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
        """Return the fields of a struct (`which` is CONFIG .. SIM_OUTPUT or REPLAY_...),
        or the rows of a list (`which` is STATUS, REASON or FORMULA_...)."""
        return self._fields[which]

    def field(self, which: int, name: str) -> Field:
        """Return the field `name` of a struct, or the row `name` of a list."""
        return next(f for f in self._fields[which] if f.name == name)

    @functools.cache  # noqa: B019  (a process loads few libraries, so that the cache stays small)
    def dtype(self, which: int) -> np.dtype:
        """Return the layout of struct `which` as a numpy dtype."""
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

        For a floating-point library, return `values` itself. For a fixed-point library,
        return a new array: NaN becomes the integer FIXED_NAN, and numbers are clipped
        (MAX_SCALED). Settings are first rounded to single precision, as macro TSE_S of
        tse/real.h does, so that they are equal in all number formats."""
        if not self.fraction_bits:
            return values
        if which is None:
            return _to_fixed(values, self.fraction_bits)
        records = np.ascontiguousarray(values).copy()
        words, raw = records.view(np.float64), records.view(np.int64)
        for kind in "sr":
            at = self._list_offsets(which, kind)
            numbers = words.reshape(len(records), -1)[:, at]
            raw.reshape(len(records), -1)[:, at] = _to_fixed(
                numbers.astype(np.float32).astype(float) if kind == "s" else numbers, self.fraction_bits
            )
        return records

    def from_native(self, native: np.ndarray, values: np.ndarray, which: int | None = None) -> None:
        """Convert `native`, the array that the library has written, and store the numbers
        in `values`."""
        if not self.fraction_bits:  # native() returned `values` itself
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

    @functools.cache  # noqa: B019  (a process loads few libraries, so that the cache stays small)
    def _list_offsets(self, which: int, kind: str) -> list[int]:
        """Return the offsets, in units of 8 bytes, of the fields of this kind in struct
        `which`."""
        return [f.offset // 8 for f in self._fields[which] if f.kind == kind]

    def codes(self, which: int) -> dict[int, Field]:
        """Return the rows of list `which` (STATUS or REASON), with codes as keys."""
        return {f.offset: f for f in self._fields[which]}

    def status(self, name: str) -> int:
        """Return the code of the status with this name."""
        return self.field(STATUS, name).offset

    @property
    def channels(self) -> list[Field]:
        """Fields of tse_input for the required channels of a row, in their order."""
        names = [f.name for f in self._fields[INPUT]]
        return self._fields[INPUT][1 : names.index("missing")]

    @property
    def optional(self) -> list[Field]:
        """Fields of tse_input for optional channels, in the order of their bits in
        `given`, the mask of the channels that a row has."""
        names = [f.name for f in self._fields[INPUT]]
        return self._fields[INPUT][names.index("given") + 1 :]


FIXED_NAN = np.iinfo(np.int64).min  # code of NaN in src/number/fixed.h
MAX_SCALED = 2.0**60  # max |number * 2^bits| in a conversion; every result of the library is smaller


def _to_fixed(values: np.ndarray, bits: int) -> np.ndarray:
    """Return numbers as fixed-point integers with `bits` fraction bits."""
    numbers = np.asarray(values, float)
    with np.errstate(invalid="ignore", over="ignore"):
        scaled = np.clip(np.rint(numbers * 2.0**bits), -MAX_SCALED, MAX_SCALED)
        return np.where(np.isnan(numbers), FIXED_NAN, np.nan_to_num(scaled).astype(np.int64))


def _from_fixed(raw: np.ndarray, bits: int) -> np.ndarray:
    """Return the values of fixed-point integers with `bits` fraction bits."""
    return np.where(raw == FIXED_NAN, np.nan, raw / 2.0**bits)


@functools.lru_cache(maxsize=1)
def library() -> Library:
    """Return the library of this process. The first call loads the library."""
    return Library(find_library())


@functools.lru_cache(maxsize=1)
def hash_library() -> str:
    """Return the SHA-256 of the file of the library that this process has loaded."""
    return hashlib.sha256(library().path.read_bytes()).hexdigest()


class Settings:
    """A struct of settings of the library, with one attribute for each setting.

    An assignment outside the range of the setting raises SettingError."""

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
        """The library that defines the struct and its ranges."""
        return self._lib or library()

    @property
    def fields(self) -> dict[str, Field]:
        """Description of each setting, with the name as key."""
        return self._table

    def fill(self, function: str) -> None:
        """Let a function of the library, such as tse_config_default, set all values."""
        native = self.lib.native(self._record, self._which)
        self.lib.function(function, None)(native.ctypes.data)
        self.lib.from_native(native, self._record, self._which)

    @property
    def address(self) -> int:
        """Address of the struct in the library's number format.

        For a fixed-point library, it is the address of a converted copy. Each read of
        this property makes a new copy, so an address is valid only until the next
        read."""
        object.__setattr__(self, "_native", self.lib.native(self._record, self._which))
        return self._native.ctypes.data

    def __getattr__(self, name: str) -> float | int:
        if name.startswith("_") or name not in self._table:
            raise AttributeError(name)
        value = self._record[name][0]
        # shortest decimal number: a float32 of 0.01 becomes 0.01, not 0.00999999977
        return value.item() if value.dtype != np.float32 else float(str(value))

    def __setattr__(self, name: str, value: float) -> None:
        self.set(name, value)

    def __contains__(self, name: str) -> bool:
        return name in self._table

    def set(self, name: str, value: float, source: str = "") -> None:
        """Set one value. An error message begins with `source`, a file or an option."""
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
    """Settings of vehicle, sensors and filter: struct tse_config.

    Defaults are those of an ordinary car. The mass has no default."""

    @classmethod
    def exact(cls, values: Mapping[str, float] | None = None, lib: Library | None = None) -> Config:
        """Return the settings of tse_config_exact(), changed by `values`.

        In tse_config_exact(), the sds of all uncertain parameters are 0: the car is known
        exactly, as in simulations."""
        config = cls(lib=lib)
        config.fill("tse_config_exact")
        for name, value in (values or {}).items():
            config.set(name, value)
        return config

    def complete(self) -> Config:
        """Return a copy in which a mass, yaw inertia or stiffness that is not set (0) has
        the filter's value. Example: 1500 kg for the mass."""
        config = type(self)(self.as_dict(), lib=self._lib)
        config.fill("tse_config_complete")
        return config

    @classmethod
    def settings_of(cls, name: str) -> dict[str, float | int]:
        """Return the settings whose values in tse_config_<name>() are not the
        defaults."""
        config = cls()
        config.fill(f"tse_config_{name}")
        return config.changed()


class SimConfig(Settings):
    """Settings that only the simulator has: struct tse_sim_config."""

    _which = SIM_CONFIG
    _defaults = "tse_sim_config_default"


def _raise_refusal(status: int, wrong: ctypes.c_char_p, settings: tuple[Settings, ...]) -> None:
    """Raise SettingError if a function of the library returned a negative status.

    Parameters
    ----------
    status : int
        Result of the function.
    wrong : ctypes.c_char_p
        Name of the setting that the function refused, or NULL.
    settings : tuple of Settings
        The structs that the function read.
    """
    if status >= 0:
        return
    name = wrong.value.decode() if wrong.value else ""
    for group in settings:
        if name in group:
            f, value = group.fields[name], getattr(group, name)
            if value == f.default:
                # the setting is not set: the library computes it from other settings
                raise SettingError(
                    f"{name} follows from mass, lf and lr, and is outside its range {f.range_text} ({f.text})"
                    f"; correct mass, lf or lr, or set {name}"
                )
            raise SettingError(f"{name} = {value:g} is refused; allowed: {f.range_text} ({f.text})")
    row = settings[0].lib.codes(STATUS).get(status)
    raise SettingError(f"settings refused: {row.text if row else status}{f' ({name})' if name else ''}")


def _allocate(size: int) -> np.ndarray:
    """Return at least `size` bytes of zeroed memory, aligned to 8 bytes."""
    return np.zeros((size + 7) // 8, np.uint64)


class LearntError(UserError):
    """load_learnt() refused the bytes (damaged, of a different vehicle) or the age."""


class NativeFilter:
    """One filter of the library, with its parameters and its state."""

    def __init__(self, config: Config):
        self.lib = lib = config.lib
        self.config = config
        # setting `form`: 0 is the default filter, 1 the paper's filter with particles
        particles = "form" in config and config.form
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
        """Reset the filter to its state before the first row."""
        reset = self.lib.function("tse_reset", argtypes=[ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t])
        status = reset(*self._pointers, self._bytes)
        if status < 0:
            raise RuntimeError(f"tse_reset refused: {self.lib.codes(STATUS)[status].text}")

    def step_into(
        self, rows: np.ndarray, outputs: np.ndarray, first: int = 0, last: int | None = None
    ) -> None:
        """Step the filter with rows[first:last] and write outputs[first:last].

        If the filter refuses a row, only `status` of its output is written."""
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
        """Step the filter with rows[0], write outputs[0], and return the status.

        If the filter refuses the row, the returned status is negative and outputs[0] is
        unchanged, its field `status` included."""
        given, made = self.lib.native(rows[:1], INPUT), self.lib.native(outputs[:1], OUTPUT)
        status = int(self._step(*self._pointers, given.ctypes.data, made.ctypes.data))
        if status >= 0:
            self.lib.from_native(made, outputs[:1], OUTPUT)
        return status

    def estimate_rows(self, rows: np.ndarray) -> np.ndarray:
        """Step the filter with rows of any numeric types; return one output per row."""
        given, out = self.inputs(len(rows)), self.outputs(len(rows))
        for name in given.dtype.names:
            given[name] = rows[name]
        self.step_into(given, out)
        return out

    def inputs(self, n: int) -> np.ndarray:
        """Return n rows of tse_input; all fields are 0."""
        return np.zeros(n, self.lib.dtype(INPUT))

    def outputs(self, n: int) -> np.ndarray:
        """Return n rows of tse_output; real numbers are NaN, integers 0."""
        out = np.zeros(n, self.lib.dtype(OUTPUT))
        for name in out.dtype.names:
            if out.dtype[name].kind == "f":
                out[name] = np.nan
        return out

    def snapshot(self) -> bytes:
        """Return a copy of the filter's memory, for restore()."""
        return self._filter.tobytes()[: self._bytes]

    def uncertainty_sd(self) -> dict[str, np.ndarray]:
        """Return the contribution of each uncertain parameter to stiffness_sd.

        Keys are the settings of src/tables/uncertainty.toml. Values are arrays of three
        sds after the last row, one for each stiffness, relative to the nominal stiffness.
        The filter with particles has none: {}."""
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
        """Return the estimates with which the next drive can start (learnt state); None
        before the first row."""
        out = np.zeros(self.lib.learnt_bytes, np.uint8)
        save = self.lib.function("tse_learnt_save", argtypes=[ctypes.c_void_p] * 3)
        return out.tobytes() if save(*self._pointers, out.ctypes.data) >= 0 else None

    def load_learnt(self, learnt: bytes, age: float) -> None:
        """Let the filter start from the learnt state of an earlier drive.

        Call this before the first row.

        Parameters
        ----------
        learnt : bytes
            Result of save_learnt().
        age : float
            [s] Time since the state was saved.

        Raises
        ------
        LearntError
            The bytes are damaged or belong to a different vehicle, or `age` is NaN.
        """
        if not isinstance(learnt, bytes | bytearray | memoryview):
            raise TypeError(
                "learnt: bytes are needed, as save_learnt() and Result.learnt return them, not "
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
        """Set the filter to the state that snapshot() returned."""
        if len(snapshot) != self._bytes:
            raise ValueError(
                f"snapshot has {len(snapshot)} bytes; a snapshot of this filter has {self._bytes}"
            )
        self._filter.view(np.uint8)[: len(snapshot)] = np.frombuffer(snapshot, np.uint8)


class Simulator:
    """The simulator of the library: it computes true motion and measurements of a car."""

    def __init__(self, config: Config, sim_config: SimConfig):
        self.lib = lib = library()
        if not lib.sim_bytes:
            raise UserError(
                f"{lib.path}: this build of the library has no simulator; build it with the CMake option "
                "TSE_EFFECTS=ON"
            )
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
        """Return n rows of tse_sim_input; all fields are 0."""
        return np.zeros(n, self.lib.dtype(SIM_INPUT))

    def outputs(self, n: int) -> np.ndarray:
        """Return n rows of tse_sim_output; all fields are 0."""
        return np.zeros(n, self.lib.dtype(SIM_OUTPUT))


class Replay:
    """The vehicle model with the steering angle and the wheel speeds of a log as inputs.

    It predicts the other channels, without noise and with the effects that Config
    switches on. It is fast enough for fits: without effects, a row takes about 0.1 us.

    Parameters
    ----------
    outputs : sequence of str
        Channels to compute. Names are those of struct REPLAY_OUT.
    **log : array_like, (rows,)
        Columns of the log. Names are those of struct REPLAY_LOG. An optional column may
        be None, or be set later with set().
    """

    def __init__(self, outputs: Sequence[str] = ("accel_x", "accel_y", "yaw_rate"), **log: Any):
        self.lib = lib = library()
        if not lib.fields(REPLAY_LOG):
            raise UserError(
                f"{lib.path}: this build of the library has no replay; build it with the CMake option "
                "TSE_EFFECTS=ON"
            )
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
        """Set a column of the log, for example the profile of a road. None removes it."""
        if values is None:
            self._log[name] = 0
            return
        array = self.lib.native(np.ascontiguousarray(values, self.lib.real))
        if array.shape != (self.rows,):
            raise ValueError(
                f"{name} has shape {array.shape}; needed: ({self.rows},), one value for each row"
            )
        self._arrays[name] = array
        self._log[name] = array.ctypes.data

    def run(self, config: Config, **start: float) -> dict[str, np.ndarray]:
        """Compute the channels `outputs` for all rows of the log.

        Parameters
        ----------
        config : Config
            The car and its effects.
        **start : float
            Initial states. Names are those of struct REPLAY_START. A state that is not
            given has the library's default.

        Returns
        -------
        dict of str to ndarray, (rows,)
            The computed channels. The next run overwrites these arrays.
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
    """Return stiffness, stiffness_sd and stiffness_spread of one output (tse_output) in N
    (cx_front) and N/rad (cy_front, cy_rear), each with three values in the order of
    STIFFNESS. In the output they are relative to the nominal stiffness."""
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
