"""Comments: what is asked and what is replied."""

from __future__ import annotations

from datetime import datetime

from pydantic import Field, field_validator

from api.schemas.replies import Reply
from api.schemas.values import Document

LONGEST = 4000
"""Characters of a comment."""


class CommentRequest(Document):
    """A comment on one thing."""

    about: str = Field(
        min_length=1, max_length=64, description="id of a system, a dataset, a job or a kept result", examples=["sys_1"]
    )
    text: str = Field(
        min_length=1,
        max_length=LONGEST,
        description="plain text: shown as it is written, never read as HTML or Markdown",
        examples=["Rings at 80 Hz with the new coupling."],
    )

    @field_validator("text")
    @classmethod
    def _says_something(cls, text: str) -> str:
        if not text.strip():
            raise ValueError("must say something, got nothing but blanks")
        return text


class CommentReply(Reply):
    """A comment, as it was written."""

    id: str
    about: str = Field(description="id of what it is about, with which it is deleted")
    text: str = Field(description="plain text")
    author: str = Field(description="name of the key or of the person, as it was then")
    author_id: str = Field(description="the key, or the sign-in of a browser that came without one")
    created_at: datetime
    deletable: bool = Field(
        description="whether the caller may delete it: its author, with the scope write, or an admin"
    )
