"""Names as logs have them: units in brackets or at the end, words in them."""

from __future__ import annotations

import re

from tse.impl.logs.units import known

_BRACKETS = re.compile(r"^(.*?)\s*[\[\(\{<]\s*([^\[\]\(\)\{\}<>]*)\s*[\]\)\}>]\s*$")
_AT_END = {  # suffix after _ or a capital -> unit
    "kmh": "km/h", "kph": "km/h", "mph": "mph", "mps": "m/s", "rpm": "rpm", "rads": "rad/s", "radps": "rad/s", "radpers": "rad/s",
    "degs": "deg/s", "degps": "deg/s", "dps": "deg/s", "deg": "deg", "degrees": "deg", "rad": "rad", "mps2": "m/s2", "mpss": "m/s2",
    "ms2": "m/s2", "g": "g",
}  # fmt: skip


def with_unit(name: str) -> tuple[str, str]:
    """Name and unit of "Speed [km/h]"; "" where there is none in brackets."""
    found = _BRACKETS.match(name.strip())
    if found and found[1]:
        unit = found[2].strip()
        if known(unit) or unit in ("", "-", "1"):
            return found[1].strip(), unit
    return name.strip(), ""


def unit_at_end(name: str) -> str:
    """The unit that the last word of a name is: vx_kmh, steeringAngleDeg; "" where it is none."""
    last = (words(name) or [""])[-1]
    return _AT_END.get(last, "") if len(words(name)) > 1 else ""


def words(name: str) -> list[str]:
    """Words of a name, lower case: ESP_v_Signal_VL -> esp v signal vl; wheelSpeedFL -> wheel speed fl; AccelX -> accel x."""
    text = re.sub(r"([a-z0-9])([A-Z])", r"\1 \2", name)
    text = re.sub(r"([A-Z]+)([A-Z][a-z])", r"\1 \2", text)
    return [w for w in re.split(r"[^a-zäöüß0-9]+", text.lower()) if w]
