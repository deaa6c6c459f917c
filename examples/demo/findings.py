"""What the demonstration learns: the replies of the service, as they came, and the questions that they answer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from servotune.replies import (
    ChannelData,
    Dataset,
    FrequencyResponse,
    Identification,
    Influence,
    Optimization,
    Simulation,
    Validation,
)


class DemoError(Exception):
    """The demonstration cannot go on; one sentence that says why."""


@dataclass(frozen=True, kw_only=True)
class Half:
    """One half of the active part of the chirp (s)."""

    name: str
    window: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Recording:
    """The imported recording and its active part."""

    file: str
    size: int
    dataset: Dataset
    active: tuple[float, float]
    halves: tuple[Half, Half]
    """First half (low frequencies), second half (high frequencies)."""
    preview: Mapping[str, ChannelData]

    def other(self, half: Half) -> Half:
        """Return the half that this one is checked on."""
        first, second = self.halves
        return second if half is first else first


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """One identification: which delay was free, which half it used, and the reply."""

    place: str
    half: Half
    reply: Identification

    @property
    def name(self) -> str:
        """The estimate in words."""
        return f"{PLACES[self.place]}, {self.half.name} half"

    @property
    def between(self) -> str:
        """What the command was found to do between its samples."""
        chosen = self.reply["between_samples"]
        return "linear" if chosen is None else str(chosen["chosen"])

    @property
    def scenario(self) -> dict[str, float]:
        """The estimate as parameter values; the delay that it does not have is 0."""
        absent = {f"{place}.time": 0.0 for place in PLACES}
        return absent | {name: entry["value"] for name, entry in self.reply["parameters"].items()}

    @property
    def own_fit(self) -> float:
        """FIT on the half that it was made from (%)."""
        return self.reply["fit"]["estimation"]["measured"]["fit_percent"]

    @property
    def other_fit(self) -> float:
        """FIT on the half that it has not seen (%)."""
        return self.reply["fit"]["validation"]["measured"]["fit_percent"]


PLACES = {"transport": "delay in the loop", "recording": "delay in the recording"}
"""Where the delay may sit, by the name of its block."""


@dataclass(frozen=True, kw_only=True)
class Check:
    """A validation on one half of what the other one gave, and the published model on the same half."""

    estimate: Estimate
    half: Half
    reply: Validation
    published: Validation


@dataclass(frozen=True, kw_only=True)
class Behaviour:
    """A control law in every scenario: its step responses and its frequency responses."""

    law: str
    values: Mapping[str, float]
    steps: Simulation
    loops: FrequencyResponse


@dataclass(frozen=True, kw_only=True)
class Search:
    """One optimisation."""

    law: str
    aim: str
    method: str
    reply: Optimization

    @property
    def reached(self) -> float:
        """The aim's value at the optimum, in the worst scenario."""
        value = self.reply["goals"][0]["after"]["value"]
        if value is None:
            raise DemoError(f"The {self.method} search for {self.aim} with {self.law} has no value to show for it.")
        return value


@dataclass(frozen=True, kw_only=True)
class Understanding:
    """What the recording tells: the model, how well it holds, how it behaves and what moves it."""

    recording: Recording
    estimates: tuple[Estimate, ...]
    scenarios: tuple[Estimate, ...]
    """The estimates that every result must serve; the first one is the base."""
    checks: tuple[Check, ...]
    start: Behaviour
    influence: Influence


@dataclass(frozen=True, kw_only=True)
class Findings(Understanding):
    """Everything that the report shows."""

    limits: Mapping[str, float]
    searches: tuple[Search, ...]
    tuned: Mapping[str, Behaviour]
    """The gradient's optimum of each law and aim, by "PID response_time" and so on."""
    catalog: Mapping[str, Mapping[str, Any]]
    """Title, unit and definition of every metric, from the service's catalogue."""

    @property
    def aims(self) -> list[tuple[str, str]]:
        """What was searched for, law and aim, in the order of the searches."""
        return list(dict.fromkeys((search.law, search.aim) for search in self.searches))

    def search(self, law: str, aim: str, method: str) -> Search:
        """Return the optimisation of a law for an aim by a method."""
        return next(s for s in self.searches if (s.law, s.aim, s.method) == (law, aim, method))
