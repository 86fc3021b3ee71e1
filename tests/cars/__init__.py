"""Logs of ordinary cars by a model other than tse's. See README.md."""

from .cars import CHANNELS, GRAVITY, PARAMETERS, Car, clean_sensors, draw_car
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
    "clean_sensors",
    "draw_car",
    "make_cars",
    "make_logs",
]
