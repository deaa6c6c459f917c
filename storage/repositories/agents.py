"""Rigs, and the agents that drive them: of several agents of one rig, one has it."""

from __future__ import annotations

from datetime import timedelta

from sqlalchemy import select, update
from sqlalchemy.orm import Session

from storage.audit import record
from storage.clock import shared_now
from storage.errors import NotFoundError, StateError
from storage.ids import new_id
from storage.insertion import insert_if_absent
from storage.models import Agent, Rig
from storage.models.base import Document, utc_now
from storage.pagination import Page, paginate


class AgentRepository:
    """The rigs of one workspace and their agents."""

    def __init__(self, session: Session, workspace_id: str) -> None:
        self._session = session
        self._workspace_id = workspace_id

    def register(
        self, *, rig_name: str, instance: str, name: str, version: str, document: Document, alive_within: timedelta
    ) -> Agent:
        """Give a rig to an agent, with what the agent says of the rig.

        Raises
        ------
        StateError
            When another agent has the rig, and was heard of within ``alive_within``.
        """
        rig = self._rig(rig_name, document)
        now = shared_now(self._session)
        values = {"name": name, "version": version, "seen_at": now}
        new = insert_if_absent(
            self._session,
            Agent,
            id=new_id("agt"),
            workspace_id=self._workspace_id,
            rig_id=rig.id,
            instance=instance,
            created_at=utc_now(),
            **values,
        )
        agent = self._session.scalars(
            select(Agent)
            .where(Agent.rig_id == rig.id, Agent.instance == instance)
            .execution_options(populate_existing=True)
        ).one()
        holder = None if rig.agent_id in {None, agent.id} else self._session.get(Agent, rig.agent_id)
        if holder is not None and (since := abs(now - holder.seen_at)) < alive_within:
            raise StateError(
                f"rig {rig_name!r} must have one agent: {holder.name!r} has it, and was heard of "
                f"{since.total_seconds():.0f} s ago"
            )
        agent.name, agent.version, agent.seen_at = name, version, now
        rig.document, rig.agent_id = document, agent.id
        self._session.flush()
        if new or holder is not None:
            record(self._session, self._workspace_id, "agent.register", agent.id, rig=rig.id)
        return agent

    def get(self, identifier: str) -> Agent:
        """Return an agent; raise `NotFoundError` when it is not in this workspace."""
        row = self._session.get(Agent, identifier, populate_existing=True)
        if row is None or row.workspace_id != self._workspace_id:
            raise NotFoundError("agent", identifier)
        return row

    def page(self, *, cursor: str | None = None, limit: int = 100) -> Page[Agent]:
        """Return the agents of the workspace, newest first."""
        rows = select(Agent).where(Agent.workspace_id == self._workspace_id)
        return paginate(self._session, rows, Agent, cursor=cursor, limit=limit)

    def see(self, identifier: str) -> Rig:
        """Write down that an agent lives, and return its rig.

        Raises
        ------
        StateError
            When another agent has the rig now.
        """
        agent = self.get(identifier)
        agent.seen_at = shared_now(self._session)
        self._session.flush()
        rig = self.rig(agent.rig_id)
        if rig.agent_id != agent.id:
            raise StateError(f"agent {identifier!r} must register again: another one has the rig {rig.name!r} now")
        return rig

    def rig(self, identifier: str) -> Rig:
        """Return a rig; raise `NotFoundError` when it is not in this workspace."""
        row = self._session.get(Rig, identifier, populate_existing=True)
        if row is None or row.workspace_id != self._workspace_id:
            raise NotFoundError("rig", identifier)
        return row

    def rig_named(self, name: str) -> Rig:
        """Return the rig of a name; raise `NotFoundError` when no agent has registered it."""
        row = self._session.scalars(
            select(Rig).where(Rig.workspace_id == self._workspace_id, Rig.name == name)
        ).one_or_none()
        if row is None:
            raise NotFoundError("rig", name)
        return row

    def rigs(self, *, cursor: str | None = None, limit: int = 100) -> Page[Rig]:
        """Return the rigs of the workspace, newest first."""
        rows = select(Rig).where(Rig.workspace_id == self._workspace_id)
        return paginate(self._session, rows, Rig, cursor=cursor, limit=limit)

    def _rig(self, name: str, document: Document) -> Rig:
        """Return the rig of a name, made where there is none, with its row locked."""
        insert_if_absent(
            self._session,
            Rig,
            id=new_id("rig"),
            workspace_id=self._workspace_id,
            name=name,
            document=document,
            created_at=utc_now(),
        )
        self._session.execute(
            update(Rig)
            .where(Rig.workspace_id == self._workspace_id, Rig.name == name)
            .values(name=name)
            .execution_options(synchronize_session=False)
        )
        row = self.rig_named(name)
        self._session.refresh(row)
        return row
