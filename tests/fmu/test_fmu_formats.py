"""The estimator as an FMU in the numbers of a controller: TSE_REAL=fixed and float beside a vehicle in double."""

from __future__ import annotations

import functools
import os
import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from fmu_support import (
    ESTIMATOR,
    ROOT,
    VEHICLE,
    Instance,
    Unit,
    build,
    expect_same_rows,
    parameters_of,
    recorded_drive,
    run,
    scratch,
)

from tse.impl.files import alone
from tselab.fmu.build import lock_of

PARTICLES = 64


def built(real: str) -> Path:
    """The folder of the FMUs; compiled quickly, which changes no bit."""
    return build(
        f"fmu-{real}-test", f"-DTSE_REAL={real}", f"-DTSE_MAX_PARTICLES={PARTICLES}", "-DCMAKE_BUILD_TYPE=Debug"
    )


@functools.cache  # a binary that is loaded is not to be written again
def estimator_in(real: str) -> Unit:
    return Unit(built(real) / f"{ESTIMATOR}.fmu", scratch() / real)


@functools.cache
def library_in(real: str) -> Path:
    """The shared library of this format, likewise."""
    where = ROOT / "build" / f"lab-{real}-test"
    with alone(lock_of(where)):
        options = [f"-DTSE_REAL={real}", f"-DTSE_MAX_PARTICLES={PARTICLES}", "-DCMAKE_BUILD_TYPE=Debug"]
        generator = [] if (where / "CMakeCache.txt").is_file() or not shutil.which("ninja") else ["-G", "Ninja"]
        run("cmake", "--preset", "lab", "-B", where, *generator, *options, cwd=ROOT)
        run("cmake", "--build", where, cwd=ROOT)
    return next(p for p in (where / "src").glob("libtse.*") if p.suffix in (".so", ".dylib"))


IN_THE_LIBRARY = """
import pickle, sys
from fmu_support import expected_outputs, recorded_drive
from tse.impl.core import Config
settings, ordinary = pickle.loads(sys.stdin.buffer.read())
config = Config(settings)
if ordinary:
    config.fill("tse_config_uncalibrated")
rows = recorded_drive().through_library(config)
sys.stdout.buffer.write(pickle.dumps([expected_outputs(row, config) for row in rows]))
"""


# An ordinary car is computed in the numbers of the format; Python hands on settings of a fixed-point library in single precision.
@pytest.mark.parametrize(("real", "calibrated"), [("fixed", True), ("float", True), ("float", False)])
def test_the_recorded_drive_as_the_library_of_that_format_has_it(real: str, calibrated: bool) -> None:
    unit, settings = estimator_in(real), {"mass": 1650.0, "lf": 1.2, "driven_axle": 1}
    assert f"computes in {real}" in unit.description.description
    done = subprocess.run(
        [sys.executable, "-c", IN_THE_LIBRARY], input=pickle.dumps((settings, not calibrated)), capture_output=True,
        cwd=Path(__file__).parent, timeout=300, env={**os.environ, "TSELAB_LIBRARY": str(library_in(real))},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr.decode()
    log = recorded_drive()
    with Instance(unit) as instance:
        instance.start({**parameters_of(settings, unit), "vehicle.calibrated": calibrated}, time=float(log.time[0]))
        expect_same_rows(log.through_fmu(instance), pickle.loads(done.stdout))


def test_parameters_are_kept_to_the_edges_of_their_ranges() -> None:
    """A range ends where a number of the format may not: setting the ends is not refused, and reads back within what it holds."""
    unit = estimator_in("fixed")
    for name in ("filter.hold_speed", "vehicle.mass", "sensors.accel_x_sd"):
        v = unit.variables[name]
        for edge in (float(v.min), float(v.max)):
            with Instance(unit) as instance:
                instance.set({name: edge})
                assert instance.get([name])[name] == pytest.approx(edge, rel=2**-24, abs=2**-32)


def test_the_capacity_that_was_asked_for_is_that_of_the_binary() -> None:
    unit = estimator_in("fixed")
    assert int(unit.variables["filter.particles"].max) == PARTICLES
    with Instance(unit) as instance, pytest.raises(Exception, match="fmi2SetInteger failed"):
        instance.set({"filter.particles": PARTICLES + 1})


def test_the_vehicle_beside_it_is_the_one_of_the_double_build(vehicle: Unit) -> None:
    beside = Unit(built("fixed") / f"{VEHICLE}.fmu", scratch() / "vehicle-beside-fixed")
    assert beside.guid == vehicle.guid
    how = [(u.folder / "sources" / "buildDescription.xml").read_text() for u in (beside, vehicle)]
    assert how[0].replace(f'TSE_MAX_PARTICLES" value="{PARTICLES}"', 'TSE_MAX_PARTICLES" value="512"') == how[1]
    assert 'TSE_REAL_DOUBLE" value="1"' in how[1]
