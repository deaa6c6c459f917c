"""How often a recording was committed, and the bytes that its samples count for; of what is there already, once."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0011"
down_revision = "0010"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("dataset", sa.Column("commits", sa.Integer(), server_default="0", nullable=False))
    op.add_column("dataset", sa.Column("sample_bytes", sa.BigInteger(), server_default="0", nullable=False))
    op.execute("UPDATE dataset SET commits = 1 WHERE manifest IS NOT NULL")
    # samples that were read from a file; raw ones are what was received, processed ones are counted as they are
    op.execute(
        "UPDATE dataset SET sample_bytes = 8 * sample_count * json_array_length(channels) "
        "WHERE status = 'ready' AND manifest IS NOT NULL AND format <> 'raw' AND sample_count IS NOT NULL"
    )
    op.execute(
        "UPDATE workspace SET stored_bytes = stored_bytes + "
        "(SELECT COALESCE(SUM(sample_bytes), 0) FROM dataset WHERE dataset.workspace_id = workspace.id)"
    )
