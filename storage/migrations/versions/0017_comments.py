"""Comments on systems, datasets, jobs and kept results."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0017"
down_revision = "0016"
branch_labels = None
depends_on = None

SUBJECTS = ("system", "dataset", "job", "result")


def upgrade() -> None:
    one = " + ".join(f"CASE WHEN {subject}_id IS NULL THEN 0 ELSE 1 END" for subject in SUBJECTS)
    op.create_table(
        "comment",
        sa.Column("id", sa.String(length=40), nullable=False),
        sa.Column("workspace_id", sa.String(length=40), nullable=False),
        *(sa.Column(f"{subject}_id", sa.String(length=40), nullable=True) for subject in SUBJECTS),
        sa.Column("author_id", sa.String(length=40), nullable=False),
        sa.Column("author_name", sa.Text(), nullable=False),
        sa.Column("text", sa.Text(), nullable=False),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.CheckConstraint(f"{one} = 1", name=op.f("ck_comment_subject")),
        sa.ForeignKeyConstraint(["workspace_id"], ["workspace.id"], name=op.f("fk_comment_workspace_id_workspace")),
        *(
            sa.ForeignKeyConstraint(
                [f"{subject}_id"],
                [f"{subject}.id"],
                name=op.f(f"fk_comment_{subject}_id_{subject}"),
                ondelete="CASCADE",
            )
            for subject in SUBJECTS
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_comment")),
    )
    for column in ("workspace_id", *(f"{subject}_id" for subject in SUBJECTS)):
        op.create_index(
            op.f(f"ix_comment_{column}_created_at_id"), "comment", [column, "created_at", "id"], unique=False
        )
