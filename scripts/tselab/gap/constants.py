"""Every threshold, prior, price and limit by which tselab gap decides, and tselab.identify, whose engine it shares with calibrate:
one table of name, value, unit, why, and whether it has been swept. Not here: the catalogue (effects.toml), the unknowns of a
calibration (identify/unknowns.py) and the library of forms (infer/formula/terms.py), which are tables of their own; colours,
columns and sizes of pictures.

A module takes its own from here, under the name that it has in the table:

    EPISODE, REACH = constants.of(__name__, "EPISODE", "REACH")

and others import them from that module. tests/gap/changed.py makes one another for a study.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

PACKAGE = "tselab"
GAP = f"{PACKAGE}.gap"


@dataclass(frozen=True)
class Constant:
    """A row of the table."""

    module: str  # that has it, and decides by it
    key: str  # its name there
    value: Any  # a number; a tuple of numbers, or numbers by channel
    unit: str
    reason: str
    swept: str = ""  # the table that says what another value does; "": nobody has looked
    fixed: bool = False  # read once, when modules are loaded: no study can change it

    @property
    def name(self) -> str:
        """Of module and key, within tselab.gap, or tselab for what is not of it."""
        return f"{self.module.removeprefix(GAP + '.').removeprefix(PACKAGE + '.')}.{self.key}"

    @property
    def room(self) -> str:
        """A heading of the table."""
        within = self.module.removeprefix(PACKAGE + ".").split(".")[:-1]
        return " / ".join(within[1:] or ["shared"]) if within[0] == "gap" else within[0]


def _rows(module: str, *rows: tuple) -> Iterator[Constant]:
    for key, value, unit, reason, *more in rows:
        yield Constant(f"{PACKAGE}.{module}", key, value, unit, reason, **(more[0] if more else {}))


TABLE: tuple[Constant, ...] = (
    # ---- what the rooms share
    *_rows(
        "gap.data",
        ("SLOWEST", 3.0, "m/s", "below it the tyre model is another one, and wheel speeds are counted too coarsely"),
        ("STEEPEST", 0.6, "rad", "of road-wheel angle: beyond it the model is another one"),
        ("BLOCK", 0.04, "s", "residuals are averaged over so long"),
        ("BURN_IN", 1.0, "s", "of each stretch that are simulated, but not compared: the state starts unknown"),
        ("SHORTEST", 3.0, "s", "shorter stretches say less than their start costs"),
        ("LONGEST_HOLE", 0.1, "s", "holes in an input up to this are bridged"),
        ("FLOOR", {"vehicle_speed": 0.02, "wheel_torque_front": 5.0, "wheel_torque_rear": 5.0}, "m/s, N m",
         "no optional channel is held to be quieter"),
        ("HELD", 0.5, "1", "share of values that repeat the one before above which a channel is one that is slower than the rows"),
        ("SEED", 1, "1", "of the draw that says what the smoothing of inputs leaves"),
    ),
    *_rows(
        "gap.problem",
        ("PRIOR", {"grade": 0.03, "bank": 0.02}, "rad", "sd of roads, of the values of their profiles"),
        ("KNOT", 40.0, "m", "between two values of a profile, which is smooth over that"),
    ),
    *_rows(
        "gap.optional",
        ("SCALE", {"vehicle_speed": 0.05, "wheel_torque_front": 0.15, "wheel_torque_rear": 0.15}, "1",
         "up to here an error of scale is the sensor's, beyond it the car's: a drive torque comes from the map of an engine, a "
         "brake torque from a pressure and a coefficient of friction"),
        ("LATENCY", 0.3, "s", "the same of lateness, as of a GNSS receiver"),
        ("BRACED", 1000.0, "N m", "sd that is known beforehand of the torque that axles brace with"),
        ("ROUNDS", 4, "1", "of the search for the latency: always as many, so that what is read is smooth in the parameters"),
        ("GAP", 0.06, "s", "blocks further apart are of two pieces"),
        ("WORTH", {"vehicle_speed": 0.01, "wheel_torque_front": 0.05, "wheel_torque_rear": 0.05, "latency": 0.03}, "1, s",
         "what a user should know"),
    ),
    *_rows(
        "gap.fit",
        ("MOST_LAG", 4.0, "s", "of autocorrelation that are looked at"),
        ("TOLERANCE", 1e-4, "1", "relative change of the sum of squares at which a fit ends"),
    ),
    # ---- what leads through the rooms
    *_rows(
        "gap.plan",
        ("NEED", 8.0, "nats", "by which two effects are separable"),
        ("RIVAL_SHARE", 0.1, "1", "of the nats by which an effect shows: the forms of a real car are not known better"),
        ("NOTHING", 0.1, "nats", "by which an effect shows: less is not excited"),
        ("ROUNDS", 4, "1", "of polishing a fit without noise, most"),
        ("SAME", 0.02, "1", "of the nats by which an effect shows: less is the integration's steps, and no model is that good"),
        ("TINY", 1e-3, "1", "of the noise is put on what is measured, so that a perfect fit has an end"),
        ("LONGEST", 3600.0, "s", "what takes longer cannot be separated by driving"),
    ),
    *_rows(
        "gap.drives",
        ("STEP", 0.01, "s", "rows of a planned log"),
        ("DURATION", 30.0, "s", "of a manoeuvre"),
        ("HAND", 0.06, "s", "sd of the smoothing that makes a step one of a driver's hand"),
        ("ROUNDS", 3, "1", "of finding wheel speeds and motion across from each other"),
    ),
    # ---- localise
    *_rows(
        "gap.localise.where",
        ("WINDOW", 1.0, "s", "over which the energy of a residual is taken"),
        ("FALSE_DISCOVERIES", 0.01, "1", "share of the conditions that may be there by chance (Benjamini-Hochberg)"),
        ("LEAST_CORRELATION", 0.15, "1", "of ranks: a condition that goes less with the energy is not worth words"),
        ("FEWEST_WINDOWS", 20, "1", "fewer do not show a channel's conditions"),
        ("MOST_FOLLOWED", 0.5, "1",
         "a road does not know of the steering wheel: of a bank, no more of the variance goes with the car's own turning"),
        ("HAT", 10, "blocks", "between two values of a disturbance, which is linear between them"),
    ),
    *_rows(
        "gap.localise.remainder",
        ("LAGS", (0, 2, 5, 10), "blocks", "of the signals that a residual may follow"),
        ("FOLDS", 5, "1", "of the cross-validation"),
        ("SHIFTS", 39, "1", "in a circle, by which chance is measured; the largest of 39 is 1 in 40: a p value of 0.025"),
        ("RIDGE", 30.0, "1", "of the regression on standardised signals, in blocks"),
        ("PREDICTABLE", 0.15, "1", "of the energy above the noise that must be predicted to be worth words"),
        ("LOCAL", 0.15, "1", "of the time: half of the energy in less is localised"),
        ("WALK", {"accel_x": 0.005, "accel_y": 0.005, "yaw_rate": 0.0003}, "m/s2, rad/s per root s", "how far MEMS biases walk"),
        ("MEMORY", 0.12, "s", "cars and roads remember longer than the low pass of a sensor"),
    ),
    *_rows(
        "gap.localise.excitation",
        ("FAST", 1.5, "Hz", "steering above it is the upper part of a sweep"),
        ("FAST_STEER", 0.003, "rad", "rms of it that counts"),
        ("HIGH_ACCEL", 4.5, "m/s2", "99 % of |accel_y| that a log with 5 to 6 m/s2 has"),
        ("BRAKING", 1.5, "m/s2", "at least, of braking in a turn"),
        ("TURNING", 1.5, "m/s2", "at least, of a turn in which it is braked"),
        ("STEERED", 1.0, "m/s2", "of accel_y from which it is steered"),
        ("APART", 1.5, "1", "ratio of the faster to the slower speed at which it is steered"),
        ("JUMP", 2.0, "m/s2", "within JUMP_TIME, of a step of brake or throttle"),
        ("JUMP_TIME", 0.6, "s", "of such a step"),
        ("LEAST_SECONDS", 2.0, "s", "of a manoeuvre that are enough"),
        ("LEAST_JUMPS", 3, "1", "steps of brake and throttle that are enough"),
    ),
    # ---- infer: what is known before any log
    *_rows(
        "gap.infer.hypotheses",
        ("EXPECTED", 1.0, "1", "how many of all other effects a car lacks before anybody has looked"),
        ("SENSOR_SHARE", 0.1, "1", "of cars, that a given sensor error is there"),
        ("EVERY_SHARE", 0.15, "1", "that what every car has is large enough to matter, and not in the file"),
        ("WRONG_SIGN", 0.01, "1", "probability that an effect has the sign that its physics does not"),
        ("SMALLER_SD", 0.7, "ln", "below the typical range: half and less is as good as nothing"),
        ("LARGER_SD", 0.35, "ln", "above the typical range: twice has hardly a car"),
        ("SWITCH_SD", 0.15, "ln", "of what is there or not"),
        ("NAME_AT", 0.9, "1", "probability from which an effect gets a name: of 10 such names less than one is wrong"),
        ("SIZE_COST", 3.0, "nats", "of a size that logs know to a percent of what is typical"),
        ("MOST_LATE", 0.1, "s", "of a message behind or before another one"),
        ("LATE", (0.003, 0.02), "s",
         "typical lateness of a message behind another one: bus cycles of 5 .. 20 ms, filters of 10 .. 30 Hz"),
        ("OTHER_SD", 1.0, "1", "typical sizes: sd of the strengths besides the largest one of an effect"),
    ),
    *_rows(
        "gap.infer.space",
        ("STIFFNESS_SD", 0.5, "1", "of the car's over the vehicle file's"),
        ("OWN_SD", 0.02, "1", "of a log's over the car's: warmth, load, road of one day"),
        ("LEAST_SIZE", 1.0, "1", "in units of noise: a channel that stands still is not known to a share of nothing"),
        ("ACTIVE_TIME", 1.0, "s", "over which a channel's size is taken"),
        ("MOST_SHARE", 5.0, "1", "of shapes, in prior sd"),
        ("EPISODE", 30.0, "s",
         "of a manoeuvre, all through which a wrong model is wrong in the same way: its residuals say one value of a channel"),
        ("FEWEST", 3.0, "1", "such values, also of one short log: it has its manoeuvres, too"),
        ("UNMOVED", 1.0, "1", "sum of squares in sd, by which residuals may change before their discrepancy is found anew"),
        ("TINY", 1e-6, "1", "sd of a share that is as good as none"),
        ("REACH", 15.0, "steps", "a chord over a third of the typical size says more of an effect than its tangent at zero"),
    ),
    *_rows(
        "gap.infer.forms",
        ("SD", 0.05, "1", "shares: so well forms are known"),
        ("LAG", 0.03, "s", "sd: so well is known how late an effect acts"),
        ("APART", 0.3, "1",
         "sd: of how late an effect makes tyres act, so much those of one axle differ: a relaxation length is stiffness of tread "
         "over carcass, and axles differ in load, pressure and tyres as their stiffness does"),
        ("RATE_TIME", 0.1, "s", "by which rates are multiplied: of motions of 1.6 Hz as large as what they are rates of"),
        ("FAST", 20.0, "m/s", "of a modulator that is about 1 where a driver goes hard"),
        ("ALONG", 3.0, "m/s2", "the same"),
        ("ACROSS", 4.0, "m/s2", "the same"),
        ("STEERED", 0.05, "rad", "the same"),
    ),
    *_rows(
        "gap.infer.noise",
        ("MEDIAN", (1.0, 0.002, 0.1, 0.3, 20.0), "1, 1, 1, s, s",
         "of white, share, slow, fast time and slow time, prior; white and slow in units of the noise of one block"),
        ("SD", (0.3, 1.5, 1.5, 0.7, 0.7), "ln", "of the same: a car that the model has is one of the answers"),
        ("RANGES", ((0.5, 20.0), (1e-4, 2.0), (1e-3, 15.0), (0.1, 2.0), (3.0, 200.0)), "1, 1, 1, s, s", "of the same"),
        ("BIAS_SD", 300.0, "1", "of a sensor in a log, units of the noise of one block: any"),
        ("PRECISION", 1e-5, "1", "relative, of the cost: a tenth of a nat"),
        ("APART", 1e6, "s", "logs that know nothing of each other"),
    ),
    # ---- infer: the search, and names
    *_rows(
        "gap.infer.excerpt",
        ("MOST_SECONDS", 90.0, "s", "of logs, in which effects are searched: what is found is fitted to all of them"),
        ("HELD_SHARE", 0.5, "1", "of that, of held-out logs: they confirm"),
        ("PIECE", 15.0, "s", "of a log that is chosen or not: a manoeuvre or two, of which BURN_IN is lost"),
        ("ENTRY_SD", 30.0, "noise of a block", "that a piece's information counts with: models are no better known than that, and "
         "with less the first pieces are sure of everything"),
    ),
    *_rows(
        "gap.infer.rivals",
        ("OUTSIDE", 0.2, "1", "prior, that what is missing is in no catalogue"),
        ("FEWER", 1, "1", "sets of the strongest names that a formula is sought beside: every one is a search"),
    ),
    *_rows(
        "gap.infer.search",
        ("REFIT", 5, "1", "candidates of a screening that are fitted in full"),
        ("SWAPS", 3, "1", "candidates that are asked to stand in for an effect"),
        ("MOST_EFFECTS", 8, "1", "of a set"),
        ("PASSES", 2, "1", "of adding, leaving out and exchanging"),
        ("MOST_STEPS", 12, "1", "of a fit while sets are compared"),
        ("AHEAD", 1, "1", "effects that may come to no good before the next one does"),
        ("WORTH", 0.5, "nats", "a set that is better by less is no reason to go on"),
        ("FAR", 12.0, "nats", "candidates that a screening puts further behind nothing are not fitted"),
        ("SHARE", 0.5, "1", "of what an effect is worth by the screening: what is worth less is not asked to stand in for it"),
    ),
    *_rows(
        "gap.infer.naming",
        ("ALIKE_AT", 0.05, "1",
         "share of the probability that an effect or something in its place is missing, from which that something is a look-alike"),
        ("POSSIBLE_AT", 0.1, "1", "probability from which an effect without a name is given as possible"),
        ("LEAST_CLOSED", 0.05, "1", "of what the other names leave, that a name must close, and of the gap all together"),
        ("ROAD_PROBABILITY", 0.1, "1", "prior, that a road's profile shows"),
        ("ROAD_SHARE", 0.5, "1", "of what is slow in its channel that a road must explain"),
        ("ROAD_HARM", 3.0, "nats",
         "by which a road may make another channel worse: a road moves the car, and what moves it shows there, too"),
        ("MOST_KNOTS", 600, "1", "of a road's profile: every one is a number that is fitted"),
    ),
    *_rows("gap.infer.detect", ("WAVE", 400.0, "m", "of a road that goes up and down, which stands for any: would it show?")),
    *_rows(
        "gap.infer.show",
        ("BLOCK", 2.0, "s", "of residuals that are resampled together"),
        ("DRAWS", 1000, "1", "of the bootstrap"),
        ("SEED", 1, "1", "of the bootstrap"),
    ),
    # ---- infer: formulas
    *_rows(
        "gap.infer.formula.search",
        ("PRICE", 2.0, "nats",
         "of an operation or a number: a library of some hundred forms times places times sizes is some 12 nats"),
        ("FITTED", 6, "1", "candidates that are simulated"),
        ("PER_PLACE", 3, "1", "of them at one place, most"),
        ("LEAST_SHARE", 0.15, "1", "of the gap, that a formula must close to be worth reading"),
        ("LEAST_HARM", 0.01, "1", "relative rise of a channel of the held-out logs by which it forbids a formula"),
        ("NOISE_LIMIT", 1.2, "1",
         "rms over noise up to which nothing is left to explain: noise is known to some percent, inputs are smoothed"),
        ("MOST_STEPS", 15, "1", "of a fit"),
        ("CHUNK", 64, "1", "forms that are looked at together: memory"),
        ("HALF", 0.5, "%", "quantiles between which a signal has been are those of HALF % and 100 - HALF %"),
    ),
    *_rows("gap.infer.formula.terms", ("PLAYS", (0.001, 0.003, 0.01), "rad", "halves of plays of the steering that are tried")),
    # ---- export
    *_rows(
        "gap.export.gain",
        ("FEWEST_VALID", 50, "1", "rows; fewer do not show a log's stiffness"),
        ("LEAST_VALID", 0.5, "1",
         "of the rows, with the improved vehicle: a log that knows a stiffness for less was not driven to show it"),
    ),
    # ---- tselab.identify: the fits of gap and calibrate (fit.py, discrepancy.py), and the problem of calibrate
    *_rows(
        "identify.fit",
        ("MOST_STEPS", 40, "1", "of a fit"),
        ("SETTLED", 0.1, "1", "posterior sd: a step below it ends the search"),
        ("SAME", 1.0, "nats", "discrepancies that are no more likely than those before are kept, so that the search can end"),
        ("MOST_REFITS", 12, "1", "of the discrepancies"),
        ("WINDOW", 15.0, "s", "pieces that are asked separately how far they contradict each other"),
    ),
    *_rows(
        "identify.discrepancy",
        ("TIMES", (0.3, 20.0), "s", "prior medians of the two decay times"),
        ("TIME_SD", 0.7, "ln", "of both"),
        ("RANGES", ((0.15, 0.6), (1.0, 200.0)), "s", "the fast one is neither the white noise of blocks of 0.04 s nor a bias"),
        ("SHARE", 0.03, "1", "prior median of the share that the model does not have"),
        ("SHARE_SD", 0.7, "ln", "of it"),
        ("SHARES", (0.02, 1.0), "1",
         "its range; the least: with forty numbers a model of another car fits a log down to the noise of its sensors, at numbers "
         "that are wrong by many of the sd that noise alone would leave"),
        ("ACTIVE_TIME", 1.0, "s", "over which a channel's size is taken"),
        ("PRECISION", 1e-7, "1", "relative, of the cost: some thousandths of a nat"),
        ("LEAST", 1e-3, "1", "sd of a part over that of the residual: none"),
    ),
    *_rows(
        "identify.problem",
        ("STEP", 0.02, "1", "of finite differences, in prior sd"),
        ("SPEED_TIME", 1.0, "s", "in the comparison of accel_x; longer lets the grade of the road in, shorter its noise"),
        ("SPEED_BLOCKS", 10, "blocks", "that are one in the comparison of accel_x: a second holds two or three numbers"),
        ("LEAST_SPEED", 5.0, "m/s", "below, slip is not observable"),
        ("FEWEST", 25, "blocks", "of a channel in a log, to compare it"),
        ("ENOUGH", 0.5, "1", "rows with a value in a block, over the usual number"),
        ("UNLIKE_SD", 0.03, "1", "share by which the car is unlike the model, of each of the shapes of that"),
        ("POWER", 0.25, "1",
         "the likelihood counts so much (a power posterior: Miller & Dunson 2019): where a model of another car is wrong it is so "
         "for hours, and no length of log makes it right. On four cars with 14 degrees of freedom bands with 1 held relaxation in "
         "two, inertia in three"),
        ("HARD", (3.0, 4.0, 20.0), "m/s2 along, m/s2 across, m/s", "of shapes that are about 1 where a driver goes hard"),
    ),
    *_rows(
        "identify.unknowns",
        ("MOST_LATENCY", 0.2, "s", "of a channel behind the gyro, or before it", {"fixed": True}),
        ("COMMON_SD", {"": 0.0, "wheels": 0.025, "accelerometers": 0.02, "radii": 0.007}, "s; 1",
         "how late messages are, behind that of the gyro; relative: how far off radii in the file are. What is own to a channel is "
         "less: axles come from one unit - and how far one is behind the other hardly shows, so that any error of the model would "
         "pass for it - accelerometers from one chip, tyres from one shop"),
        ("STIFFNESS_SD", 0.5, "ln", "of the car's over the vehicle file's"),
        ("MOST_STIFFNESS", 1.8, "ln", "the same, most"),
        ("OWN_MEAN", (0.0, 0.0, 0.0, 0.12), "ln, ln, ln, 1",
         "of each log: its stiffnesses over the car's - warmth, load, road - and how much of the sideways acceleration in its "
         "curves the bank of the road takes over: roads are built so, and a bank left out passes for a scale of accel_y and for "
         "other tyres"),
        ("OWN_SD", (0.1, 0.1, 0.1, 0.05), "ln, ln, ln, 1", "of the same"),
        ("LEAST_SD", {"lean_sd": 0.1, "trail_sd": 0.02, "gyro_scale_sd": 0.005, "relaxation_sd": 0.12}, "1, m, 1, m",
         "is not known better, whatever the covariance says: roads lean into their curves otherwise than those of the logs, "
         "steering moves with force, axles differ in relaxation"),
    ),
    *_rows(
        "identify.ready",
        ("CALM", 0.15, "s", "sd of the smoothing: wheels and body pitch at 1 to 2 Hz on uneven roads, a driver brakes below that"),
        ("CURVE_LENGTH", 12.0, "m", "sd of the smoothing: over which a road goes from level to leaning into its curve"),
    ),
)  # fmt: skip


def of(module: str, *keys: str) -> list[Any]:
    """The values of a module's constants, in this order."""
    rows = {c.key: c.value for c in TABLE if c.module == module}
    return [rows[k] for k in keys]


def markdown() -> str:
    """The table for readers, by rooms."""
    lines = ["| constant | value | unit | why | swept |", "|---|---|---|---|---|"]
    room = ""
    for c in sorted(TABLE, key=lambda c: _ROOMS.index(c.room)):  # stable: within a room as above
        if c.room != room:
            room = c.room
            lines.append(f"| **{room}** | | | | |")
        lines.append(
            f"| `{c.name}` | {_shown(c.value)} | {c.unit} | {c.reason.replace('|', chr(92) + '|')} | {c.swept or '-'} |"
        )
    return "\n".join(lines) + "\n"


_ROOMS = list(dict.fromkeys(c.room for c in TABLE))


def _shown(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{k or 'none'} {_shown(v)}" for k, v in value.items())
    if isinstance(value, Sequence):
        return ", ".join(f"({_shown(v)})" if isinstance(v, Sequence) else _shown(v) for v in value)
    return f"{value:g}"


if __name__ == "__main__":
    print(markdown(), end="")
