"""A vehicle as a parameter set of SSP (.ssv), for the estimator in any tool that connects FMUs."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

from tse.impl.core import Config
from tse.impl.errors import NoFile, UserError

HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<ssv:ParameterSet version="1.0" name={name}
    xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"
    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon">
  <ssv:Parameters>
"""
TAIL = """  </ssv:Parameters>
</ssv:ParameterSet>
"""
CALIBRATED = "vehicle.calibrated"  # a parameter of the estimator alone


class Parameter(NamedTuple):
    """One of a modelDescription.xml."""

    name: str
    kind: str  # as SSP calls it
    start: str


def parameters_of(fmu: Path) -> list[Parameter]:
    """Read the parameters of the estimator FMU, of FMI 2.0 or 3.0."""
    try:
        with zipfile.ZipFile(fmu) as archive:
            root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    except FileNotFoundError:
        raise NoFile(f"{fmu}: no such file") from None
    except Exception as error:  # whatever zip and XML say of whatever stands there
        raise UserError(f"{fmu}: is not an FMU: {error}") from None
    found = []
    for variable in root.iterfind("ModelVariables/*"):
        value = variable[0] if variable.tag == "ScalarVariable" else variable
        kind = {"Float64": "Real", "Int32": "Integer"}.get(value.tag, value.tag)
        if variable.get("causality") == "parameter":
            found.append(Parameter(variable.get("name", ""), kind, value.get("start", "0")))
    if CALIBRATED not in [p.name for p in found]:
        raise UserError(f"{fmu}: is not the estimator")
    return found


def parameter_set(parameters: Iterable[Parameter], config: Config, name: str) -> str:
    """Return the parameter set of a car: vehicle.calibrated, all of vehicle.*, and of the others what is not at its start.

    Parameters
    ----------
    parameters
        Of the estimator.
    config
        The settings of the car. The parameter effects.body_roll.gain is the setting body_roll_gain.
    name
        Of the car.
    """
    values, lines = config.as_dict(), []
    for p in parameters:
        if p.name == CALIBRATED:
            text = "true"
        else:
            value = values.get(p.name.partition(".")[2].replace(".", "_"), float(p.start))
            if not p.name.startswith("vehicle.") and value == float(p.start):
                continue
            text = str(int(value)) if p.kind == "Integer" else repr(float(value))
        lines.append(f'    <ssv:Parameter name="{p.name}"><ssv:{p.kind} value="{text}"/></ssv:Parameter>\n')
    return HEAD.format(name=quoteattr(name)) + "".join(lines) + TAIL
