"""Draw roads at random: curvature, speed, lanes, slopes, unevenness, events.

Events are ice, water and a flat tyre. Roads are given over their length on a grid of 1 m;
arrays are (points, cars). Curvature is positive to the left, grade uphill, and bank with
the left side higher (it turns the car about +x).
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from .cars import GRAVITY

KMH = 1 / 3.6
ROADS = ("highway", "mountain", "city")
LANE = 3.6  # m
TABLE = 40_000  # points of the unevenness, 0.1 m each; the road repeats itself after 4 km
# drawn in here unless it is asked for
GRADE_RMS = {"highway": (0.0, 0.02), "mountain": (0.01, 0.04), "city": (0.0, 0.02)}
SCENARIOS = {
    "dry": "nothing happens",
    "ice": "friction 0.25 .. 0.4 of the dry road's, stiffness 0.4 .. 0.65, from a place on",
    "split": "the same on one side of the car only",
    "aquaplaning": (
        "for 3 s front tyres at 0.1 .. 0.25 of friction, 0.15 .. 0.4 of stiffness, rear ones "
        "in their wake 0.4 .. 0.7"
    ),
    "low_limit": "friction 0.45 .. 0.6, the same stiffness, from a place on",
    "snow": "friction 0.4 .. 0.55 of the dry road's, stiffness 0.55 .. 0.75, from a place on",
    "wet": "friction 0.7 .. 0.85 of the dry road's, stiffness 0.75 .. 0.85, from a place on",
    "front_axle": "tyres of the front axle lose 20 % of stiffness within 20 s",
    "rear_axle": "tyres of the rear axle lose 20 % of stiffness within 20 s",
    "pressure": (
        "one tyre loses pressure over 1 .. 3 min: stiffness across 0.6 .. 0.8, along 1.0 .. "
        "1.1, radius -0.5 .. -1 %"
    ),
}

LASTS = {"aquaplaning": 3.0}  # s; all others stay


@dataclass
class Road:
    """Roads of all cars, (points, cars).

    stops: place and duration, m and s, (stops, cars); infinite: no further stop.
    """

    curvature: np.ndarray
    speed: np.ndarray
    offset: np.ndarray
    grade: np.ndarray
    bank: np.ndarray
    stop_at: np.ndarray
    stop_for: np.ndarray
    roughness: np.ndarray  # 1 per car: of the unevenness, relative to class A of ISO 8608
    starts_at: np.ndarray  # points: places in the table of unevenness, by car

    def at(self, profile: np.ndarray, place: np.ndarray) -> np.ndarray:
        """Interpolate a profile at places, m, (cars,)."""
        x = np.minimum(np.maximum(place, 0.0), len(profile) - 2.0)
        i = x.astype(np.intp)
        here = profile[i, self._cars]
        return here + (x - i) * (profile[i + 1, self._cars] - here)

    def __post_init__(self) -> None:
        self._cars = np.arange(self.curvature.shape[1])
        self._table = draw_unevenness()

    def uneven(self, place: np.ndarray) -> np.ndarray:
        """Return the height of the road, m, under left and right wheels at places of
        axles, m.

        (steps, 2 axles, cars) -> (steps, 2, 2, cars).
        """
        x = place * 10 + self.starts_at
        i = np.floor(x)
        part = (x - i)[..., None]
        i = i.astype(np.intp) % TABLE
        height = self._table[i] * (1 - part) + self._table[(i + 1) % TABLE] * part
        return np.moveaxis(height * self.roughness[:, None], -1, -2)


def draw_unevenness() -> np.ndarray:
    """Draw left and right track of class A, (TABLE, 2), m.

    ISO 8608: 16e-6 m3 at 0.1 1/m, falling with the square. One table serves all roads,
    with different starts. Waves longer than 3 m are common to both tracks, and the
    footprint of the tyre removes those below 0.3 m.
    """
    rng = np.random.default_rng(8608)
    n = np.fft.rfftfreq(TABLE, 0.1)
    density = np.where(n > 0.015, 16e-6 * (0.1 / np.maximum(n, 1e-9)) ** 2, 0) / (1 + (n / 3.0) ** 4)
    size = np.sqrt(density * (n[1] - n[0]) / 2) * TABLE

    def waves() -> np.ndarray:
        return size * (rng.standard_normal(len(n)) + 1j * rng.standard_normal(len(n))) / 2**0.5

    both, left, right = waves(), waves(), waves()
    common = 1 / (1 + (n / 0.3) ** 2)
    tracks = [
        np.fft.irfft(np.sqrt(common) * both + np.sqrt(1 - common) * own, TABLE) for own in (left, right)
    ]
    return np.stack(tracks, -1)


def _smooth(x: np.ndarray, over: float) -> np.ndarray:
    """Apply a running mean twice: the curvature then changes smoothly between arcs."""
    k = max(round(over / 2), 1)
    kernel = np.convolve(np.ones(k), np.ones(k))
    padded = np.pad(x, len(kernel) // 2, mode="edge")
    return np.convolve(padded, kernel / kernel.sum(), mode="valid")[: len(x)]


def draw_arcs(
    rng: np.random.Generator,
    n: int,
    straight: tuple[float, float],
    radius: tuple[float, float],
    turn: tuple[float, float],
    transition: float,
) -> np.ndarray:
    """Draw the curvature of straights and arcs in turn.

    Lengths of straights in m, radii in m, angles of arcs in degrees.
    """
    curvature, at = np.zeros(n), 60.0
    side = rng.choice([-1.0, 1.0])
    while at < n:
        at += np.exp(rng.uniform(*np.log(straight)))
        r = np.exp(rng.uniform(*np.log(radius)))
        length = math.radians(rng.uniform(*turn)) * r
        curvature[int(at) : int(at + length)] = side / r
        at += length
        side *= -1.0 if rng.random() < 0.7 else 1.0
    return _smooth(curvature, transition)


def draw_pieces(
    rng: np.random.Generator, n: int, length: tuple[float, float], values: tuple[float, float]
) -> np.ndarray:
    x, at = np.empty(n), 0.0
    while at < n:
        end = at + rng.uniform(*length)
        x[int(at) : int(end)] = rng.uniform(*values)
        at = end
    return x


def draw_highway(rng: np.random.Generator, n: int) -> tuple[np.ndarray, ...]:
    curvature = draw_arcs(rng, n, (150, 1500), (550, 3000), (8, 40), 100)
    limit = draw_pieces(rng, n, (400, 2500), (95 * KMH, 130 * KMH))
    for _ in range(max(1, n // 4000)):  # road works, slow traffic
        at = int(rng.uniform(200, n))
        limit[at : at + int(rng.uniform(150, 500))] = rng.uniform(80 * KMH, 95 * KMH)
    lane, at, offset = 0, 200.0, np.zeros(n)
    while at < n:
        to = 0 if lane and rng.random() < 0.8 else rng.choice([-1, 1])
        length = 30 * rng.uniform(3.5, 7.0)
        end = at + length
        s = np.arange(int(at), min(int(end), n))
        x = (s - at) / length
        offset[s] = LANE * (lane + (to - lane) * x**3 * (10 - 15 * x + 6 * x * x))
        offset[min(int(end), n) :] = LANE * to
        lane = to
        at = end + np.exp(rng.uniform(np.log(150), np.log(1500)))
    return curvature, limit, offset, np.array([]), np.array([])


def draw_mountain_road(rng: np.random.Generator, n: int) -> tuple[np.ndarray, ...]:
    curvature = draw_arcs(rng, n, (8, 120), (26, 260), (18, 130), 22)
    limit = draw_pieces(rng, n, (200, 1200), (60 * KMH, 86 * KMH))
    # corners are cut and run wide by half a metre, as people do
    offset = _smooth(np.clip(curvature * 15, -0.5, 0.5), 40)
    return curvature, limit, offset, np.array([]), np.array([])


def draw_city(rng: np.random.Generator, n: int) -> tuple[np.ndarray, ...]:
    curvature, limit, offset = np.zeros(n), np.empty(n), np.zeros(n)
    stops, waits = [1.0], [rng.uniform(2.5, 5.0)]
    at = 0.0
    while at < n:
        block = rng.uniform(70, 350)
        end = min(int(at + block), n)
        limit[int(at) :] = rng.choice([30, 50, 50, 60]) * KMH * rng.uniform(0.85, 1.1)
        if block > 150:  # a bend within the block, a parked car
            i = int(at + rng.uniform(30, 60))
            curvature[i : i + int(rng.uniform(20, 60))] = rng.uniform(-1, 1) / 60
            j = int(at + rng.uniform(60, block - 40))
            offset[j : j + int(rng.uniform(10, 25))] = rng.uniform(0.5, 1.5)
        what = rng.random()
        if what < 0.55:
            stops.append(float(end))
            waits.append(rng.uniform(1.0, 12.0))
        if what < 0.25 or what > 0.6:  # a right angle, to the left in the wider lane
            left = rng.random() < 0.5
            r = rng.uniform(9, 16) if left else rng.uniform(6.5, 10)
            length = round(r * math.pi / 2)
            curvature[end + 4 : end + 4 + length] = (1 if left else -1) * math.pi / 2 / length
            end += 8 + length
        at = end + 5.0
    return _smooth(curvature, 5), limit, _smooth(offset, 25), np.array(stops), np.array(waits)


DRAW = {"highway": draw_highway, "mountain": draw_mountain_road, "city": draw_city}
COMFORT = {"highway": (1.5, 2.5), "mountain": (2.3, 4.2), "city": (1.8, 3.2)}  # m/s2, lateral, in curves
# m/s2, where the road asks for less speed
BRAKING = {"highway": (0.8, 1.6), "mountain": (1.5, 2.8), "city": (1.3, 2.3)}
MAX_ROAD_SPEED = {"highway": 37.0, "mountain": 26.0, "city": 18.0}  # m/s, how much road is needed
MIN_ROAD_SPEED = {"highway": 22.0, "mountain": 3.0, "city": 1.5}  # m/s


def draw_waves(rng: np.random.Generator, n: int, rms: float, lengths: tuple[float, float]) -> np.ndarray:
    """Return eight sines over the length with this rms together."""
    s, x = np.arange(n), np.zeros(n)
    for _ in range(8):
        wave = np.exp(rng.uniform(*np.log(lengths)))
        x += wave * np.sin(2 * np.pi * (s / wave + rng.random()))  # long hills are high ones
    return x * (rms / max(np.sqrt(np.mean(x**2)), 1e-9))


def draw_roads(
    name: str,
    streams: list[np.random.Generator],
    duration: float,
    hills: bool,
    grade_rms: float | None,
    even: bool,
) -> Road:
    """Draw a road for each car from its own stream, long enough for a duration in s.

    Parameters
    ----------
    hills
        The road has slopes and crossfall.
    grade_rms
        rad; None: drawn.
    even
        No unevenness.
    """
    n = int(MAX_ROAD_SPEED[name] * duration) + 400
    columns = []
    for rng in streams:
        curvature, limit, offset, stops, waits = DRAW[name](rng, n)
        comfort, braking = rng.uniform(*COMFORT[name]), rng.uniform(*BRAKING[name])
        speed = np.minimum(limit, np.sqrt(comfort / np.maximum(np.abs(curvature), 1e-6)))
        rms = rng.uniform(*GRADE_RMS[name]) if grade_rms is None else grade_rms
        grade = draw_waves(rng, n, rms, (250, 2500) if name != "city" else (150, 800))
        # crossfall for rain, superelevation in curves, and what the road has of its own
        raised = -np.clip(0.2 * curvature * speed**2 / GRAVITY, -0.05, 0.05)
        bank = rng.uniform(0.0, 0.025) + _smooth(raised, 40) + draw_waves(rng, n, 0.006, (60, 600))
        roughness, start = rng.uniform(0.4, 2.2 if name != "highway" else 1.2), rng.integers(TABLE)
        flat = 1.0 if hills else 0.0
        columns.append(
            (
                curvature,
                speed,
                offset,
                flat * grade,
                flat * bank,
                stops,
                waits,
                braking,
                0.0 if even else roughness,
                start,
            )
        )
    most = max(len(c[5]) for c in columns) + 1
    stop_at, stop_for = np.full((most, len(columns)), np.inf), np.zeros((most, len(columns)))
    for i, c in enumerate(columns):
        stop_at[: len(c[5]), i], stop_for[: len(c[5]), i] = c[5], c[6]
    curvature, speed, offset, grade, bank = (np.stack([c[k] for c in columns], -1) for k in range(5))
    speed = np.maximum(speed, MIN_ROAD_SPEED[name])
    braking = np.array([c[7] for c in columns])
    square = speed**2
    for i in range(n - 2, -1, -1):  # brake in time
        np.minimum(square[i], square[i + 1] + 2 * braking, out=square[i])
    return Road(
        curvature,
        np.sqrt(square),
        offset,
        grade,
        bank,
        stop_at,
        stop_for,
        *(np.array([c[k] for c in columns]) for k in (8, 9)),
    )


class Surface:
    """The surface under each wheel in a scenario.

    It begins at a time of its own for each car, as soon as the new road can bear the
    present motion: ice in the middle of a hairpin would be an accident.
    """

    # m/s2, lateral acceleration below which it may begin
    CALM: ClassVar[dict[str, float]] = {
        "ice": 1.3, "split": 1.6, "aquaplaning": 1.0, "low_limit": 3.0, "snow": 2.0, "wet": 4.0,
        "front_axle": np.inf, "rear_axle": np.inf, "pressure": np.inf,
    }  # fmt: skip
    SLOW: ClassVar[tuple[str, ...]] = ("front_axle", "rear_axle", "pressure")  # over time, not at a place

    def __init__(
        self,
        scenario: str,
        streams: list[np.random.Generator],
        duration: float,
        event_time: float | None,
        x: np.ndarray,
    ) -> None:
        """Start without an event.

        event_time: s; None: drawn from the middle of the log. x: places of the wheels, m,
        (2, 2, cars).
        """
        n = len(streams)
        self.scenario, self.x = scenario, x
        self.time = np.full(n, np.inf)  # s, when it began
        self.place = np.full(n, np.inf)  # m, where
        self.wanted = np.full(n, np.inf)
        # factors of friction, stiffness along and across, radius: at the end
        self.end = np.ones((4, 2, 2, n))
        self.takes = np.zeros(n)  # s, of a slow change; 0: at a place of the road
        self.lasts = LASTS.get(scenario, np.inf)
        for i, rng in enumerate(streams):
            self._draw(i, rng, duration, event_time)
        self.now = np.ones((4, 2, 2, n))
        self.known = np.ones(n)  # friction as the driver has noticed it

    def _draw(self, i: int, rng: np.random.Generator, duration: float, event_time: float | None) -> None:
        u, end, scenario = rng.uniform, self.end, self.scenario
        if scenario == "dry":
            return
        self.wanted[i] = u(0.35, 0.6) * duration if event_time is None else event_time
        friction = u(0.25, 0.4)
        if scenario in ("ice", "split"):
            wheels = slice(None) if scenario == "ice" else int(rng.integers(2))
            end[0, :, wheels, i] = friction
            end[1:3, :, wheels, i] = u(0.4, 0.65)
        elif scenario == "aquaplaning":
            end[0, 0, :, i], end[0, 1, :, i] = u(0.1, 0.25), u(0.4, 0.7)
            end[1:3, 0, :, i], end[1:3, 1, :, i] = u(0.15, 0.4), u(0.4, 0.7)
        elif scenario == "low_limit":
            end[0, :, :, i] = u(0.45, 0.6)
        elif scenario in ("snow", "wet"):
            end[0, :, :, i] = u(0.4, 0.55) if scenario == "snow" else u(0.7, 0.85)
            end[1:3, :, :, i] = u(0.55, 0.75) if scenario == "snow" else u(0.75, 0.85)
        elif scenario in ("front_axle", "rear_axle"):
            end[1:3, int(scenario == "rear_axle"), :, i] = 0.8
            self.takes[i] = 20.0
        elif scenario == "pressure":
            axle, side = rng.integers(2, size=2)
            end[1:, axle, side, i] = u(1.0, 1.1), u(0.6, 0.8), 1 - u(0.005, 0.01)
            self.takes[i] = min(u(60, 180), 0.35 * duration)

    def follow(self, time: float, place: np.ndarray, lateral: np.ndarray) -> bool:
        """Update the surface at a time, s, and place, m; return whether it has changed.

        lateral: m/s2, of the car now and of the driver's next demand.
        """
        if self.scenario == "dry":
            return False
        begin = (time >= self.wanted) & np.isinf(self.time) & (lateral < self.CALM[self.scenario])
        if begin.any():
            self.time[begin], self.place[begin] = time, place[begin] + self.x[0, 0, begin]
        since = time - self.time
        if self.scenario in self.SLOW:
            share = np.clip(since / np.maximum(self.takes, 1e-3), 0, 1) * np.ones((2, 2, 1))
        else:
            share = np.clip(place + self.x - self.place, 0, 1)
            share = np.where(since > self.lasts, 0.0, share)
        self.now = 1 + (self.end - 1) * share
        self.known = np.where(since > 1.5, self.now[0].min((0, 1)), 1.0)
        return True
