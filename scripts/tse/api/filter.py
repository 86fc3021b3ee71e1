"""Run the filter row by row: Filter."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from tse.api.generated import CHANNELS, Estimate, Row, Status
from tse.api.vehicle import VehicleLike, read_vehicle
from tse.car.config import check_effect, make_config, set_sampling
from tse.errors import InputError
from tse.library import core
from tse.library.core import INPUT, NOMINAL, OUTPUT, REASON, STIFFNESS
from tse.library.errors import suggest_names
from tse.log.rows import MAX_ROW_STEP, MIN_ROW_STEP, OPTIONAL_COLUMNS, SIDES

Form: TypeAlias = Literal["default", "robust", "paper"]
UNKNOWN_AGE = math.inf  # [s] value of `age` if the age of a learnt state is not known


class Filter:
    """Tyre-stiffness filter for rows that arrive one at a time.

        f = tse.Filter("car.toml", sample_time=0.01)
        for row in source:
            e = f.step(row)
            if e.cy_front_valid:
                print(e.cy_front, e.cy_front_sd)

    Parameters
    ----------
    vehicle
        A vehicle file, a mapping with its keys, or the result of read_vehicle(). None: an
        ordinary car. Then give its mass in `settings`: in the form "default", the
        relative sd of an unknown mass is 0.3, so that no stiffness ever becomes valid.
    settings
        Any settings by name (`tselab settings` lists them with default, range and unit).
        They override those of the vehicle.
    form
        Which filter runs. "default": the Kalman filter of tse. "paper": the particle
        filter as printed in the paper of Berntorp and Di Cairano (2016). "robust": the
        particle filter with settings that keep it from diverging.
    sample_time
        [s] Usual time between rows, 0.001 .. 1. None: the value of the setting
        sample_time, by default 0.01.

    Raises
    ------
    SettingError
        A setting is outside its range, has no effect with this form, or is unknown. The
        error is also a ValueError. If the name is unknown, it is also a KeyError.

    Notes
    -----
    If the vehicle does not state noise and bias of a sensor, the defaults of the library
    are used. estimate() estimates noise and bias from the log instead. To use the values
    from the log in a Filter, call the method filter() of the result of estimate(). It
    returns a Filter that computes the same estimates as estimate() from the same rows,
    bit by bit. Filters do not share state. One filter must not be used by two threads at
    once. copy(), copy.copy() and copy.deepcopy() return an independent filter. A filter
    cannot be pickled.
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
            self.notes = (*car.filled, *car.notes, *notes)  # sentences about values that were filled in
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
        """All settings by name, read-only. To change one, make a new filter:
        Filter(settings={**f.settings, "mass": 1800})."""
        return MappingProxyType(self._config.as_dict())

    @property
    def latencies(self) -> dict[str, float]:
        """[s] Delay of each channel relative to yaw_rate.

        The delays are settings such as `steer_angle_latency`, or the table
        `{"latency": {"steer_angle": 0.02}}` of a vehicle. The filter waits for delayed
        channels. So the estimates that step() returns refer to a time that is
        `estimate_age` [s] before its row. If a step must still wait for a channel, the
        status is WAITING, and the estimates do not change."""
        return {
            c: float(getattr(self._config, f"{c}_latency"))
            for c in CHANNELS
            if f"{c}_latency" in self._config
        }

    def step(self, row: Row | Mapping[str, Any] | None = None, /, **channels: float | None) -> Estimate:
        """Update the filter with one row.

        Parameters
        ----------
        row
            A mapping, or a row of a data frame (Series or named tuple) or of a structured
            array. Columns ref_... are ignored.
        **channels
            Fields of Row in SI units. They override those of `row`. A channel
            that is left out, None or NaN is missing. From the second row on, `dt`
            or `time` must be given.

        Returns
        -------
        Estimate
            The estimates after this row.

        Raises
        ------
        InputError
            A steering angle or wheel speed is outside its range, the time does not
            increase, or a name is unknown. The message names field, value and range, and
            the state of the filter does not change. A measurement (accelerations, yaw
            rate, optional channels) outside its range is no error: it counts as missing.
        """
        u = self._row
        u[:] = self._nothing
        known = u.dtype.names or ()
        optional = [f.name for f in self._config.lib.optional]
        now = step = None
        for name, value in {**_make_mapping(row), **channels}.items():
            if not isinstance(name, str):
                raise InputError(
                    f"{name!r} is not the name of a channel: names are strings; {_list_known()}", repr(name)
                )
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
        """Return the time [s] since the previous row. For the first row return the sample
        time; the filter does not use it there.

        `now`, `step`: `time` and `dt` as the caller gave them; None: not given."""
        if now is not None and step is not None:
            raise InputError("both time and dt are given: give one of them", "dt")
        if now is not None and not math.isfinite(now):
            raise InputError(f"time = {now:g} is not a finite number: give seconds", "time")
        if self._time is None:
            return float(self._config.sample_time)
        if now is not None:
            return now - self._time
        if step is None:
            raise InputError("dt is missing: give the seconds since the row before, or give time", "dt")
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
        """Reset the filter to its initial state. The next row counts as the first one: it
        needs no time step."""
        self._filter.reset()
        self._time = None

    def copy(self) -> Filter:
        """Return an independent filter with the present state of this one."""
        other = object.__new__(type(self))
        other.notes = self.notes
        other._begin(self._config)
        other._filter.restore(self._filter.snapshot())
        other._time = self._time
        return other

    __copy__ = copy  # without it, copy.copy() would call __reduce_ex__(), which raises TypeError

    def __deepcopy__(self, memo: dict[int, Any]) -> Filter:
        return self.copy()

    def __reduce_ex__(self, protocol: Any) -> Any:
        raise TypeError(
            "a Filter cannot be pickled: pass its settings and the bytes of save_learnt() to the other "
            "process"
        )

    def save_learnt(self) -> bytes | None:
        """Return the learnt state, from which the next drive can start: 268
        bytes, which tse_learnt_load() of the C library reads, too (tse/learnt.h).
        None: no row was used yet."""
        return self._filter.save_learnt()

    def load_learnt(self, learnt: bytes, age: float = UNKNOWN_AGE) -> None:
        """Start from the learnt state of an earlier drive. Call it before the first row.

        Parameters
        ----------
        learnt
            Bytes from save_learnt() or Result.learnt.
        age
            [s] Time since that drive. UNKNOWN_AGE (infinity): unknown. Then, with the
            default settings, the learnt state does not reduce the initial sds of
            stiffnesses and biases, and the biases start at 0.

        Raises
        ------
        LearntError
            The bytes are damaged, belong to a different vehicle, or have a format that
            this library does not read; the filter has already had a row; or `age` is NaN.
            The state of the filter does not change.
        """
        self._filter.load_learnt(learnt, age)

    def uncertainty_sd(self) -> dict[str, np.ndarray[Any, np.dtype[np.float64]]]:
        """Return the sds that each uncertain parameter of the car causes in the stiffness
        estimates after the last row. Key: setting with the sd of the parameter, such as
        `mass_sd`. Value: (3,) caused sds of cx_front, cy_front and cy_rear, each relative
        to the nominal stiffness. For the forms "paper" and "robust", return {}."""
        return self._filter.uncertainty_sd()


