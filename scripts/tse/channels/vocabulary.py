"""Score how well the name of a signal describes a role.

A role is a quantity that a signal may measure. The words are those of manufacturers, ISO
8855, openpilot and ROS, in English, German, French, Spanish and Italian. The score is 3
if the name describes exactly the role, 2 if it probably does, 1 if it possibly does, and
0 if it does not. If the name describes the role, but also has a word for a different
quantity, 4 is subtracted: "yaw rate offset" is not a yaw rate, and has a score below 0.
"""

import functools
import re

from tse.readers.recording import last_part
from tse.readers.table import split_words

# Role -> patterns, each with its score. The words of a name are joined by blanks and
# compared with each pattern. The score of the name is that of its best matching pattern.
ROLE_WORDS: dict[str, tuple[tuple[str, float], ...]] = {
    "yaw_rate": (
        (
            r"yaw w\b|yaw ?rate|yaw ?rt|yaw ?vel|yaw ?speed|gier ?rate|gier ?geschw|"
            r"giergeschwindigkeit|psi ?(p|dot|d)\b|d ?psi|vitesse lacet|velocidad guinada|"
            r"(rate|vel\w*|omega|gyro\w*) yaw",
            3.0,
        ),
        (
            r"angular velocity z|angular velocity device z|angular rate z|ang vel z|"
            r"(gyro\w*|gyr|omega|rate|w|rot\w*) ?z\b|rate ?z|imu ?wz|\bwz\b|rotation rate z|"
            r"gyro uncalibrated v 2|lacet|imbardata|guinada|drehrate",
            2.5,
        ),
        (r"\byaw\b|\bgier|\br\b|turn rate", 1.2),
    ),
    "accel_y": (
        (
            r"lat\w* ?acc\w*|acc\w* ?lat\w*|lateral ?g\b|quer ?beschl\w*|beschl\w* ?quer|"
            r"\ba ?lat\d?\b|\bay\b|\ba y\b|acc\w* ?y\b|linear acceleration y|\bg ?lat\b|lat ?g\b|"
            r"veh ?lat\w*( ?comp)? a\b|acc ?lat|\bgy\b|\by ?acc\w*|aquer|a ?quer|"
            r"accel\w* transversal\w*|acceleration laterale|accelerazione laterale|beschl\w* y|"
            r"\by ?beschl\w*|latacc",
            3.0,
        ),
        (r"lateral|\bquer|transvers", 1.2),
    ),
    "accel_x": (
        (
            r"\ba ?lgt\d?\b|lng ?acc\w*|lon\w* ?acc\w*|lgt ?acc\w*|acc\w* ?lon\w*|"
            r"laengs ?beschl\w*|längs ?beschl\w*|lngs ?beschl\w*|beschl\w* ?l(ä|ae)?ngs|"
            r"\ba ?lon\w*\b|\bax\b|\ba x\b|acc\w* ?x\b|linear acceleration x|\bg ?lon\w*\b|"
            r"\blon\w* g\b|\blongg\b|veh ?lon\w*( ?comp)? a\b|\bgx\b|\bx ?acc\w*|a ?l(ä|ae)ngs|"
            r"accel\w* longitudinal\w*|acceleration longitudinale|beschl\w* x|\bx ?beschl\w*|"
            r"longacc|\ba ego\b",
            3.0,
        ),
        (r"longitudinal|\bl(ä|ae)ngs", 1.2),
    ),
    "steer_angle": (
        (
            r"internal ?sas|steer\w* ?(whl|wheel|wh|w)? ?ang\w*|\bstr ?(whl|wheel|wh)? ?ang\w*|"
            r"str?g ?(whl|wheel|wh)? ?ang?\w*|lenk ?rad ?winkel|lenk ?winkel|\bswa\b|\blrw\b|"
            r"\blw ?(wi)?\b|steer\w* ?(whl|wheel)? ?pos\w*|st ?whl ?ang\w*|sas ?ang\w*|"
            r"ang\w* ?(volant|volante|sterzo|direccion)|(road ?wheel|front ?wheel) ?ang\w*|"
            r"hand ?wheel ?(ang\w*|pos\w*)|eps ?ang\w*|delta ?(h|sw|lrw|f|v|steer)\b|\bdf\b|"
            r"steer\w* deg|steering wheel|angle steer\w*|ang ?steer\w*",
            3.0,
        ),
        (r"\bdelta\b|steer|lenk|volant|sterzo|strg|\bsteering\b|\bangle\b", 1.5),
    ),
    "speed": (
        (
            r"veh\w* ?(spd|speed|vel\w*)|car ?speed|fzg ?geschw\w*|fahrzeug ?geschw\w*|v ?fzg|"
            r"v ?veh|v ?ego\b|v ?ref\b|vel ?x|vx\b|v x\b|speed ?(over)? ?ground|gps ?(spd|speed)|"
            r"gnss ?(spd|speed)|esp v signal|geschwindigkeit|vitesse vehicule|velocidad|velocita|"
            r"twist linear x|ground ?speed",
            3.0,
        ),
        (r"\bspeed\b|\bspd\b|\bv\b|\bgeschw|\bvelocity\b|\bvel\b", 1.5),
    ),
    "accel_z": (
        (
            r"acc\w* ?z\b|\baz\b|\ba z\b|vert\w* ?acc\w*|linear acceleration z|"
            r"vertikal\w*beschl\w*|\bz ?acc",
            3.0,
        ),
    ),
    "latitude": ((r"\blatitude\b|\bgps lat\b|\bgnss lat\b|\blat deg\b", 3.0), (r"\blat\b|breitengrad", 2.0)),
    "longitude": (
        (r"\blongitude\b|\bgps lon\w?\b|\bgnss lon\w?\b|\blon deg\b", 3.0),
        (r"\blon\b|\blng\b|l(ä|ae)ngengrad", 2.0),
    ),
    "heading": (
        (r"\bheading\b|\bcourse\b|\btrack angle\b|\byaw angle\b|\bbearing\b|kurswinkel|\bpsi\b", 3.0),
    ),
}
# Role -> words that show that a name describes a different quantity, although it also has
# words of the role. If a name has such a word, 4 is subtracted from its score.
NOT_ROLE_WORDS = {
    "yaw_rate": (
        r"acc\w*|angle|ang\b|target|req\w*|soll|ref\b|offset|bias|qual\w*|valid|status|stat\b|"
        r"conf\w*|std|sd\b|var\b|cov\w*|temp\w*|raw off\w*|model|limit|torque|moment|counter|"
        r"\bbz\b|qbit|gps|gnss|display|calc|est\b"
    ),
    "accel_y": (
        r"speed|spd|velocity|vel\b|target|req\w*|soll|ref\b|offset|bias|qual\w*|valid|status|"
        r"stat\b|std|sd\b|var\b|cov\w*|temp\w*|limit|jerk|ruck|model|qbit|gyro|rate|pedal|display|"
        r"calc|est\b|dist\w*|gain|latitude"
    ),
    "accel_x": (
        r"speed|spd|velocity|vel\b|target|req\w*|soll|ref\b|offset|bias|qual\w*|valid|status|"
        r"stat\b|std|sd\b|var\b|cov\w*|temp\w*|limit|jerk|ruck|model|qbit|gyro|rate|pedal|display|"
        r"calc|est\b|gain|longitude"
    ),
    "steer_angle": (
        r"rate|spd|speed|geschw\w*|vel\w*|torque|tq|trq|moment\w*|target|req\w*|soll|des\w*|cmd|"
        r"command|offset|bias|qual\w*|valid|status|stat\b|ratio|qbit|vz\b|sign|limit|yaw|slip|"
        r"heading|gps|pinion|motor|temp\w*|counter|rear|current|blink\w*|cal\b|calib\w*|pitch|roll|"
        r"lean|bank|camber|slope|incl\w*|grad\w*|tilt|gears?|gang|throttle|pedal|crank\w*|cam|"
        r"ignition|spark|timing|sideslip|attack|azimuth|elevation|course|lat\w*|lon\w*|phase|true|"
        r"imu|jerk"
    ),
    "speed": (
        r"target|cmd|command|req\w*|soll|set|cruise|acc\b|limit|display|eng\w*|motor|rpm|fan|wind|"
        r"offset|qual\w*|valid|status|std|sd\b|var\b|cov\w*|yaw|angular|steer\w*|gear|turbine|"
        r"wheel|whl|rad\b|wiper|down|east|north|vert\w*|lat\w*|vy\b|vz\b|accuracy|diff\w*"
    ),
    "accel_z": r"gyro|rate|offset|std|var|cov",
    "latitude": r"acc\w*|g\b|lateral|rate|std|sd\b|dist\w*|vel\w*|force|error",
    "longitude": r"acc\w*|g\b|longitudinal|rate|std|sd\b|dist\w*|vel\w*|force|error",
    "heading": r"rate|target|std|acc\w*|rms",
}
# Words for quantities other than the motion of the car. A signal with such a word gets a
# role only if its name also describes the role (score 1 or more). A correlation with the
# motion does not suffice, since it may be by chance. SPEED_WORDS are used in the same way
# for all roles except "speed".
OTHER_WORDS = re.compile(
    r"\b(gears?|gang|ganganzeige|rpm|drehzahl|nmot|throttle|pedal|accelerator|gas|aps|clutch|kupplung|"
    r"temp\w*|press\w*|druck|laps?|runde|fuel|tank|batt\w*|volt\w*|satellites?|sats|[hpv]dop|"
    r"altitude|height|hoehe|dist\w*|odo\w*|mileage|counter|crc|checksum|lambda|afr|boost|oil|"
    r"coolant|pitch|roll|engine|latitude|longitude|date|fragment|session|index|accuracy|humidity|"
    r"wiper|door|fan|ignition|spark|camber|gradient|slope|azimuth)\b"
)
SPEED_WORDS = re.compile(r"\b(speed|spd|velocity|geschw\w*|kmh|kph|mph|knots)\b")
# Wheel or axle -> pattern of its name. The name may be a word, or the end of a word.
PLACE_WORDS = {
    "front_left": (
        r"fl|lf|vl|fr ?l|frt ?l|front ?left|left ?front|vorne? ?links|vo ?li|avg|av ?g|frnt ?lft|"
        r"lft ?frnt|f ?l|l ?f|fr ?lt|delantera izquierda|anteriore sinistra|di"
    ),
    "front_right": (
        r"fr|rf|vr|frt ?r|fr ?r|front ?right|right ?front|vorne? ?rechts|vo ?re|avd|av ?d|"
        r"frnt ?rght|rght ?frnt|f ?r|r ?f|fr ?rt|delantera derecha|anteriore destra|dd"
    ),
    "rear_left": (
        r"rl|lr|hl|re ?l|rr ?l|bck ?l|rear ?left|left ?rear|hinten ?links|hi ?li|arg|ar ?g|rr ?lft|"
        r"lft ?rr|r ?l|l ?r|re ?lt|trasera izquierda|posteriore sinistra|ti|bl"
    ),
    "rear_right": (
        r"rr|hr|re ?r|bck ?r|rear ?right|right ?rear|hinten ?rechts|hi ?re|ard|ar ?d|rr ?rght|"
        r"rght ?rr|r ?r|re ?rt|trasera derecha|posteriore destra|td|br"
    ),
    "front": r"front|vorne?|va|avant|fa|frnt|delantero|anteriore",
    "rear": r"rear|hinten|ha|arriere|ra|trasero|posteriore",
}
AXLES = ("front", "rear")
WHEEL_WORDS = re.compile(
    r"wheel|whl|\brad\b|\brad(?=[vh][lr])|raddreh|radgeschw|wss|wsp|\bws\b|\bws(?=[fvrhl][lr]\b)|"
    r"\bnrad|roue|rueda|ruota|omega|\bwheels?\b|abs|\bn\b|\bv\b|drehzahl|\bspeed\b|\bspd\b|\brw\b|"
    r"\bvrad|wspd|whlspd|wheelspeed|\bvel"
)
NO_WHEEL_WORDS = re.compile(
    r"torque|trq|\btq\b|moment|press\w*|druck|temp\w*|brake|brems|slip|schlupf|accel|beschl|"
    r"qual\w*|valid|status|stat\b|counter|puls\w*|impuls\w*|ticks?|dir\w*|richtung|height|susp\w*|"
    r"tpms|tire|tyre|reifen|susp|damper|\bfx\b|\bfy\b|\bfz\b|force|target|soll|qbit|seat|door|"
    r"window|mirror|steer\w*|angle|winkel|radius|raw cnt|edge"
)


