"""Read and write road.csv: the profile of a road, i.e. bank and grade at distances.

A row of road.csv describes a point of the road, here called a place. An empty cell of
bank, grade, bank_sd or grade_sd means unknown. Other columns have no empty cells.
Columns:

distance             m, along the road, increasing
bank                 rad, > 0 if the left side is higher, -0.35 .. 0.35
grade                rad, > 0 uphill, -0.35 .. 0.35
bank_sd              rad, standard deviation of bank, 0 .. 0.35
grade_sd             rad, standard deviation of grade, 0 .. 0.35
x, y                 m, path in a level frame with any origin; both or none
latitude, longitude  deg, the path in geographic coordinates; both or none
curvature            1/m, of the path, > 0 to the left; default: computed from the path
closed               1: a circuit, whose last row is the same place as the first; 0: open

Required columns: distance; at least one of bank and grade; and the course of the road,
i.e. x and y, or latitude and longitude, or curvature. road_match.py finds the places of
the rows of a log on the road.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tse.library.errors import NoFile, UserError
from tse.library.files import check_regular, write_atomically

Array = npt.NDArray[np.float64]

MAX_ROAD_BYTES = 1 << 30  # [B] max size of a road file: 10 000 km in steps of 1 m
# [rad] max magnitude of bank and grade, as in the settings bank_angle and grade_angle
MAX_ROAD_ANGLE = 0.35
PROFILE = ("bank", "grade", "bank_sd", "grade_sd")
COLUMN_RANGES = {  # column -> unit, minimum, maximum
    "distance": ("m", -1e7, 1e7),
    "bank": ("rad", -MAX_ROAD_ANGLE, MAX_ROAD_ANGLE),
    "grade": ("rad", -MAX_ROAD_ANGLE, MAX_ROAD_ANGLE),
    "bank_sd": ("rad", 0.0, MAX_ROAD_ANGLE),
    "grade_sd": ("rad", 0.0, MAX_ROAD_ANGLE),
    "x": ("m", -1e7, 1e7),
    "y": ("m", -1e7, 1e7),
    "latitude": ("deg", -90.0, 90.0),
    "longitude": ("deg", -180.0, 180.0),
    "curvature": ("1/m", -1.0, 1.0),
    "closed": ("1", 0.0, 1.0),
}
PAIRS = (("x", "y"), ("latitude", "longitude"))
EARTH_RADIUS = 6371008.8  # [m] mean radius of the earth
# [m] step of the finite difference that gives the derivative of bank or grade with
# respect to distance. A profile fitted to logs is linear between knots 40 m apart. A step
# much shorter than 40 m usually lies between two knots, where the derivative is constant.
SLOPE_DISTANCE = 5.0
# [m] sd of the Gaussian window that smooths the curvatures of log and road before they
# are compared. A car needs about 15 m to turn from a straight into a bend. The value is
# half of this, so that the shape of bends is kept.
SMOOTH_DISTANCE = 7.5


@dataclass(frozen=True)
class Road:
    """The profile of a road, i.e. bank and grade at n points of the road, called places.

    Parameters
    ----------
    distance
        (n,) [m] distance of each place along the road, increasing. In a circuit, the last
        place is the same point as the first, one round later.
    bank, grade
        (n,) rad; bank > 0 if the left side is higher, grade > 0 uphill. NaN: unknown.
    bank_sd, grade_sd
        (n,) rad, standard deviations. NaN: unknown.
    x, y
        (n,) m, path in a level frame. None: unknown.
    latitude, longitude
        (n,) deg, the same path. None: unknown.
    curvature
        (n,) 1/m, > 0 to the left. None: computed from x, y, or latitude, longitude.
    is_closed
        True: a circuit.
    path
        The file, for error messages.

    Raises
    ------
    UserError
        A value is outside its range, distances do not increase, columns differ in length,
        or both path and curvature are missing.
    """

    distance: Array
    bank: Array
    grade: Array
    bank_sd: Array
    grade_sd: Array
    x: Array | None = None
    y: Array | None = None
    latitude: Array | None = None
    longitude: Array | None = None
    curvature: Array | None = None
    is_closed: bool = False
    path: Path = field(default=Path("road"))

    def __post_init__(self) -> None:
        columns = {
            n: np.asarray(c, float)
            for n in COLUMN_RANGES
            if n != "closed" and (c := getattr(self, n)) is not None
        }
        for name, values in columns.items():
            object.__setattr__(self, name, values)
        check_columns(self.path, columns, np.arange(len(self.distance)), "row")
        if self.x is None and self.latitude is not None:
            x, y = to_local(self.latitude, self.longitude, self.origin)
            object.__setattr__(self, "x", x)
            object.__setattr__(self, "y", y)
        if self.curvature is None:
            if self.x is None:
                raise UserError(
                    f"{self.path}: column curvature, or x and y, or latitude and longitude are needed"
                )
            object.__setattr__(self, "curvature", compute_curvature(self.distance, self.x, self.y))

    def __len__(self) -> int:
        return len(self.distance)

    @property
    def length(self) -> float:
        """Length of the road [m], from its first to its last place. In a circuit, this is
        the length of one round."""
        return float(self.distance[-1] - self.distance[0])

    @property
    def origin(self) -> tuple[float, float]:
        """Latitude and longitude [deg] of the first place of a road that has them. If x
        and y are computed from them, x = y = 0 at this place."""
        return float(self.latitude[0]), float(self.longitude[0])

    def interpolate(self, name: str, distance: Array) -> Array:
        """Interpolate a column linearly.

        Parameters
        ----------
        name
            bank, grade, bank_sd, grade_sd, curvature, x or y.
        distance
            (m,) [m] distances along the road at which the column is interpolated. In a
            circuit, they may keep increasing from round to round. NaN: a place that is
            not on the road.

        Returns
        -------
        (m,) values. NaN: the distance is NaN, or lies before the beginning or after the
        end of an open road, or the value is unknown there.
        """
        s = np.asarray(distance, float)
        if self.is_closed:
            s = self.distance[0] + np.mod(s - self.distance[0], self.length)
        value = np.interp(s, self.distance, getattr(self, name), left=np.nan, right=np.nan)
        return np.where(np.isfinite(s), value, np.nan)

    def compute_slope(self, name: str, distance: Array) -> Array:
        """Return the derivative of a column with respect to distance, per m.

        Parameters as in interpolate(). The derivative at a distance is the mean
        derivative over the SLOPE_DISTANCE before it."""
        return (
            self.interpolate(name, distance) - self.interpolate(name, distance - SLOPE_DISTANCE)
        ) / SLOPE_DISTANCE

    def with_profile(
        self, distance: Array, bank: Array | None = None, grade: Array | None = None,
        bank_sd: Array | None = None, grade_sd: Array | None = None,
    ) -> Road:  # fmt: skip
        """Return a road with the path of this road and a new profile.

        The profile is given at places called knots, and is linear between them.

        Parameters
        ----------
        distance
            (k,) [m] increasing distances of the knots along this road.
        bank, grade, bank_sd, grade_sd
            (k,) rad, values at the knots. None: unknown on the whole road. The profile of
            an open road is unknown before the first and after the last knot. In a
            circuit, it is interpolated from the last knot to the first one of the next
            round.
        """
        period = self.length if self.is_closed else None
        made = {}
        for name, knots in zip(PROFILE, (bank, grade, bank_sd, grade_sd), strict=True):
            if knots is None:
                made[name] = np.full(len(self), np.nan)
            elif period:
                made[name] = np.interp(self.distance, distance, knots, period=period)
            else:
                made[name] = np.interp(self.distance, distance, knots, left=np.nan, right=np.nan)
        return replace(self, **made)


def make_road(
    distance: Array, *, x: Array | None = None, y: Array | None = None, latitude: Array | None = None,
    longitude: Array | None = None, curvature: Array | None = None, is_closed: bool = False,
) -> Road:  # fmt: skip
    """Return a road with this path, whose bank and grade are unknown. The parameters are
    those of Road."""
    unknown = np.full(len(distance), np.nan)
    return Road(distance, unknown, unknown, unknown, unknown, x, y, latitude, longitude, curvature, is_closed)


def to_local(latitude: Array, longitude: Array, origin: tuple[float, float]) -> tuple[Array, Array]:
    """Convert latitude and longitude [deg] to distances [m] east and north of an origin.

    `origin`: latitude and longitude, deg. The projection is equirectangular. If the
    origin is at a latitude of 60 deg, a point 10 km from the origin is projected to a
    distance from the origin that is wrong by up to 5 m. The error is less for nearer
    points and at lower latitudes. The error does not affect the matching of a log with a
    road: road_match.py projects both with the same origin, so that the car and the place
    of the road under it are displaced equally.
    """
    east = np.deg2rad(np.asarray(longitude) - origin[1]) * np.cos(np.deg2rad(origin[0])) * EARTH_RADIUS
    north = np.deg2rad(np.asarray(latitude) - origin[0]) * EARTH_RADIUS
    return east, north


def compute_curvature(distance: Array, x: Array, y: Array) -> Array:
    """Return the curvature of a path, 1/m, > 0 to the left.

    It is the derivative of the heading with respect to distance.

    Parameters
    ----------
    distance, x, y
        (n,) m.
    """
    if len(distance) < 3:
        return np.zeros(len(distance))
    heading = np.unwrap(np.arctan2(np.diff(y), np.diff(x)))
    middle = 0.5 * (distance[1:] + distance[:-1])
    turn = np.diff(heading) / np.diff(middle)
    return np.asarray(np.interp(distance, distance[1:-1], turn))


def read_road(path: Path) -> Road:
    """Read road.csv.

    Raises
    ------
    NoFile
        The file does not exist.
    UserError
        The file is not a road. The message states file, line, column and allowed range.
    """
    import pandas as pd

    path = Path(path)
    try:
        check_regular(path, MAX_ROAD_BYTES, "a road file")
        table = pd.read_csv(
            path, header=None, skipinitialspace=True, dtype=str, keep_default_na=False, encoding="utf-8-sig"
        )
    except FileNotFoundError:
        raise NoFile(f"{path}: no such file") from None
    except (OSError, ValueError, pd.errors.ParserError) as error:
        raise UserError(
            f"{path}: cannot be read as a road file: {getattr(error, 'strerror', None) or error}"
        ) from None
    header = [c.strip() for c in table.iloc[0]]
    twice = [c for c in COLUMN_RANGES if header.count(c) > 1]
    if twice:
        raise UserError(f"{path}: column {twice[0]} appears twice in the header (line 1)")
    table = table.iloc[1:]
    line = _find_lines(path)[1:]
    columns = {n: _parse_column(path, n, table[header.index(n)], line) for n in COLUMN_RANGES if n in header}
    if "distance" not in columns:
        raise UserError(
            f"{path}: column distance is missing in the header (line 1); columns of a road: "
            f"{', '.join(COLUMN_RANGES)}"
        )
    if "bank" not in columns and "grade" not in columns:
        raise UserError(f"{path}: column bank or grade is needed; found: {', '.join(header)[:200]}")
    check_columns(path, columns, line, "line")
    closed = columns.pop("closed", np.zeros(1))
    if np.unique(closed).size > 1 or np.isnan(closed[0]):
        raise UserError(f"{path}: column closed: must be the same in every row, 0 or 1")
    for name in PROFILE:
        columns.setdefault(name, np.full(len(table), np.nan))
    return Road(**columns, is_closed=bool(closed[0]), path=path)


def _find_lines(path: Path) -> Array:
    """Return the numbers, from 1, of the lines that are not blank. The first is the
    header. pandas skips blank lines, so its row numbers do not tell the line."""
    with open(path, encoding="utf-8-sig") as file:
        return np.flatnonzero([bool(text.strip()) for text in file]) + 1


def _parse_column(path: Path, name: str, cells: object, line: Array) -> Array:
    """Return a column as numbers, with NaN for empty cells. Raise UserError if a
    cell that is not empty is no number."""
    values = np.full(len(line), np.nan)
    for i, cell in enumerate(cells):
        text = cell.strip()
        try:
            values[i] = float(text) if text else np.nan
        except ValueError:
            raise UserError(
                f"{path}: line {line[i]}, column {name}: {text[:40]!r} is not a number; "
                f"allowed: {_format_range(name)}; only bank, grade, bank_sd and grade_sd may be empty"
            ) from None
    return values


def _format_range(name: str) -> str:
    """Format the allowed range of a column."""
    unit, low, high = COLUMN_RANGES[name]
    return f"{low:g} .. {high:g}{'' if unit == '1' else f' {unit}'}"


def check_columns(path: Path, columns: dict[str, Array], line: Array, place: str) -> None:
    """Check the columns of a road.

    `columns`: name -> values. `line`: number of each row, for error messages. `place`:
    the word that error messages put before this number: "line" if it is a line of
    road.csv, "row" if it is an index into the arrays of a Road.

    Raises
    ------
    UserError
        A column is invalid. The message states path, line or row, column and allowed
        range.
    """
    distance = columns["distance"]
    if len(distance) < 2:
        raise UserError(f"{path}: has {len(distance)} rows; a road needs at least two")
    for name, values in columns.items():
        if np.shape(values) != np.shape(distance):
            raise UserError(
                f"{path}: column {name} has {np.size(values)} values, but distance has {len(distance)}"
            )
        _, low, high = COLUMN_RANGES[name]
        with np.errstate(invalid="ignore"):
            bad = np.isinf(values) | (values < low) | (values > high)
        if bad.any():
            i = int(bad.argmax())
            raise UserError(
                f"{path}: {place} {line[i]}, column {name}: {values[i]:g} is outside the allowed range "
                f"{_format_range(name)}"
            )
    for name in [n for n in ("distance", "x", "y", "latitude", "longitude", "curvature") if n in columns]:
        empty = np.isnan(columns[name])
        if empty.any():
            raise UserError(
                f"{path}: {place} {line[empty.argmax()]}, column {name}: is empty; enter a number, "
                f"{_format_range(name)}"
            )
    back = np.diff(distance) <= 0
    if back.any():
        i = int(back.argmax()) + 1
        raise UserError(
            f"{path}: {place} {line[i]}, column distance: {distance[i]:g} m is not greater than "
            f"{distance[i - 1]:g} m in the row before; distances must increase"
        )
    for a, b in PAIRS:
        if (a in columns) != (b in columns):
            raise UserError(
                f"{path}: column {b if a in columns else a} is missing: give both {a} and {b}, or neither"
            )


def write_road(road: Road, path: Path) -> None:
    """Write road.csv atomically, with a resolution of 1 mm, 1e-6 rad and 1e-9 deg.

    Raises
    ------
    UserError
        The file cannot be written.
    """
    digits = {"distance": 3, "x": 3, "y": 3, "latitude": 9, "longitude": 9}
    names = [n for n in COLUMN_RANGES if n == "closed" or getattr(road, n) is not None]
    columns = [np.full(len(road), int(road.is_closed)) if n == "closed" else getattr(road, n) for n in names]
    texts = [
        [_format_cell(x, 0 if n == "closed" else digits.get(n, 6)) for x in c]
        for n, c in zip(names, columns, strict=True)
    ]
    with write_atomically(Path(path)) as file:
        file.write(",".join(names) + "\n")
        file.writelines(",".join(row) + "\n" for row in zip(*texts, strict=True))


def _format_cell(x: float, digits: int) -> str:
    """Format a number of road.csv with `digits` decimals; NaN becomes an empty cell."""
    return "" if np.isnan(x) else f"{x:.{digits}f}"
