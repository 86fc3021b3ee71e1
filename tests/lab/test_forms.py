"""The forms of the filter after a change of road: what README says of them."""

from __future__ import annotations

import pandas as pd
import pytest

from conftest import tselab

CHANGE, LIMIT = 20.0, 0.1  # s; share of the dry stiffness
KEYS = ("cx_front", "cy_front", "cy_rear")


def settling(folder, form: str, seed: int) -> dict[str, float]:
    """Seconds after the road changes to 70 % until the estimate stays within LIMIT."""
    done = tselab("estimate", f"log{seed}.csv", "--vehicle", "car.toml", "--form", form, "--out", "est.csv", cwd=folder)
    assert done.code == 0, done.err
    est, truth = pd.read_csv(folder / "est.csv"), pd.read_csv(folder / f"truth{seed}.csv")
    result = {}
    for key in KEYS:
        wrong = (est[key] / truth[f"true_{key}"] - 1).abs() > LIMIT
        late = est["time"][wrong & (est["time"] > CHANGE)]
        result[key] = late.max() - CHANGE if len(late) else 0.0
    return result


@pytest.mark.parametrize("seed", [1, 3])
def test_the_marginalised_form_follows_a_change_of_road_sooner(tmp_path, seed):
    (tmp_path / "car.toml").write_text(tselab("vehicle", "--example").out)
    done = tselab("simulate", "--maneuver", "square-waves", "--vehicle", "car.toml", "--road-change", f"{CHANGE}:0.7",
                  "--seed", seed, "--out", f"log{seed}.csv", "--truth", f"truth{seed}.csv", cwd=tmp_path)  # fmt: skip
    assert done.code == 0, done.err
    marginalised, default = (settling(tmp_path, form, seed) for form in ("marginalised", "default"))
    # torque steps, which show the longitudinal stiffness, come every 2.5 s: two of them, and half a second
    assert marginalised["cx_front"] <= 5.5
    assert max(marginalised["cy_front"], marginalised["cy_rear"]) <= 4.0  # a period of the steering
    assert marginalised["cx_front"] < default["cx_front"]