@functools.lru_cache(maxsize=4096)
def join_words(name: str) -> str:
    """Return the words of a name in lower case, joined by blanks.

    `name` may be a signal, or MESSAGE.SIGNAL, or a ROS topic with a signal."""
    return " ".join(split_words(name))


@functools.lru_cache(maxsize=65536)
def score_name(role: str, name: str) -> float:
    """Return the score of a name for a role.

    If a pattern matches the last part of the name, the name gets the score of the
    pattern. If the pattern matches only the whole name, which includes topic and message,
    the score is reduced by 0.2. A word of NOT_ROLE_WORDS in the last part reduces the
    score by 4."""
    last = last_part(name)
    text, end = join_words(name), join_words(last)
    best = max((s for p, s in ROLE_WORDS[role] if re.search(p, end)), default=0.0)
    if best < 3.0:
        best = max([best, *(s - 0.2 for p, s in ROLE_WORDS[role] if re.search(p, text))])
    if best and re.search(rf"\b({NOT_ROLE_WORDS[role]})", end):
        best -= 4.0
    return best


@functools.lru_cache(maxsize=65536)
def is_another_thing(role: str, name: str) -> bool:
    """Return whether the name of a signal describes a quantity other than the role."""
    if score_name(role, name) >= 1.0:
        return False
    text = join_words(name)
    return bool(OTHER_WORDS.search(text) or (role != "speed" and SPEED_WORDS.search(text)))


