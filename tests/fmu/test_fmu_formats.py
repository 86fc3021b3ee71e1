"""The estimator as an FMU in the numbers of a controller: TSE_REAL=fixed and float beside a vehicle in double."""

from __future__ import annotations

import functools
from pathlib import Path

import pytest
from fmu_support import ESTIMATOR, ROOT, VEHICLE, Instance, Unit, build, recorded_drive, scratch

PARTICLES = 64


def built(real: str) -> Path:
    """The folder of the FMUs; compiled quickly, which changes no bit."""
    return build(
        f"fmu-{real}-test", f"-DTSE_REAL={real}", f"-DTSE_MAX_PARTICLES={PARTICLES}", "-DCMAKE_BUILD_TYPE=Debug"
    )


@functools.cache  # a binary that is loaded is not to be written again
def estimator_in(real: str) -> Unit:
    return Unit(built(real) / f"{ESTIMATOR}.fmu", scratch() / real)


def golden(real: str) -> dict[int, dict[str, str]]:
    """Rows of tests/replay that the library of this format gave in C, as they are written."""
    lines = [
        s for s in (ROOT / "tests" / "replay" / f"golden_{real}.csv").read_text().splitlines() if not s.startswith("#")
    ]
    names = lines[0].split(",")[1:]
    return {int(row[0]): dict(zip(names, row[1:], strict=True)) for row in (s.split(",") for s in lines[1:])}


def name_in_fmu(column: str) -> str:
    if column.endswith("_valid"):
        return f"estimate.{column.removesuffix('_valid')}_reason"
    of_stiffness = column.startswith(("cx_", "cy_")) and not column.endswith("_spread_seen")
    return f"estimate.relative.{column}" if of_stiffness else f"estimate.{column}"


@pytest.mark.parametrize(("real", "digits"), [("fixed", 12), ("float", 9)])
def test_the_golden_drive_as_the_library_of_that_format_has_it(real: str, digits: int) -> None:
    unit, rows = estimator_in(real), golden(real)
    assert f"computes in {real}" in unit.description.description
    log = recorded_drive()
    with Instance(unit) as instance:
        instance.start({}, time=float(log.time[0]))
        for k, got in enumerate(log.through_fmu(instance)):
            if k not in rows:
                continue
            said = {column: f"{float(got[name_in_fmu(column)]):.{digits}g}" for column in rows[k]}
            assert said == rows[k], f"row {k}"
    assert len(rows) > 100


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
