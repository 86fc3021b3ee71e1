"""The simulator from the shell: formats, and properties of the truth worked out by hand."""

import numpy as np
import pandas as pd
import pytest

from conftest import tselab, tselab_here
from tse.impl.maneuvers import KINDS

LOG = ["time", "steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_x", "accel_y", "yaw_rate"]


def simulate(folder, *options, run=tselab_here):
    done = run("simulate", "--out", folder / "log.csv", "--truth", folder / "truth.csv", *options)
    assert done.code == 0, done.err
    return pd.read_csv(folder / "log.csv"), pd.read_csv(folder / "truth.csv")


@pytest.mark.parametrize("name", KINDS)
def test_every_manoeuvre_gives_a_log_that_estimate_reads(name, tmp_path):
    from tse.impl.logs.log import read_log

    log, truth = simulate(tmp_path, "--maneuver", name, "--duration", 12)
    assert list(log) == LOG
    assert len(log) == len(truth) == 1201
    assert np.isfinite(truth.to_numpy()).all()
    assert truth["true_vel_x"].between(-0.05, 40).all()
    assert len(read_log(tmp_path / "log.csv")) == 1201


def test_same_seed_same_bytes_other_seed_other_bytes(tmp_path):
    contents = []
    for i, seed in enumerate((7, 7, 8)):
        (tmp_path / str(i)).mkdir()
        simulate(tmp_path / str(i), "--maneuver", "straight", "--duration", 3, "--seed", seed, run=tselab)
        contents.append((tmp_path / str(i) / "log.csv").read_bytes())
    assert contents[0] == contents[1] != contents[2]


def test_noise_and_spread_are_what_was_asked_for(drive):
    log, truth = pd.read_csv(drive.log), pd.read_csv(drive.truth)
    n = len(log)
    for name, sd in (("accel_x", 0.15), ("accel_y", 0.15), ("yaw_rate", np.deg2rad(0.2))):
        residual = log[name] - truth[f"true_{name}"]
        assert abs(residual.mean()) < 4 * sd / np.sqrt(n)
        assert residual.std() == pytest.approx(sd, rel=4 / np.sqrt(2 * n))
    for name, nominal in (("cx_front", 1.6e5), ("cy_front", 1.2e5), ("cy_rear", 1.4e5)):
        assert (truth[f"true_{name}"] == nominal).all()
        drawn = truth[f"drawn_{name}"] / nominal
        assert abs(drawn.mean() - 1) < 4 * 0.05 / np.sqrt(n)
        assert drawn.std() == pytest.approx(0.05, rel=4 / np.sqrt(2 * n))


def test_step_steer_reaches_the_yaw_rate_of_the_textbook(tmp_path):
    _, truth = simulate(tmp_path, "--maneuver", "step-steer", "--spread", 0, "--noise", 0, "--amplitude", 0.01)
    end = truth.iloc[-100:].mean()
    mass, lf, lr, cf, cr = 1900.0, 1.25, 1.5, 1.2e5, 1.4e5
    understeer = mass / (lf + lr) * (lr / cf - lf / cr)  # rad s2/m
    v = end["true_vel_x"]
    assert end["true_yaw_rate"] == pytest.approx(v * 0.01 / (lf + lr + understeer * v**2), rel=0.003)
    assert end["true_accel_y"] == pytest.approx(v * end["true_yaw_rate"], rel=0.003)
    assert v == pytest.approx(20, abs=0.3)


def test_drive_torque_accelerates_mass_and_wheels(tmp_path):
    _, truth = simulate(tmp_path, "--maneuver", "square-waves", "--amplitude", 0, "--spread", 0, "--noise", 0, "--duration", 2.4)
    a = np.polyfit(truth["time"][50:], truth["true_vel_x"][50:], 1)[0]
    assert a == pytest.approx(700 / 0.33 / (1900 + (2.4 + 2.4) / 0.33**2), rel=0.005)


def test_constant_radius_holds_its_radius(tmp_path):
    _, truth = simulate(tmp_path, "--maneuver", "constant-radius", "--spread", 0, "--noise", 0, "--amplitude", 80)
    later = truth[truth["time"] > 10]
    radius = np.hypot(later["true_vel_x"], later["true_vel_y"]) / later["true_yaw_rate"]
    assert radius.mean() == pytest.approx(80, rel=0.02)
    assert later["true_vel_x"].iloc[-1] == pytest.approx(np.sqrt(4 * 80), rel=0.02)


def test_stop_and_go_stands_still_and_goes_again(tmp_path):
    _, truth = simulate(tmp_path, "--maneuver", "stop-and-go", "--duration", 30)
    speed = truth.set_index("time")["true_vel_x"]
    assert speed.loc[16.5:19.5].abs().max() < 0.02
    assert speed.loc[9] == pytest.approx(12, abs=0.5)
    assert speed.loc[28] == pytest.approx(12, abs=0.5)


def test_road_change_changes_the_truth_from_its_time_on(tmp_path):
    _, truth = simulate(tmp_path, "--maneuver", "straight", "--duration", 6, "--road-change", "2:0.7", "--road-change", "4:0.4")
    level = truth["true_cy_front"] / 1.2e5
    assert level[truth["time"] < 1.99].to_numpy() == pytest.approx(1.0)
    assert level[truth["time"].between(2.02, 3.98)].to_numpy() == pytest.approx(0.7)
    assert level[truth["time"] > 4.02].to_numpy() == pytest.approx(0.4)


def test_true_bias_is_in_the_log(tmp_path):
    log, truth = simulate(tmp_path, "--maneuver", "straight", "--duration", 5, "--noise", 0, "--set", "true_bias_yaw_rate=0.02")
    assert (log["yaw_rate"] - truth["true_yaw_rate"]).to_numpy() == pytest.approx(0.02, abs=1e-6)