@functools.lru_cache(maxsize=65536)
def find_place(name: str) -> tuple[str, float]:
    """Return the wheel or axle whose speed a name describes, and the score of the name.

    The score is at most 3. It is high if the name clearly describes the speed of this
    wheel or axle. If the name describes no such speed, return ("", 0)."""
    last = last_part(name)
    text, end = join_words(name), join_words(last)
    if NO_WHEEL_WORDS.search(end):
        return "", 0.0
    wheel = bool(WHEEL_WORDS.search(text))
    for part in (end, text):
        found = _match_place(part, wheel)
        if found[0]:
            return found
    return "", 0.0


# Patterns for names without separators, such as FLwhlspd, LFspeed and whlflspd. CORNERS
# matches the place of the wheel (fl), OF_A_WHEEL the word after the place (whl, spd).
OF_A_WHEEL = r"wheel|whl|wh|wss|wsp|ws|spd|speed|vel|rad|rpm|geschw|rot|omega"
CORNERS = {
    "front_left": r"fl|lf|vl|frontleft|leftfront|frontl|lfront",
    "front_right": r"fr|rf|vr|frontright|rightfront|frontr|rfront",
    "rear_left": r"rl|lr|hl|bl|rearleft|leftrear|rearl|lrear|backleft",
    "rear_right": r"rr|hr|br|rearright|rightrear|rearr|rrear|backright",
}


