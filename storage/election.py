"""Elects one process among many for what is done for all of them.

Whoever is elected writes a higher number each time he looks; the others look whether it changes. A number that stays the same for
``patience`` of a clock that nobody sets, or a process of this machine that is not there any more, says that he is gone, and the first
to write in his place is elected. That takes a row and no session of the database, so it works behind any pooler.

Two may believe for a moment that they are elected, when one stood still: what they do must be right when it is done twice.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable

from sqlalchemy import delete, select, update

from storage import processes
from storage.insertion import insert_if_absent
from storage.models import Elected
from storage.session import Database

#: How long (s) the number of the elected one may stay the same.
PATIENCE = 8.0


class Election:
    """One candidate for one role; used by one thread.

    Parameters
    ----------
    database : Database
    role : str
        What is done for all.
    patience : float
        How long (s) the elected one may be silent.
    clock : callable
        Monotonic time in s.
    """

    def __init__(
        self,
        database: Database,
        role: str,
        *,
        patience: float = PATIENCE,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._database = database
        self._role = role
        self._patience = patience
        self._clock = clock
        self._name = secrets.token_hex(8)
        self._process = processes.this_process()
        self._seen: tuple[str, int] | None = None
        self._since = 0.0
        self._holder: str | None = None
        #: Whether this candidate was elected when it last looked.
        self.won = False

    def due(self, *, usual: bool) -> bool:
        """Return whether to look now, where it is ``usual`` or not: the elected one shows each time that he lives, and who sees him end looks at once."""
        return usual or self.won or processes.alive(self._holder) is False

    def elected(self) -> bool:
        """Show that this candidate lives, or look whether the elected one does; return whether this one is elected.

        Raises
        ------
        storage.errors.UNAVAILABLE
            When the database does not answer.
        """
        self.won = False
        self.won = self._look()
        return self.won

    def _look(self) -> bool:
        with self._database.one_by_one() as session:  # what is written names what was read
            now = self._clock()
            row = session.execute(
                select(Elected.holder, Elected.process, Elected.beats).where(Elected.role == self._role)
            ).one_or_none()
            if row is None:
                return insert_if_absent(
                    session, Elected, role=self._role, holder=self._name, process=self._process, beats=0
                )
            self._holder = row.process
            if row.holder != self._name:
                if (row.holder, row.beats) != self._seen:
                    self._seen, self._since = (row.holder, row.beats), now
                if processes.alive(row.process) is not False and now - self._since < self._patience:
                    return False
            written = (
                update(Elected)
                .where(Elected.role == self._role, Elected.holder == row.holder, Elected.beats == row.beats)
                .values(holder=self._name, process=self._process, beats=row.beats + 1)
                .returning(Elected.role)
            )
            return session.scalar(written.execution_options(synchronize_session=False)) is not None

    def resign(self) -> None:
        """Let another one be elected at once."""
        with self._database.session() as session:
            session.execute(delete(Elected).where(Elected.role == self._role, Elected.holder == self._name))
