"""The filter, row by row."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from tse._tables import CHANNELS, Estimate, Row, Status
from tse._vehicle import VehicleLike, read_vehicle
from tse.car.config import check_effect, make_config, set_sampling
from tse.errors import InputError
from tse.library import core
from tse.library.core import INPUT, NOMINAL, OUTPUT, REASON, STIFFNESS
from tse.library.errors import suggest_names
from tse.log.rows import MAX_ROW_STEP, MIN_ROW_STEP, OPTIONAL_COLUMNS, SIDES

Form: TypeAlias = Literal["default", "robust", "paper"]
UNKNOWN_AGE = math.inf


class Filter:
    """The estimator for rows that come one at a time.

        f = tse.Filter("car.toml", sample_time=0.01)
        for row in source:
            e = f.step(row)
            if e.cy_front_valid:
                print(e.cy_front, e.cy_front_sd)

    Parameters
    ----------
    vehicle
        A vehicle file, a mapping with its keys, or what read_vehicle() returned; None: an
        ordinary car, whose mass must be among `settings`. Without a mass no stiffness is
        valid.
    settings
        Any settings by name (`tselab settings` lists them with default, range and unit);
        they win over the vehicle's.
    form
        "default", or the paper's filter with particles: "robust", "paper" as printed.
    sample_time
        s, usual time between rows, 0.001 .. 1; default: that of the settings, 0.01.

    Raises
    ------
    SettingError
        A setting outside its range, or without effect with this form; a ValueError. An
        unknown name is a KeyError, too.

    Notes
    -----
    Noise and biases of the sensors that the vehicle leaves out have the library's
    defaults. estimate() finds them in the log: `result.filter()` is a filter with its
    settings, and gives the same bits over the same rows. Filters are independent of each
    other; use one in one thread at a time. copy() and the module copy make an independent
    one. A filter cannot be pickled.
    """

    def __init__(
        self,
        vehicle: VehicleLike | None = None,
        *,
        settings: Mapping[str, float] | None = None,
        form: Form = "default",
        sample_time: float | None = None,
    ):
        check_form(form)
        if vehicle is None:
            config = core.Config(core.Config.settings_of(form) if form != "default" else None)
            self.notes: tuple[str, ...] = ()
        else:
            car = read_vehicle(vehicle)
            config, notes = make_config(car, None, form=form)
            self.notes = (*car.filled, *car.notes, *notes)  # what was filled in, in words
        if sample_time is not None:
            self.notes += tuple(set_sampling(config, _read_sample_time(sample_time)))
        for name, value in (settings or {}).items():
            config.set(name, value)
        check_effect(settings or {}, config)
        self._begin(config)

    def _begin(self, config: core.Config) -> None:
        config = config.complete()
        self._config = config
        self._filter = core.NativeFilter(config)
        self._row, self._out = self._filter.inputs(1), self._filter.outputs(1)
        self._nothing = self._row.copy()
        for name in CHANNELS:
            self._nothing[name] = np.nan
        self._check = config.lib.function("tse_input_check", argtypes=[ctypes.c_void_p] * 2)
        self._convert = make_conversions(config)
        self._time: float | None = None

    @property
    def settings(self) -> Mapping[str, float | int]:
        """All settings, by name; to read. Another setting needs another filter:
        Filter(settings={**f.settings, "mass": 1800})."""
        return MappingProxyType(self._config.as_dict())

    @property
    def latencies(self) -> dict[str, float]:
        """Channel -> how much later than yaw_rate it is logged, s. They are settings:
        `steer_angle_latency` and the like, or `{"latency": {"steer_angle": 0.02}}` of a
        vehicle. Rows then wait for the late channels: status WAITING, and the estimates
        are of `estimate_age` before their row."""
        return {
            c: float(getattr(self._config, f"{c}_latency"))
            for c in CHANNELS
            if f"{c}_latency" in self._config
        }

    def step(self, row: Row | Mapping[str, Any] | None = None, /, **channels: float | None) -> Estimate:
        """Use one row.

        Parameters
        ----------
        row
            A mapping, or a row of a data frame (Series or named tuple) or of a structured
            array. Columns ref_... are passed over.
        **channels
            Fields of Row that win over it, SI units. A channel that is left out, None or
            NaN is missing. Times: `dt`, or `time`, from the second row on.

        Returns
        -------
        Estimate
            The estimates after it.

        Raises
        ------
        InputError
            Names field, value and range; the filter is as before: a steering angle or
            wheel speed outside its range, a time that does not go on, a name that nobody
            knows. A measurement outside its range counts as missing.
        """
        u = self._row
        u[:] = self._nothing
        known = u.dtype.names or ()
        optional = [f.name for f in self._config.lib.optional]
        now = step = None
        for name, value in {**_make_mapping(row), **channels}.items():
            if not isinstance(name, str):
                raise InputError(f"{name!r} names no channel: names are strings; {_list_known()}", repr(name))
            if name == "time":
                now = self._read_number(name, value)
            elif name == "dt":
                step = self._read_number(name, value)
            elif name in optional:
                number = math.nan if value is None else self._read_number(name, value)
                if math.isfinite(number):
                    u[name] = number
                    u["given"] |= np.uint32(1 << optional.index(name))
            elif name in known and name not in ("missing", "given"):
                u[name] = math.nan if value is None else self._read_number(name, value)
            elif not (name.startswith("ref_") or name in OPTIONAL_COLUMNS):
                raise InputError(f"there is no channel {name!r}{_make_hint(name)}", name)
        u["dt"] = self._compute_step(now, step)
        status = self._filter.step_one(u, self._out)
        if status < 0:
            raise self._make_refusal(status)
        self._time = now if now is not None else (self._time or 0.0) + (step or 0.0)
        return self._estimate()

    @staticmethod
    def _read_number(name: str, value: Any) -> float:
        try:
            return float(value)
        except (TypeError, ValueError, OverflowError):
            shown = repr(value)
            raise InputError(
                f"{name} = {shown[:40]}{'...' if len(shown) > 40 else ''} is not a number", name
            ) from None

    def _compute_step(self, now: float | None, step: float | None) -> float:
        """Return dt of a row; the filter does not use that of the first one."""
        if now is not None and step is not None:
            raise InputError("a row has time or dt, not both", "dt")
        if now is not None and not math.isfinite(now):
            raise InputError(f"time = {now:g} is not a number of seconds", "time")
        if self._time is None:
            return float(self._config.sample_time)
        if now is not None:
            return now - self._time
        if step is None:
            raise InputError("dt is missing: s since the row before; or give time", "dt")
        return step

    def _make_refusal(self, status: int) -> InputError:
        wrong = ctypes.c_char_p()
        self._check(self._row.ctypes.data, ctypes.addressof(wrong))
        name = wrong.value.decode() if wrong.value else "row"
        lib = self._config.lib
        text = lib.codes(core.STATUS)[status].text
        if name not in (self._row.dtype.names or ()):
            return InputError(f"row refused: {text}", name)
        field, value = lib.field(INPUT, name), float(self._row[name][0])
        allowed = field.range_text if field.has_range else "above 0 .. 3600 s"
        return InputError(f"{name} = {value:g} is outside its range {allowed} ({field.text or text})", name)

    def _estimate(self) -> Estimate:
        raw = self._out[0].item()
        values: list[Any] = [self._time]
        for value, convert in zip(raw, self._convert, strict=True):
            values.extend(convert(value))
        return Estimate(*values)

    def reset(self) -> None:
        """Start again: the next row is the first."""
        self._filter.reset()
        self._time = None

    def copy(self) -> Filter:
        """Return a filter that goes on from here, independent of this one."""
        other = object.__new__(type(self))
        other.notes = self.notes
        other._begin(self._config)
        other._filter.restore(self._filter.snapshot())
        other._time = self._time
        return other

    __copy__ = copy  # without it a copy would share the state of this one

    def __deepcopy__(self, memo: dict[int, Any]) -> Filter:
        return self.copy()

    def __reduce_ex__(self, protocol: Any) -> Any:
        raise TypeError(
            "a Filter cannot be pickled: take its settings and what save_learnt() gives to the other process"
        )

    def save_learnt(self) -> bytes | None:
        """Return the learnt state, for the next drive: 268 bytes that an ECU reads,
        too (tse/learnt.h). None before a row."""
        return self._filter.save_learnt()

    def load_learnt(self, learnt: bytes, age: float = UNKNOWN_AGE) -> None:
        """Start from the learnt state of an earlier drive, before the first row.

        Parameters
        ----------
        learnt
            Of save_learnt() or Result.learnt.
        age
            s since then. With an unknown age the state is trusted no more than the start
            values of the settings.

        Raises
        ------
        LearntError
            The bytes are damaged, of another vehicle, or of a newer library; the filter
            is as before.
        """
        self._filter.load_learnt(learnt, age)

    def uncertainty_sd(self) -> dict[str, np.ndarray[Any, np.dtype[np.float64]]]:
        """Return the share of the sd of the three stiffnesses that each uncertain
        parameter of the car (`mass_sd` ...) adds: (3,) each, relative to nominal.
        After the last row."""
        return self._filter.uncertainty_sd()


def check_form(form: Any) -> None:
    """Refuse an unknown form."""
    forms = get_args(Form)
    if form not in forms:
        raise core.SettingError(f"form = {form!r} is not known; allowed: {', '.join(forms)}")


def _read_sample_time(value: Any) -> float:
    """Return the time between rows, s. SettingError: it is outside its range."""
    try:
        seconds = float(value)
    except (TypeError, ValueError, OverflowError):
        seconds = math.nan
    if not MIN_ROW_STEP <= seconds <= MAX_ROW_STEP:
        raise core.SettingError(
            f"sample_time = {value!r} is refused; allowed: {MIN_ROW_STEP:g} .. {MAX_ROW_STEP:g} s"
        )
    return seconds


def _make_mapping(row: Any) -> dict[Any, Any]:
    """Return a row as a mapping, whatever kind of row it is."""
    if row is None:
        return {}
    if hasattr(row, "keys"):  # a mapping, a Series: that iterates over its values
        return {name: row[name] for name in row.keys()}  # noqa: SIM118
    if hasattr(row, "_asdict"):  # of DataFrame.itertuples()
        return {name: value for name, value in row._asdict().items() if name != "Index"}
    if isinstance(row, np.void) and row.dtype.names:
        return {name: row[name] for name in row.dtype.names}
    raise TypeError(
        "a row is a mapping, a Series, a named tuple or a record of a structured array, not "
        f"{type(row).__name__}"
    )


Convert: TypeAlias = Callable[[Any], tuple[Any, ...]]


def make_conversions(config: core.Config) -> list[Convert]:
    """Return, for each output of the library in its order, the conversion to fields of
    an Estimate."""
    lib = config.lib
    words = {code: f.name for code, f in lib.codes(REASON).items()}
    channels = {0: None, **{1 + i: f.name for i, f in enumerate([*lib.channels, *lib.optional])}}

    def scaled(factor: float) -> Convert:
        if lib.real == np.float32:  # rounded where arrays of the library are
            return lambda x: (float(np.float32(x) * np.float32(factor)),)
        return lambda x: (x * factor,)

    found: list[Convert] = []
    for f in lib.fields(OUTPUT):
        stiffness = next((s for s in STIFFNESS if f.name == s or f.name.startswith(s + "_")), None)
        if f.name.endswith("_valid"):
            found.append(lambda x: (x == 0, words.get(x, "unknown")))
        elif f.name.endswith("_spread_seen"):
            found.append(lambda x: (x != 0,))
        elif stiffness and f.unit == "1":
            found.append(scaled(float(getattr(config, NOMINAL[stiffness]))))
        elif f.name == "fault_channel":
            found.append(lambda x: (channels.get(x),))
        elif f.name == "status":
            found.append(lambda x: (Status(x),))
        else:
            found.append(lambda x: (x,))
    return found


def _make_hint(name: str) -> str:
    for axle, pair in SIDES.items():
        if name in pair:
            return f": give {axle}, the mean of both wheels"
    return suggest_names(name, CHANNELS, other=f"; {_list_known()}")


def _list_known() -> str:
    return f"known: time, dt, {', '.join(CHANNELS)}"
