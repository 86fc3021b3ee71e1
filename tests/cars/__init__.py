"""Logs of ordinary cars by a model other than tse's. See README.md."""

from .cars import CHANNELS, GRAVITY, PARAMETERS, Car, draw_car, make_clean_sensors
from .logs import COLUMNS, REFERENCE, CarLog, make_cars, make_logs
from .road import ROADS, SCENARIOS

__all__ = [
    "CHANNELS",
    "COLUMNS",
    "GRAVITY",
    "PARAMETERS",
    "REFERENCE",
    "ROADS",
    "SCENARIOS",
    "Car",
    "CarLog",
    "draw_car",
    "make_cars",
    "make_clean_sensors",
    "make_logs",
]