def check_form(form: Any) -> None:
    """Raise SettingError if `form` is not the name of a filter (type Form)."""
    forms = get_args(Form)
    if form not in forms:
        raise core.SettingError(f"form = {form!r} is not known; allowed: {', '.join(forms)}")


def _read_sample_time(value: Any) -> float:
    """Return the sample time [s] as a number. Raise SettingError if `value` is not a
    number within the range of sample_time."""
    try:
        seconds = float(value)
    except (TypeError, ValueError, OverflowError):
        seconds = math.nan
    if not MIN_ROW_STEP <= seconds <= MAX_ROW_STEP:
        raise core.SettingError(
            f"sample_time = {value!r} is outside its range {MIN_ROW_STEP:g} .. {MAX_ROW_STEP:g} s"
        )
    return seconds


def _make_mapping(row: Any) -> dict[Any, Any]:
    """Return a row of any accepted type as a dict of names and values."""
    if row is None:
        return {}
    if hasattr(row, "keys"):  # a mapping or a Series. Without keys(), a Series would yield its values
        return {name: row[name] for name in row.keys()}  # noqa: SIM118
    if hasattr(row, "_asdict"):  # a named tuple, as DataFrame.itertuples() yields
        return {name: value for name, value in row._asdict().items() if name != "Index"}
    if isinstance(row, np.void) and row.dtype.names:
        return {name: row[name] for name in row.dtype.names}
    raise TypeError(
        f"row: {type(row).__name__} cannot be a row; give a mapping, a Series, a named tuple or a record "
        "of a structured array"
    )


Convert: TypeAlias = Callable[[Any], tuple[Any, ...]]


def make_conversions(config: core.Config) -> list[Convert]:
    """Return one function for each output of the library, in the order of the outputs.
    Each function converts the value of its output to one or more fields of Estimate."""
    lib = config.lib
    words = {code: f.name for code, f in lib.codes(REASON).items()}
    channels = {0: None, **{1 + i: f.name for i, f in enumerate([*lib.channels, *lib.optional])}}

    def scaled(factor: float) -> Convert:
        if lib.real == np.float32:  # round the product to single precision, as NumPy does for arrays
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
