"""System documents that the service keeps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime

from servotune.documents import Document, SystemLike, given
from servotune.replies import StateSpace, Stored
from servotune.transport import Transport

_LONGEST_NAME = 200
"""Letters of a name that a list is narrowed by."""


class Systems:
    """System documents that the service keeps; every change is a new revision."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def create(self, document: Document, *, derived_from: str | None = None) -> Stored:
        """Store a document and return it with its id; `derived_from` is the job that its numbers come from, for the lineage."""
        params = given(derived_from=derived_from)
        return Stored(self._transport.post("/v1/systems", document, creates=True, params=params))

    def get(self, system: str) -> Stored:
        """Return the present revision."""
        return Stored(self._transport.get(f"/v1/systems/{system}"))

    def list(
        self, *, name: str | None = None, after: datetime | None = None, before: datetime | None = None
    ) -> Iterator[Stored]:
        """Yield the stored systems, newest first; `name`, `after` and `before` narrow the list as that of the datasets."""
        return self._transport.items("/v1/systems", Stored, params=given(name=name, after=after, before=before))

    def find(self, name: str) -> Stored:
        """Return the present revision of the newest system that is called so.

        Raises
        ------
        LookupError
            There is none of that name.
        """
        for one in self.list(name=name[:_LONGEST_NAME] or None):
            if one.name == name:
                return self.get(one.id)
        raise LookupError(f"name must be that of a stored system, got {name!r}: `servotune systems list` shows them")

    def revision(self, system: str, number: int) -> Stored:
        """Return one revision, counted from 1."""
        return Stored(self._transport.get(f"/v1/systems/{system}/revisions/{number}"))

    def revisions(self, system: str) -> Iterator[Stored]:
        """Yield the revisions of one system."""
        return self._transport.items(f"/v1/systems/{system}/revisions", Stored)

    def update(
        self, system: str, document: Document, *, etag: str | None = None, derived_from: str | None = None
    ) -> Stored:
        """Store a new revision.

        Parameters
        ----------
        etag : str, optional
            The version that the change starts from; by default the one stored now, whoever wrote it.
        derived_from : str, optional
            The finished job (or kept study) that the numbers come from, for the lineage.

        Raises
        ------
        PreconditionFailedError
            Somebody else stored another revision since.
        """
        headers = {"If-Match": etag or self.etag(system)}
        params = given(derived_from=derived_from)
        response = self._transport.send("PUT", f"/v1/systems/{system}", json=document, params=params, headers=headers)
        return Stored(self._transport.body(response))

    def delete(self, system: str, *, etag: str | None = None, force: bool = False) -> None:
        """Delete a system; results keep the revision that they used.

        Raises
        ------
        ConflictError
            Schedules need it (`problem["dependents"]`), and it is not forced.
        """
        headers = {"If-Match": etag or self.etag(system)}
        params = {"force": True} if force else None
        self._transport.send("DELETE", f"/v1/systems/{system}", params=params, headers=headers)

    def state_space(
        self, system: SystemLike, *, open_at: str | Sequence[str] | None = None, parameters: Document | None = None
    ) -> StateSpace:
        """Return the realised matrices in SI, with the names of states, inputs and outputs, and the poles.

        Parameters
        ----------
        system : str or mapping
            Id of a stored system, or a document.
        open_at : str or sequence of str, optional
            Block where the loop is cut; `loop` is then the last input and the last output. Of several, opened together, the
            first.
        parameters : mapping, optional
            Values that replace those of the document.
        """
        if isinstance(system, str) and parameters is None:
            path = f"/v1/systems/{system}/state-space"
            return StateSpace(self._transport.get(path, params=given(open_at=open_at)))
        body = given(system=system, open_at=open_at, parameters=parameters)
        return StateSpace(self._transport.post("/v1/state-space", body))

    def matlab(self, system: str, *, open_at: str | Sequence[str] | None = None) -> bytes:
        """Return the same as the content of a .mat file."""
        query = {"format": "mat"} | given(open_at=open_at)
        return self._transport.send("GET", f"/v1/systems/{system}/state-space", params=query).content

    def etag(self, system: str) -> str:
        """Return the tag of the version stored now, for `update` and `delete`."""
        return self._transport.send("GET", f"/v1/systems/{system}").headers["ETag"]
