"""What people write about systems, recordings and results."""

from __future__ import annotations

from collections.abc import Iterator

from servotune.documents import given
from servotune.replies.base import Reply
from servotune.transport import Transport


class Comment(Reply):
    """A comment, as it was written: plain text."""

    id: str
    about: str
    text: str
    author: str
    author_id: str
    created_at: str
    deletable: bool


class Comments:
    """The comments of the key's workspace."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def create(self, about: str, text: str) -> Comment:
        """Write a comment of at most 4000 characters on a system, a dataset, a job or a kept result, by its id."""
        return Comment(self._transport.post("/v1/comments", {"about": about, "text": text}, creates=True))

    def get(self, comment: str) -> Comment:
        """Return a comment."""
        return Comment(self._transport.get(f"/v1/comments/{comment}"))

    def list(self, *, about: str | None = None) -> Iterator[Comment]:
        """Yield the comments, or those on one thing, newest first."""
        return self._transport.items("/v1/comments", Comment, params=given(about=about))

    def delete(self, comment: str) -> None:
        """Delete a comment of one's own; an admin key deletes any."""
        self._transport.send("DELETE", f"/v1/comments/{comment}", headers={"If-Match": "*"})
