"""What the name and unit of a vector say of it: a frequency, a part of a complex number, a coherence; and of which points.

Re(tip/hammer), tip/hammer real, |H|, H [dB], phase of H, coherence tip/hammer
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

Part = Literal["whole", "real", "imaginary", "magnitude", "phase", "coherence", "density"]

_FREQUENCY = re.compile(
    r"(?:f|freq\w*|frequenz\w*|fr[ée]quence\w*|frecven\w*|frecuencia\w*|hz|omega|w|ω)", re.IGNORECASE
)
_ANGULAR = re.compile(r"(?:omega|w|ω)\b.*", re.IGNORECASE)
_HERTZ = {"hz": 1.0, "khz": 1e3, "mhz": 1e6, "ghz": 1e9, "1/s": 1.0, "rpm": 1 / 60, "1/min": 1 / 60}
_RADIANS = {"rad/s", "rad/sec", "1rad/s", "rad s^-1", "rad*s^-1", "rad/second"}
_WORDS: dict[Part, str] = {
    "real": r"re|real|realteil|real part",
    "imaginary": r"im|imag|imaginary|imagin[äa]rteil|imaginary part",
    "magnitude": r"mag|magnitude|abs|amplitude|ampl|amp|gain|betrag|modulus|db",
    "phase": r"phase|ph|arg|angle|phi|φ|winkel",
    "coherence": r"coherence|coh|cohxy|kohärenz|koh[ae]renz|gamma2|gamma\^2|gamma²|γ²|γ2|γ\^2|msc",
    "density": r"psd|pxx|pyy|asd|power spectral density|autospectrum|auto spectrum",
}
_PREFIX = {
    part: re.compile(rf"(?:{words})(?:[\s_.:]+(?:of\s+)?|\(|\|)(?P<stem>.*?)[)|]?", re.IGNORECASE)
    for part, words in _WORDS.items()
}
_SUFFIX = {
    part: re.compile(rf"(?P<stem>.*?)(?:[\s_.:,]+\(?|\()(?:{words})\)?", re.IGNORECASE)
    for part, words in _WORDS.items()
}
_ALONE = {part: re.compile(rf"(?:{words})", re.IGNORECASE) for part, words in _WORDS.items()}
_BARS = re.compile(r"\|(?P<stem>[^|]+)\||abs\((?P<inner>.+)\)", re.IGNORECASE)
_ANGLE = re.compile(r"∠\s*(?P<stem>.*)")
_COUNTED = re.compile(r"\s*\((?:column|channel) \d+\)$")
_POINTS = re.compile(
    r"(?:[A-Za-z]\w*\s*\()?(?P<response>[^/,|>]+?)\s*(?:/|,|\||\bover\b|<-)\s*(?P<reference>[^/,|]+?)\)?"
)
_ANGLES = {"deg": "deg", "°": "deg", "degree": "deg", "degrees": "deg", "grad": "deg", "rad": "rad", "radian": "rad"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Meaning:
    """What a vector is: a part of the function that is called ``stem``."""

    part: Part
    stem: str


def frequency_scale(name: str, unit: str) -> float | None:
    """Return the factor to Hz of a vector that holds frequencies, None for any other.

    A unit that is none of frequency says that it is something else: F in N is a force.

    >>> frequency_scale("Frequency", "kHz"), frequency_scale("F", "N"), frequency_scale("f", "")
    (1000.0, None, 1.0)
    """
    plain = name.strip()
    if _FREQUENCY.fullmatch(plain.split("(")[0].strip()) is None or (plain == "F" and not unit):
        return None
    text = unit.strip().lower().replace(" ", "")
    if text in _HERTZ:
        return _HERTZ[text]
    if text in _RADIANS or (not text and _ANGULAR.fullmatch(plain)):
        return 0.15915494309189535  # 1 / (2 pi)
    return None if text else 1.0


def meaning_of(name: str, unit: str) -> Meaning:
    """Return what a vector is.

    >>> meaning_of("Re(H)", ""), meaning_of("tip/hammer", "dB")
    (Meaning(part='real', stem='H'), Meaning(part='magnitude', stem='tip/hammer'))
    """
    plain = _COUNTED.sub("", name).strip()
    if match := _BARS.fullmatch(plain):
        return Meaning(part="magnitude", stem=(match["stem"] or match["inner"]).strip())
    if match := _ANGLE.fullmatch(plain):
        return Meaning(part="phase", stem=match["stem"].strip())
    for part in _WORDS:
        for form in (_ALONE, _PREFIX, _SUFFIX):
            if match := form[part].fullmatch(plain):
                return Meaning(part=part, stem=match.groupdict().get("stem", "").strip(" _.:(|"))
    if unit.strip().lower() == "db":
        return Meaning(part="magnitude", stem=plain)
    if angle_unit(unit):
        return Meaning(part="phase", stem=plain)
    return Meaning(part="whole", stem=plain)


def angle_unit(unit: str) -> str:
    """Return deg or rad for a unit of angles, "" for any other."""
    return _ANGLES.get(unit.strip().lower(), "")


def points_of(stem: str) -> tuple[str, str]:
    """Return response and reference point; where the name has none, it is the response over ``reference``.

    >>> points_of("tip / hammer"), points_of("H(y,u)"), points_of("H")
    (('tip', 'hammer'), ('y', 'u'), ('H', 'reference'))
    """
    match = _POINTS.fullmatch(stem)
    if match:
        return match["response"].strip(), match["reference"].strip()
    return stem or "response", "reference"


def units_of(unit: str) -> tuple[str, str]:
    """Return the units of response and reference: a quotient is cut at its last line.

    >>> units_of("m/s^2/N"), units_of("mm")
    (('m/s^2', 'N'), ('mm', ''))
    """
    above, line, below = unit.replace("(", "").replace(")", "").rpartition("/")
    return (above.strip(), below.strip()) if line else (unit.strip(), "")
