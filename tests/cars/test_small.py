"""The build with TSE_SMALL on a drive, against double and the full filter."""

import numpy as np
import pytest

from scripts.dev.fixed import build_library
from tests.cars.cache import make_logs_once
from tse.car.config import make_config
from tse.car.vehicle import read_vehicle
from tse.channels.log import read_log
from tse.library.core import STIFFNESS, Config, NativeFilter

pytestmark = pytest.mark.slow

CORNERING = STIFFNESS[1:]


@pytest.fixture(scope="module")
def estimates(tmp_path_factory):
    """Estimate a minute in the mountains by both builds in double and the small one in
    fixed point."""
    folder = tmp_path_factory.mktemp("drive")
    make_logs_once("mountain", minutes=1, cars=1, seed=5, hills=False)[0].write(folder, "mountain")
    log = read_log(folder / "log_mountain.csv")
    config, _ = make_config(read_vehicle(folder / "car.toml"), log)
    builds = {
        "full": build_library("double"),
        "small": build_library("double", small=True),
        "fixed": build_library("fixed", small=True),
    }
    return {
        who: NativeFilter(Config.exact(config.as_dict(), lib=lib)).estimate_rows(log.rows())
        for who, lib in builds.items()
    }


def test_fixed_point_follows_double_within_5_per_cent_of_the_sd(estimates):
    for key in CORNERING:
        apart = (estimates["fixed"][key].astype(float) - estimates["small"][key]) / estimates["small"][
            f"{key}_sd"
        ]
        assert np.abs(apart).max() < 0.05, key


def test_the_small_state_is_in_the_interval_of_the_full_one_and_valid_no_sooner_than_sure(estimates):
    full, small = estimates["full"], estimates["small"]
    for key in CORNERING:
        both = np.hypot(full[f"{key}_sd"], small[f"{key}_sd"])
        assert (np.abs(small[key] - full[key]) < 1.96 * both).mean() > 0.95, key
        valid = small[f"{key}_valid"] == 0
        assert (small[f"{key}_sd"][valid] <= 0.1001 * small[key][valid]).all(), key


def test_longitudinal_stiffness_is_never_valid(estimates):
    assert (estimates["small"]["cx_front_valid"] != 0).all()
    assert np.ptp(estimates["small"]["cx_front"]) == 0
