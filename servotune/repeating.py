"""A lineage repeated on another installation: everything made again in its order, every number put beside the recorded one."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from servotune.bundles import Bundle
from servotune.comparing import Difference, differences
from servotune.datasets import Datasets
from servotune.errors import JobFailedError
from servotune.jobs import Job
from servotune.systems import Systems
from servotune.transport import Transport

TOLERANCE = 1e-6

_JOBS = {
    "identification": "/v1/identifications",
    "optimization": "/v1/optimizations",
    "validation": "/v1/validations",
}
_STUDIES = {
    "simulation": "/v1/simulations",
    "frequency_response": "/v1/frequency-responses",
    "frf": "/v1/frfs",
    "influence": "/v1/influence",
    "spectrum": "/v1/spectra",
    "validation": "/v1/validations",
}
_PARTS = frozenset({"dataset", "processing", "acquisition"})
"""Jobs that make a recording: they are repeated with it."""
_COMPARED_SAMPLES = 1_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Repeated:
    """One thing of a lineage, made again.

    Attributes
    ----------
    id, kind : str
        As in the bundle.
    new_id : str or None
        On this installation; None for what cannot be made again (a measurement).
    differences : tuple of Difference
        Of every number, the largest first.
    note : str
        Why nothing was compared.
    """

    id: str
    kind: str
    new_id: str | None
    differences: tuple[Difference, ...] = ()
    note: str = ""

    @property
    def largest(self) -> float:
        """The largest difference, 0 where nothing was compared."""
        return self.differences[0].difference if self.differences else 0.0


Told = Callable[[Repeated], None]


def repeat(transport: Transport, path: Path, *, told: Told = lambda _: None) -> list[Repeated]:
    """Make everything in an exported lineage again, in the order in which it was made.

    Parameters
    ----------
    transport : Transport
        To the installation on which it is made; what is made stays there.
    path : pathlib.Path
        The bundle.
    told : callable
        Takes each thing as soon as it is there.

    Raises
    ------
    BundleError
        When the file is damaged.
    ApiError
        When this installation refuses something that the other one took.
    """
    with Bundle(path) as bundle:
        run = _Run(transport, bundle)
        done = []
        for node in bundle.nodes:
            found = run.again(node)
            if found is not None:
                told(found)
                done.append(found)
    return done


Maker = Callable[[Mapping[str, Any]], Repeated]


class _Run:
    """The state of one repetition: which new identifier stands for which old one."""

    def __init__(self, transport: Transport, bundle: Bundle) -> None:
        self._transport = transport
        self._stored = Systems(transport)
        self._datasets = Datasets(transport)
        self._bundle = bundle
        self._new: dict[str, str] = {}
        self._systems: dict[str, tuple[str, int]] = {}

    def again(self, node: Mapping[str, Any]) -> Repeated | None:
        """Make one thing again; None for what is a part of another one."""
        place, kind = node["id"].partition("_")[0], node["kind"]
        if place == "job" and kind in _PARTS:
            return None
        makers: dict[str, tuple[Maker, Collection[str]]] = {
            "sys": (self._model, {"model"}),
            "ds": (self._dataset, {"dataset"}),
            "job": (self._job, _JOBS),
            "res": (self._study, _STUDIES),
        }
        if place not in makers or kind not in makers[place][1]:
            return _skipped(node, f"{kind}: this cannot be repeated; what it made is here")
        return makers[place][0](node)

    def _model(self, node: Mapping[str, Any]) -> Repeated:
        document = self._bundle.document(f"models/{node['id']}.json")["document"]
        old = node["facts"]["system"]
        origin = self._origin(node["id"])
        if old in self._systems:
            identifier, revision = self._systems[old]
            stored = self._stored.update(identifier, document, etag=f'"{revision}"', derived_from=origin)
        else:
            stored = self._stored.create(document, derived_from=origin)
        self._systems[old] = stored["id"], stored["revision"]
        self._new[node["id"]] = f"{stored['id']}@{stored['revision']}"
        return Repeated(id=node["id"], kind=node["kind"], new_id=self._new[node["id"]])

    def _origin(self, key: str) -> str | None:
        """Return the new identifier of the job or study that a revision says its numbers come from."""
        sources = [edge["from"] for edge in self._bundle.manifest["edges"] if edge["to"] == key]
        return next((self._new[s] for s in sources if s.startswith(("job_", "res_")) and s in self._new), None)

    def _dataset(self, node: Mapping[str, Any]) -> Repeated:
        folder = f"datasets/{node['id']}"
        recorded = self._bundle.document(f"{folder}/dataset.json")
        document = self._renamed(recorded["document"] or {})
        if recorded["format"] != "processed" and not self._bundle.has(f"{folder}/original"):
            return _skipped(node, f"its file was left out where it came from; its samples are in {folder}/channels")
        if self._bundle.has(f"{folder}/original"):
            made = self._sent(document, f"{folder}/original")
        else:
            made = self._processed(document)
        self._new[node["id"]] = made["id"]
        found = list(differences({"sample_count": recorded["sample_count"]}, made))
        if not self._bundle.has(f"{folder}/original"):
            found += self._samples(folder, recorded["channels"], made["id"])
        return _compared(node, made["id"], found)

    def _sent(self, document: Mapping[str, Any], name: str) -> dict[str, Any]:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "original"
            self._bundle.copy(name, path)
            return cast("dict[str, Any]", self._datasets.upload(document, path))

    def _processed(self, document: Mapping[str, Any]) -> dict[str, Any]:
        made = self._post("/v1/processings", document)
        if made.get("job"):
            Job[Any](self._transport, made["job"]).wait(progress=False)
        return cast("dict[str, Any]", self._datasets.get(made["id"]))

    def _samples(self, folder: str, channels: list[Mapping[str, Any]], identifier: str) -> Iterator[Difference]:
        for number, channel in enumerate(channels):
            name = str(channel["name"])
            recorded = self._bundle.numbers(f"{folder}/channels/{number}.f64")[:_COMPARED_SAMPLES]
            there = self._datasets.channel(identifier, name)
            yield from differences({name: list(recorded)}, {name: there.get("values", [])[:_COMPARED_SAMPLES]})

    def _post(self, path: str, document: Mapping[str, Any], headers: Mapping[str, str] | None = None) -> Any:
        return self._transport.post(path, document, creates=True, headers=headers)

    def _job(self, node: Mapping[str, Any]) -> Repeated:
        kept = self._bundle.document(f"jobs/{node['id']}.json")
        request = self._request(kept["body"]["request"], kept["body"].get("system_reference"))
        headers = {"Prefer": "respond-async"} if node["kind"] == "validation" else None
        job = Job[Any](self._transport, self._post(_JOBS[node["kind"]], request, headers))
        self._new[node["id"]] = job.id
        try:
            result = job.wait(progress=False)
        except JobFailedError as error:
            if kept["result"] is None:
                return _skipped(node, f"it failed then, and fails now: {error.detail}", new_id=job.id)
            raise
        if kept["result"] is None:
            return _skipped(node, "it had no result", new_id=job.id)
        return _compared(node, job.id, list(differences(kept["result"], result)))

    def _study(self, node: Mapping[str, Any]) -> Repeated:
        kept = self._bundle.document(f"studies/{node['id']}.json")
        request = self._request(kept["request"], kept["result"].get("system"))
        result = self._post(_STUDIES[node["kind"]], request)
        self._new[node["id"]] = str(result.get("id"))
        return _compared(node, result.get("id"), list(differences(kept["result"], result)))

    def _request(self, request: Mapping[str, Any], reference: Mapping[str, Any] | None) -> dict[str, Any]:
        """Return a request with new identifiers, and the stored model where it is at the revision that was used."""
        asked: dict[str, Any] = self._renamed(dict(request))
        if reference is not None:
            key = f"{reference['id']}@{reference['revision']}"
            system = self._systems.get(str(reference["id"]))
            if system is not None and self._new.get(key) == f"{system[0]}@{system[1]}":
                asked["system"] = system[0]
            else:
                asked["system"] = self._bundle.document(f"models/{key}.json")["document"]
        return asked

    def _renamed(self, value: Any) -> Any:
        """Return a document in which every identifier of the bundle is the new one."""
        match value:
            case dict():
                return {key: self._renamed(item) for key, item in value.items()}
            case list():
                return [self._renamed(item) for item in value]
            case str():
                return self._new.get(value, value)
        return value


def _skipped(node: Mapping[str, Any], note: str, *, new_id: str | None = None) -> Repeated:
    return Repeated(id=node["id"], kind=node["kind"], new_id=new_id, note=note)


def _compared(node: Mapping[str, Any], new_id: str | None, found: list[Difference]) -> Repeated:
    ordered = tuple(sorted(found, key=lambda difference: -difference.difference))
    return Repeated(id=node["id"], kind=node["kind"], new_id=new_id, differences=ordered)