def _match_corner(joined: str) -> str:
    """Return the place of the wheel that a name like FLwhlspd or whlflspd contains; "" if
    the name contains no place.

    `joined`: the words of the name without blanks."""
    for place, pattern in CORNERS.items():
        if re.match(rf"({pattern})({OF_A_WHEEL})", joined) or re.search(
            rf"(wheel|whl|rad|ws|tire|tyre)({pattern})({OF_A_WHEEL})", joined
        ):
            return place
    return ""


def _match_place(end: str, wheel: bool) -> tuple[str, float]:
    """Return the wheel or axle in the words of a name, and the score of the name. Return
    ("", 0) if the words name no wheel or axle.

    `wheel`: the name has a word of WHEEL_WORDS."""
    joined = end.replace(" ", "")
    corner = _match_corner(joined)
    for place, pattern in PLACE_WORDS.items():
        if corner and place in AXLES:
            return corner, 2.7
        worth = 3.0 if wheel else 1.0
        if re.search(rf"\b({pattern})\b", end):
            return place, worth if len(place) > 5 or wheel else 0.0
        if (
            len(place) > 5
            and wheel
            and re.search(
                rf"(rad|wheel|whl|speed|spd|ws|wss|wsp|n|v|vel|roue|vrad|nrad)_?({pattern})(kmh|rpm|rads|mps|ms)?$",
                joined,
            )
        ):
            return place, worth - 0.3
    return (corner, 2.7) if corner else ("", 0.0)
