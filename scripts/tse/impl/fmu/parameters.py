"""A vehicle as a parameter set of SSP (.ssv), for the estimator in any tool that connects FMUs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any
from xml.sax.saxutils import quoteattr

from tse.impl.core import Config
from tse.impl.fmu.run import setting_of

HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<ssv:ParameterSet version="1.0" name={name}
    xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"
    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon">
  <ssv:Parameters>
"""
TAIL = """  </ssv:Parameters>
</ssv:ParameterSet>
"""


def parameter_set(variables: Mapping[str, Any], config: Config, name: str) -> str:
    """Return the parameter set of a car: vehicle.calibrated, all of vehicle.*, and of the others what is not at its start.

    Parameters
    ----------
    variables
        Of the estimator's modelDescription.xml, by name.
    config
        The settings of the car.
    name
        Of the car.
    """
    values, lines = config.as_dict(), []
    for v in variables.values():
        value: float | bool = (
            True if v.name == "vehicle.calibrated" else values.get(setting_of(v.name), float(v.start or 0))
        )
        if v.causality != "parameter" or not (v.name.startswith("vehicle.") or value != float(v.start)):
            continue
        kind = {"Float64": "Real", "Int32": "Integer"}.get(v.type, v.type)
        text = "true" if kind == "Boolean" else str(int(value)) if kind == "Integer" else repr(float(value))
        lines.append(f'    <ssv:Parameter name="{v.name}"><ssv:{kind} value="{text}"/></ssv:Parameter>\n')
    return HEAD.format(name=quoteattr(name)) + "".join(lines) + TAIL
