"""Alerts: raised once for each source, and told to the webhooks that wait for them."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Any

from sqlalchemy import CursorResult, delete, select
from sqlalchemy.orm import Session

from storage.errors import NotFoundError
from storage.ids import new_id
from storage.insertion import insert_if_absent
from storage.models import Alert
from storage.pagination import Page, paginate
from storage.repositories.webhooks import notify


class AlertRepository:
    """The alerts of one workspace."""

    def __init__(self, session: Session, workspace_id: str) -> None:
        self._session = session
        self._workspace_id = workspace_id

    def raise_once(self, *, kind: str, source: str, detail: str, data: Mapping[str, Any]) -> bool:
        """Keep an alert and tell of it; False when this source has raised one of this kind before.

        Parameters
        ----------
        kind : str
            ``validation``, told as the event ``alert.validation``.
        source : str
            The id of what raises it: a job computed twice raises it once.
        """
        identifier = new_id("alr")
        values = {"workspace_id": self._workspace_id, "kind": kind, "source": source, "detail": detail}
        if not insert_if_absent(self._session, Alert, id=identifier, **values, data=dict(data)):
            return False
        told = {"id": identifier, "kind": kind, "source": source, "detail": detail, **data}
        notify(self._session, self._workspace_id, f"alert.{kind}", told)
        return True

    def get(self, identifier: str) -> Alert:
        """Return an alert; raise `NotFoundError` when it is not in this workspace."""
        alert = self._session.get(Alert, identifier)
        if alert is None or alert.workspace_id != self._workspace_id:
            raise NotFoundError("alert", identifier)
        return alert

    def page(
        self, *, kind: str | None = None, source: str | None = None, cursor: str | None = None, limit: int = 100
    ) -> Page[Alert]:
        """Return the alerts of the workspace, newest first."""
        rows = select(Alert).where(Alert.workspace_id == self._workspace_id)
        if kind is not None:
            rows = rows.where(Alert.kind == kind)
        if source is not None:
            rows = rows.where(Alert.source == source)
        return paginate(self._session, rows, Alert, cursor=cursor, limit=limit)


def forget(session: Session, *, before: datetime) -> int:
    """Delete alerts raised before a time; return how many."""
    result = session.execute(delete(Alert).where(Alert.created_at < before))
    assert isinstance(result, CursorResult)
    return result.rowcount
